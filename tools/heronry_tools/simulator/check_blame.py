"""Nobody is blamed who is well: every fault that a PE reports on the bus is a fault that was made.

An EMCY is latched by the manager for good, so a false one costs the aircraft a healthy servo. What was really done is
known only to the run, and a fault stays: the reports are compared with the truth whenever somebody asks.

Reports are what a PE says itself, on any bus. What a gateway hands on was heard there already, or was said by somebody
who has no name here: with a key nobody believes that, and whoever did would plan without what is well (`end_state`).
"""

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.simulator.bus import Sent
from heronry_tools.simulator.violation import Violation
from heronry_wire.frame import Malformed
from heronry_wire.management import ElementKind, decode_emergency

_ACCUSES_NOBODY = ("RESET", "PHASE_REQUEST", "MODULE_RESTARTED", "CHANNEL_LOST", "CHANNEL_BACK")


class BlameCheck:
    """Collects what was reported."""

    def __init__(self, spec: Spec) -> None:
        """Reports name elements by their place in this spec."""
        self._names = {
            ElementKind.PE: tuple(spec.pes),
            ElementKind.DEVICE: tuple(spec.devices),
            ElementKind.MODULE: tuple(spec.modules),
            ElementKind.BUS: tuple(spec.buses),
        }
        self._reported: dict[str, Violation] = {}

    def emergency(self, sent: Sent) -> None:
        """An EMCY was sent."""
        emergency = decode_emergency(sent.frame.data)
        if isinstance(emergency, Malformed) or emergency.code.name in _ACCUSES_NOBODY:
            return
        element = f"{emergency.kind.name.lower()}:{self._names[emergency.kind][emergency.index]}"
        story = f"{element} is reported by {sent.sender} (detail {emergency.detail}), and it is well"
        self._reported.setdefault(element, Violation(sent.end_ns, "blame", story))

    @property
    def reported(self) -> set[str]:
        """Elements that have been reported, rightly or not."""
        return set(self._reported)

    def violations(self, truth: Situation) -> list[Violation]:
        """Give the reports of what has not failed."""
        return [violation for element, violation in self._reported.items() if element not in truth.down]
