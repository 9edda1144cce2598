"""No healthy element is reported: every fault that a PE reports on the bus is a fault that was injected.

An EMCY is latched by the manager for good, so a false one costs the aircraft a healthy servo. What was really injected
is known only to the run, and a fault stays: the reports are compared with the truth when `unfounded` is called.

Reports are what a PE sends itself, on any bus. What a gateway hands on was heard there already, or was sent by a node
that has no name here: with a key no manager believes that, and one that did would plan without what is well
(`end_state`).
"""

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.frame import Malformed
from heronry_wire.management import ElementKind, Emergency, decode_emergency

_REPORTS_NO_FAULT = ("RESET", "PHASE_REQUEST", "MODULE_RESTARTED", "CHANNEL_LOST", "CHANNEL_BACK")


class BlameCheck(Oracle):
    """Collects what was reported."""

    def __init__(self, spec: Spec) -> None:
        """EMCYs name elements by their place in this spec."""
        super().__init__()
        self._names = {
            ElementKind.PE: tuple(spec.pes),
            ElementKind.DEVICE: tuple(spec.devices),
            ElementKind.MODULE: tuple(spec.modules),
            ElementKind.BUS: tuple(spec.buses),
        }
        self._reported: dict[str, Violation] = {}
        self._cleared: dict[str, Violation] = {}  # that were reported rightly, and are well since

    def emergency(self, sent: Sent, _pe: str, _message: Emergency | Malformed) -> None:
        """An EMCY was sent."""
        element, detail = self._reported_by(sent)
        if element is None:
            return
        story = f"{element} is reported by {sent.sender} (detail {detail}), and it is well"
        self._reported.setdefault(element, Violation(sent.end_ns, "blame", story))

    def handed_on(self, sent: Sent) -> None:
        """A gateway has sent an EMCY; a late one may be about what was cleared since, and is believed once more."""
        element, _ = self._reported_by(sent)
        if element in self._cleared:
            self._reported.setdefault(element, self._cleared[element])

    def cleared(self, _t_ns: int, element: str, truth: Situation, *, everywhere: bool) -> None:  # noqa: ARG002
        """An element was cleared; what was reported of it rightly is forgotten."""
        if element in self._reported and element in truth.down:
            self._cleared[element] = self._reported.pop(element)

    def _reported_by(self, sent: Sent) -> tuple[str | None, int]:
        emergency = decode_emergency(sent.frame.data)
        if isinstance(emergency, Malformed) or emergency.code.name in _REPORTS_NO_FAULT:
            return None, 0
        names = self._names.get(emergency.kind, ())[emergency.index : emergency.index + 1]
        return f"{emergency.kind.name.lower()}:{names[0] if names else emergency.index}", emergency.detail

    @property
    def reported(self) -> dict[str, int]:
        """Elements that have been reported, rightly or not, and when."""
        return {element: violation.t_ns for element, violation in self._reported.items()}

    def unfounded(self, truth: Situation) -> list[Violation]:
        """Give the reports of what has not failed."""
        return [violation for element, violation in self._reported.items() if element not in truth.down]
