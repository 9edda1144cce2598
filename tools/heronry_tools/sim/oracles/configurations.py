"""Every configuration that is activated is legal, and staged by the PEs that it needs.

Verified from the frames: `Commanded` puts each configuration together again, and at its first ACTIVATE

- `heronry_dg.verify` must find nothing in it, in a situation in which nothing is down: gates, wires, budgets, bus
  loads, deadlines and placement rules hold whatever has failed. (What purpose a module serves depends on the phase, and
  is not verified where there are several.)
- no module is on a PE that takes no part, and every PE reached by wire that has something to do has reported that it
  staged just this: nothing runs on what is dead or unconfigured.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager.core.topology import reached_by_wire
from heronry_tools.sim.oracles.commanded import Epoch
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation

# By digests of spec and configuration. Of thousands of configurations two may share their 24 bits.
_VERIFIED: dict[tuple[str, int], tuple[Configuration, list[str]]] = {}


class ConfigurationCheck(Oracle):
    """Verifies what is activated."""

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._spec = spec
        self._wired = reached_by_wire(spec)
        self._node_of = {pe.name: pe.node_id for pe in spec.pes.values()}

    def activated(self, t_ns: int, epoch: Epoch) -> None:
        """An epoch has been activated, and put together again, or cannot be."""
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
                stories.append(f"epoch {epoch.number} runs modules on {pe}, which takes no part")
            elif pe in self._wired and node not in epoch.staged:
                stories.append(f"epoch {epoch.number} is activated, and {pe} has not staged it")
        return stories

    def _illegal(self, epoch: Epoch, configuration: Configuration) -> list[str]:
        key = (self._spec.digest, epoch.digest)
        known = _VERIFIED.get(key)
        if known is None or known[0] != configuration:
            found = verify(self._spec, Situation(phase=self._spec.initial_phase()), configuration)
            stories = [str(v) for v in found if not (v.rule.startswith("5.") and len(self._spec.phases) > 1)]
            known = _VERIFIED[key] = configuration, stories
        return known[1]
