"""What PEs report of the states of modules: with which state a module has started, and which state cannot be saved.

Per module the manager keeps how it has started last, where and when; the report of a later start replaces it. A state
that cannot be saved is a notice (`module_notices`): its PE repeats it every second while this lasts.

A PE sends the report of a start three times. A copy has the same detail within 3.5 s (CHANNEL_FORGOTTEN_NS) after the
one before, and makes no second event. If all three are lost, nothing is told of the start. A forged report makes a
false event, and a false line in the status. A manager that restarts, or takes over, knows only the starts that are
reported to it. No report changes a plan.
"""

from dataclasses import dataclass, replace

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.situation.module_notices import ModuleNotices
from heronry_manager.core.turn import Turn
from heronry_wire.checkpoint_frames import Lack
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS

WORDS = {
    Lack.NO_STATE: "no state of it was kept there",
    Lack.TOO_OLD: "its state is too old",
    Lack.OTHER_CODE: "its state is of another version of its code, or damaged",
    Lack.REFUSED: "its restore has failed",
    Lack.RAISES: "its save raises an exception",
    Lack.HANGS: "its save takes too long",
    Lack.TOO_LONG: "its state is longer than the spec says",
    Lack.NO_NUMBERS: "its save gives something else than finite numbers",
}


@dataclass(frozen=True, slots=True)
class _Start:
    """How a module has started; age_ms: age of its state; None: it has started without, for the reason `why`."""

    by: str
    at_ns: int
    told_ns: int  # when the last copy of the report came
    age_ms: int | None
    why: str | None


class CheckpointNotices(ModuleNotices):
    """Keeps what PEs report of the states of modules."""

    def __init__(self, spec: Spec, turn: Turn) -> None:
        """Begin without reports."""
        super().__init__(spec, turn)
        self._starts: dict[str, _Start] = {}

    def reported(self, pe: str, emergency: Emergency) -> None:
        """Take a report of a PE about the state of a module; one that makes no sense is ignored."""
        if emergency.kind is not ElementKind.MODULE or emergency.index >= len(self._modules):
            return
        if emergency.code is FaultCode.STATE_RESTORED:
            self._started(self._modules[emergency.index], pe, emergency.detail, None)
        elif emergency.detail in WORDS:
            lack = Lack(emergency.detail)
            if lack.is_of_save:
                super().reported(pe, emergency)
            else:
                self._started(self._modules[emergency.index], pe, None, WORDS[lack])

    def status(self, now_ns: int) -> list[dict[str, object]]:
        """List the last start of each module, and the states that cannot be saved, as plain data."""
        unsaved = {(module, pe): WORDS[Lack(detail)] for module, pe, detail in self.all()}
        started = [
            {
                "module": module,
                "by": start.by,
                "age_ms": start.age_ms,
                "why": start.why,
                "for_ns": now_ns - start.at_ns,
                "not_saved": unsaved.pop((module, start.by), None),
            }
            for module, start in sorted(self._starts.items())
        ]
        unknown = dict.fromkeys(("age_ms", "why", "for_ns"))
        return [*started, *({"module": m, "by": pe, **unknown, "not_saved": why} for (m, pe), why in unsaved.items())]

    def _started(self, module: str, by: str, age_ms: int | None, why: str | None) -> None:
        before, now_ns = self._starts.get(module), self._turn.now_ns
        is_copy = before is not None and (before.by, before.age_ms, before.why) == (by, age_ms, why)
        if before is not None and is_copy and now_ns - before.told_ns <= CHANNEL_FORGOTTEN_NS:
            self._starts[module] = replace(before, told_ns=now_ns)
            return
        self._starts[module] = _Start(by, now_ns, now_ns, age_ms, why)
        if age_ms is not None:
            self._turn.emit(events.StateRestored, module=module, by=by, age_ms=age_ms)
        elif why is not None:  # pragma: no branch - one of the two is given
            self._turn.emit(events.StateLacking, module=module, by=by, why=why)

    def _begun(self, module: str, by: str, detail: int) -> None:
        self._turn.emit(events.StateNotSaved, module=module, by=by, why=WORDS[Lack(detail)])

    def _over(self, module: str, by: str) -> None:
        self._turn.emit(events.StateSaved, module=module, by=by)
