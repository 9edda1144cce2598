"""What the operator may say to a manager in flight, and what it answers: one sentence each.

    phase NAME       another mission phase, any of the spec's
    fail ELEMENT     it counts as failed, whatever is heard of it: plan without it. Not the manager's own bus, and no
                     channel, without which nothing would be planned otherwise
    clear ELEMENT    it is taken for well again: a latched fault ends, a PE leaves its quarantine, one that was failed
                     may join again after the shortest hold-down. Every PE is told (CONTROL, CLEAR), so that what is
                     still wrong is reported at once; lost, that costs a second (a standby: some beats)
    unlock pe:NAME   with a key: NMT and SDO may write on this one PE for UNLOCK_S seconds. The order is not repeated:
                     lost, it has to be given again

To a manager that only advises all but the last is a supposition: it tells what it would do then.

An order is answered when it is understood, not when it has been carried out: the plan and the epoch follow, and the
status tells. Said twice, the second one changes nothing. Who may say it is for whoever delivers it to decide.
"""

from heronry_dg.model import Spec
from heronry_dg.situation import UnknownElementError, checked_element, checked_phase
from heronry_manager.core.health import Health
from heronry_manager.core.known_situation import KnownSituation
from heronry_manager.core.latched_faults import OPERATOR_CODE, LatchedFault
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import ClearElement, EnterPhase, FailElement, Reply, UnlockPe
from heronry_wire.identifiers import Command
from heronry_wire.management import Control, Operation

OPERATOR = "the operator"
UNLOCK_S = 30
_EVERYBODY = 0
_ONLY_ADVISES = "this manager only advises: say it to the one that reigns"


class OperatorOrders:
    """Carries out orders."""

    def __init__(self, spec: Spec, turn: Turn, health: Health, situation: KnownSituation, *, has_key: bool) -> None:
        self._has_key = has_key
        self._spec, self._turn = spec, turn
        self._health, self._situation = health, situation

    def obey(self, number: int, order: EnterPhase | FailElement | ClearElement | UnlockPe) -> Reply:
        """Carry out an order; what names nothing in the spec is refused with a sentence that says what there is."""
        try:
            match order:
                case EnterPhase(phase):
                    return Reply(number, True, self._enter(checked_phase(self._spec, phase)))
                case FailElement(element):
                    return self._fail(number, checked_element(self._spec, element))
                case ClearElement(element):
                    return self._clear(number, checked_element(self._spec, element))
                case UnlockPe(element):  # pragma: no branch - nothing else is left
                    return self._unlock(number, checked_element(self._spec, element))
        except UnknownElementError as error:
            return Reply(number, False, str(error))

    def _enter(self, phase: str) -> str:
        before = self._situation.phase
        if phase == before:
            return f"the phase is {phase} already"
        self._situation.enter(phase, OPERATOR)
        return f"the phase is {phase} from now on, it was {before}; {self._what_follows('a plan for it is on its way')}"

    def _fail(self, number: int, element: str) -> Reply:
        if element == self._situation.own_bus:
            why = f"{element} carries this manager's commands, and a plan without it would stop everything"
            return Reply(number, False, f"{why}: name what has failed on it")
        if element.startswith("channel:"):
            why = f"{element} is one of several that carry the same, and a plan without it would be no other"
            return Reply(number, False, f"{why}: name the bus if all of them have failed")
        if element in self._situation.failed.elements:
            return Reply(number, True, f"{element} counts as failed already")
        self._situation.latch(LatchedFault(element, OPERATOR, OPERATOR_CODE, 0, self._turn.now_ns))
        follows = self._what_follows("a plan without it is on its way")
        return Reply(number, True, f"{element} counts as failed until it is cleared; {follows}")

    def _clear(self, number: int, element: str) -> Reply:
        if not self._situation.clear(element, OPERATOR):
            sentence = f"nothing is latched on {element}, and it is in no quarantine: 'heronry status' tells what is"
            return Reply(number, False, sentence)
        place = self._situation.failed.place(element)
        if place is not None:
            self._turn.send(Command.CONTROL, Control(self._turn.term, _EVERYBODY, Operation.CLEAR, *place))
        waits = "it joins after its hold-down" if element.startswith("pe:") else "a plan with it is on its way"
        return Reply(number, True, f"{element} is taken for well again; {self._what_follows(waits)}")

    def _what_follows(self, where_it_commands: str) -> str:
        return _ONLY_ADVISES if self._turn.silent else where_it_commands

    def _unlock(self, number: int, element: str) -> Reply:
        pe = self._spec.pes.get(element.removeprefix("pe:"))
        if pe is None or not element.startswith("pe:"):
            return Reply(number, False, f"{element} has no lock: name a PE, such as pe:{next(iter(self._spec.pes))}")
        if not self._has_key:
            return Reply(number, False, "nothing is locked, since this manager has no key: 'heronry key' makes one")
        if self._turn.silent:
            return Reply(number, False, _ONLY_ADVISES)
        self._turn.send(Command.CONTROL, Control(self._turn.term, pe.node_id, Operation.UNLOCK, UNLOCK_S))
        return Reply(number, True, f"NMT and SDO may write on {element} for {UNLOCK_S} s")
