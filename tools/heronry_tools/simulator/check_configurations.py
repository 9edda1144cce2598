"""Every configuration that is activated is legal, staged by whom it needs, and drops nothing critical without need.

Judged from the frames: `Commanded` puts each configuration together again, and at its first ACTIVATE

- `heronry_dg.verify` must find nothing in it, in a situation in which nothing is down: gates, wires, budgets, bus
  loads, deadlines and placement rules hold whatever has failed. (What purpose a module serves depends on the phase, and
  is not judged where there are several.)
- no module is on a PE that takes no part, and every PE reached by wire that has something to do has said that it staged
  just this: nothing runs on what is dead or unconfigured;
- by criticality it serves at least what the best plan serves for what the manager can know: that the PEs which take no
  part are down, and what was reported and acknowledged has failed.
"""

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager.topology import reached_by_wire
from heronry_tools.simulator.commanded import Commanded, Epoch
from heronry_tools.simulator.planning import best_plan
from heronry_tools.simulator.violation import Violation
from heronry_wire.management import Control, ElementKind, ManagementMessage, Operation, StatePage1

_JUDGED: dict[tuple[str, int], list[str]] = {}  # by digests of spec and configuration


class ConfigurationCheck:
    """Judges what is activated."""

    def __init__(self, spec: Spec) -> None:
        """CONTROL names elements by their place in this spec."""
        self.violations: list[Violation] = []
        self.commanded = Commanded(spec)
        self._spec = spec
        self._elements = {
            ElementKind.PE: [f"pe:{pe}" for pe in spec.pes],
            ElementKind.DEVICE: [f"device:{device}" for device in spec.devices],
            ElementKind.MODULE: [f"module:{module}" for module in spec.modules],
            ElementKind.BUS: [f"bus:{bus}" for bus in spec.buses],
        }
        self._wired = reached_by_wire(spec)
        self._node_of = {pe.name: pe.node_id for pe in spec.pes.values()}
        self._acknowledged: set[str] = set()

    def heard(self, t_ns: int, message: ManagementMessage, phase: str | None) -> None:
        """A manager was heard."""
        if isinstance(message, Control) and message.operation is Operation.ACKNOWLEDGE:
            names = self._elements.get(ElementKind(message.a), []) if message.a in set(ElementKind) else []
            self._acknowledged.update(names[message.b : message.b + 1])
            return
        epoch = self.commanded.take(t_ns, message)
        if epoch is not None:
            self.violations += [Violation(t_ns, rule, story) for rule, story in self._judge(epoch, phase)]

    def staged(self, node: int, page: StatePage1) -> None:
        """A PE says what it has staged."""
        self.commanded.staged(node, page)

    def _judge(self, epoch: Epoch, phase: str | None) -> list[tuple[str, str]]:
        configuration = epoch.configuration
        if configuration is None:
            return [("configuration", f"epoch {epoch.number}: {epoch.flaw}")]
        stories = [("configuration", f"epoch {epoch.number}: {story}") for story in self._illegal(epoch, configuration)]
        busy = {running.pe for running in configuration.modules.values()}
        for pe in sorted(busy):
            node = self._node_of[pe]
            if node not in epoch.heads:
                stories.append(("configuration", f"epoch {epoch.number} runs modules on {pe}, which takes no part"))
            elif pe in self._wired and node not in epoch.staged:
                stories.append(("configuration", f"epoch {epoch.number} is activated, and {pe} has not staged it"))
        absent = {f"pe:{pe}" for pe, node in self._node_of.items() if node not in epoch.heads}
        now = Situation(frozenset(absent | self._acknowledged), {}, phase)
        served = score(self._spec, now, configuration, None).critical
        possible = best_plan(self._spec, now, None).objective.critical
        if served < possible:
            story = (
                f"epoch {epoch.number} serves {served} by criticality, and {possible} could be with {sorted(absent)}"
            )
            stories.append(("service", story))
        return stories

    def _illegal(self, epoch: Epoch, configuration: Configuration) -> list[str]:
        key = (self._spec.digest, epoch.digest)
        if key not in _JUDGED:
            found = verify(self._spec, Situation(phase=self._spec.initial_phase()), configuration)
            _JUDGED[key] = [str(v) for v in found if not (v.rule.startswith("5.") and len(self._spec.phases) > 1)]
        return _JUDGED[key]
