"""Notices of modules that are not faults: inputs disagree, a report names an unknown element, a name is misspelt.

    told    the PE of the module has sent the notice (EMCY, DISAGREEMENT, UNKNOWN_ELEMENT, UNKNOWN_OUTPUT or
            UNKNOWN_INPUT) within the last 3.5 s (CHANNEL_FORGOTTEN_NS)
    over    the PE has not sent the notice for so long

A notice changes no plan. An event reports when a notice begins, and when a disagreement is over; `heronry status` lists
the disagreements. In a disagreement either input may be right, and the comparator decides which value its module gives
(`heronry_agent.parts.comparators`).

A PE repeats a notice every second while its cause lasts, so a lost notice comes again; no manager acknowledges notices.
A late or doubled notice has no effect. A forged notice makes a false event; a forged disagreement is also in the status
for 3.5 s. A manager that restarts, or takes over, knows all notices within a second. A notice of a module that the spec
does not have is ignored.
"""

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.turn import Turn
from heronry_wire.management import ElementKind, Emergency
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS


class ModuleNotices:
    """Keeps the notices of one kind (head of this file), by module and PE.

    A subclass chooses the events that report when a notice begins and when it is over.
    """

    def __init__(self, spec: Spec, turn: Turn) -> None:
        self._modules, self._turn = list(spec.modules), turn
        self._told: dict[tuple[str, str], tuple[int, int]] = {}  # by module and PE: time and detail of the last one

    def reported(self, pe: str, emergency: Emergency) -> None:
        """Take what a PE reports of one of its modules.

        The first report makes an event. Later ones prolong the notice until the PE has been silent about the module
        for CHANNEL_FORGOTTEN_NS (`beat`). A report of a module that the spec does not have is ignored.
        """
        if emergency.kind is not ElementKind.MODULE or emergency.index >= len(self._modules):
            return
        key = self._modules[emergency.index], pe
        if key not in self._told:
            self._begun(*key, emergency.detail)
        self._told[key] = self._turn.now_ns, emergency.detail

    def beat(self) -> None:
        """End each notice that its PE has not repeated for CHANNEL_FORGOTTEN_NS."""
        for (module, pe), (at_ns, _) in list(self._told.items()):
            if self._turn.now_ns - at_ns > CHANNEL_FORGOTTEN_NS:
                del self._told[module, pe]
                self._over(module, pe)

    def all(self) -> list[tuple[str, str, int]]:
        """List (module, PE, detail of the last report) for each notice that is not over."""
        return [(module, pe, detail) for (module, pe), (_, detail) in sorted(self._told.items())]

    def _begun(self, module: str, by: str, detail: int) -> None:
        raise NotImplementedError

    def _over(self, module: str, by: str) -> None:
        """Do nothing at the end of a notice; a subclass may override this method and report the end as an event."""


class Disagreements(ModuleNotices):
    """Keeps which comparators have inputs that differ."""

    def _begun(self, module: str, by: str, detail: int) -> None:
        self._turn.emit(events.Disagreement, module=module, by=by, detail=detail)

    def _over(self, module: str, by: str) -> None:
        self._turn.emit(events.Agreement, module=module, by=by)


class UnknownReports(ModuleNotices):
    """Keeps which modules report an element that the spec does not have."""

    def _begun(self, module: str, by: str, detail: int) -> None:
        self._turn.emit(events.UnknownElement, module=module, by=by, detail=detail)


class UnknownInputs(ModuleNotices):
    """Remembers the modules that read an input under a misspelt name."""

    def _begun(self, module: str, by: str, detail: int) -> None:  # noqa: ARG002 - it is always 0
        self._turn.emit(events.UnknownInput, module=module, by=by)


class UnknownOutputs(ModuleNotices):
    """Remembers the modules that give an output whose name is misspelt."""

    def _begun(self, module: str, by: str, detail: int) -> None:  # noqa: ARG002 - it is always 0
        self._turn.emit(events.UnknownOutput, module=module, by=by)
