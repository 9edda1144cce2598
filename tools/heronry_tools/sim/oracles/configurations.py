"""Every activated configuration is legal, and was staged by each PE that must run something in it.

`Commanded` reads each configuration back from the frames. At the first ACTIVATE of its epoch, two things must hold:

1. `heronry_dg.verify` finds no violation in the configuration. It is called as if nothing were down, since the rules
   verified here (gates, wires, budgets, bus loads, deadlines, placement) do not depend on what has failed. (Whether a
   module serves a purpose depends on the phase, and is not verified for a spec with several phases.)
2. Each PE on which the configuration places a module takes part in the epoch: a slice of the epoch was sent to the PE,
   or the PE has staged a slice that it had on board. If the PE is reached by wire, it has also reported the epoch as
   staged. If the PE is beyond a radio and the epoch is a contingency, the PE may stage its slice later.

So nothing runs on a dead or unconfigured PE.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager.core.topology import reached_by_wire
from heronry_tools.recording.commanded import Epoch
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation

# Keyed by the digests of spec and configuration; a configuration's 24-bit digest alone may occur twice.
_VERIFIED: dict[tuple[str, int], tuple[Configuration, list[str]]] = {}


class ConfigurationCheck(Oracle):
    """Verifies that the configuration of each activated epoch is legal, and that each PE that it uses takes part."""

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._spec = spec
        self._wired = reached_by_wire(spec)
        self._node_of = {pe.name: pe.node_id for pe in spec.pes.values()}

    def activated(self, t_ns: int, epoch: Epoch) -> None:
        """Verify the configuration of an epoch, or record that it cannot be put together."""
        self.violations += [Violation(t_ns, "configuration", story) for story in self._assess(epoch)]

    def _assess(self, epoch: Epoch) -> list[str]:
        configuration = epoch.configuration
        if configuration is None:
            return [f"epoch {epoch.number}: {epoch.flaw}"]
        stories = [f"epoch {epoch.number}: {story}" for story in self._illegal(epoch, configuration)]
        for pe in sorted({running.pe for running in configuration.modules.values()}):
            node = self._node_of[pe]
            may_come_later = epoch.contingency and pe not in self._wired
            if not epoch.has(node) and not may_come_later:
                stories.append(f"epoch {epoch.number} runs modules on {pe}, which takes no part in that epoch")
            elif pe in self._wired and node not in epoch.staged:
                stories.append(f"epoch {epoch.number} was activated before {pe} reported it as staged")
        return stories

    def _illegal(self, epoch: Epoch, configuration: Configuration) -> list[str]:
        key = (self._spec.digest, epoch.digest)
        known = _VERIFIED.get(key)
        if known is None or known[0] != configuration:
            found = verify(self._spec, Situation(phase=self._spec.initial_phase()), configuration)
            stories = [
                str(v) for v in found if not (v.rule.startswith(("5.", "2.phase")) and len(self._spec.phases) > 1)
            ]
            known = _VERIFIED[key] = configuration, stories
        return known[1]
