"""Comparators whose two versions differ: not a fault, since either version may be right, so no plan changes.

    disagree    the PE of the comparator has reported it (EMCY, DISAGREEMENT), within the last CHANNEL_FORGOTTEN_NS
    agree       no report came for that long

An event tells when each begins; `heronry status` lists those that disagree. What goes on is for the comparator to
decide (`heronry_agent.parts.comparators`).

Lost: a report is repeated every second while the versions differ, and never acknowledged. Late or doubled: no effect.
Forged: a false line in the status, for three seconds. A manager that restarts, or takes over, knows the disagreements
within a second. A report of a module that the spec does not have is ignored.
"""

from heronry_dg.model import Spec
from heronry_manager.core.turn import Turn
from heronry_wire.management import ElementKind, Emergency
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS


class Disagreements:
    """The comparators that report a disagreement."""

    def __init__(self, spec: Spec, turn: Turn) -> None:
        self._modules, self._turn = list(spec.modules), turn
        self._told: dict[tuple[str, str], tuple[int, int]] = {}  # by comparator and PE: time and detail of the report

    def reported(self, pe: str, emergency: Emergency) -> None:
        """Take a PE's report that the inputs of one of its comparators differ."""
        if emergency.kind is not ElementKind.MODULE or emergency.index >= len(self._modules):
            return
        key = self._modules[emergency.index], pe
        if key not in self._told:
            self._turn.emit("disagreement", module=key[0], by=pe, detail=emergency.detail)
        self._told[key] = self._turn.now_ns, emergency.detail

    def beat(self) -> None:
        """Let time pass: a disagreement that is no longer reported is over."""
        for (module, pe), (at_ns, _) in list(self._told.items()):
            if self._turn.now_ns - at_ns > CHANNEL_FORGOTTEN_NS:
                del self._told[module, pe]
                self._turn.emit("agreement", module=module, by=pe)

    def all(self) -> list[tuple[str, str, int]]:
        """Give module, PE and detail of each disagreement."""
        return [(module, pe, detail) for (module, pe), (_, detail) in sorted(self._told.items())]
