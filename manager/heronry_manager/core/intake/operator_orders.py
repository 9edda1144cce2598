"""The orders that an operator may give to a manager in flight, and the sentence that answers each.

    phase NAME       enter another mission phase of the spec
    priority F N     give function F another priority, 0 to 32767, or `default`: the priority of the spec. The order
                     stands until the operator ends it; meanwhile no request of a module changes this priority
    fail ELEMENT     the element counts as failed, even if it is heard: the manager plans without it. An order to fail
                     the manager's own bus is refused; an order to fail a channel is refused, too, since the plan would
                     be the same
    clear ELEMENT    the element no longer counts as failed: its latched fault ends, a PE leaves its quarantine, and a
                     PE that was failed may join again after the shortest hold-down. The manager sends CONTROL, CLEAR to
                     every PE, so that a PE immediately reports a fault that persists. If that frame is lost, the fault
                     is reported a second later, and a standby manager learns of the clearing some beats later
    retire ELEMENT   the element goes out of service, while it still works (`retirement`): the best plan without it is
                     made while what runs runs on, and then its modules move. An order during a reconfiguration is
                     refused, as is one to retire a gateway before the PEs behind it
    restore ELEMENT  the element is taken back into service: each fault on it ends that the operator has declared to
                     this manager. A manager that has taken over does not know who has declared a fault: it names the
                     elements, and the operator clears them
    script           run another configuration, which a script makes of the running one (`held_script`). A script is
                     refused during a reconfiguration, while another script waits, or if its configuration is not legal
    release          end the script that the operator has ordered, whether it runs already or not
    unlock pe:NAME   with a key: this one PE accepts NMT commands and SDO writes for UNLOCK_S seconds. The frame is not
                     repeated: if it is lost, the operator has to give the order again

A manager that only advises the operator does not execute orders of phases, failures and clearances. It plans as if they
had been executed, and reports what it would do.

The consequences of an order are returned (`Outcome`). The caller carries them out in this order: the consequences of
the changed situation, the command to the PEs, the reply. So the reply shows that the order was understood, and not that
it has been carried out: the plan and the epoch follow, and the status shows them. An order that is given twice has no
effect the second time. The part that delivers orders decides which callers may give them.
"""

from dataclasses import dataclass

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import UnknownElementError, checked_element, checked_function, checked_phase, module_of
from heronry_dg.verify import verify
from heronry_manager.core.intake.retirement import connected_by, parts_of
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.planning import PlanRequests
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.situation import (
    HELD_CODE,
    OPERATOR_CODE,
    Changes,
    LatchedFault,
    PlanInTime,
    PlanNeeded,
    TargetOrdered,
    TargetReleased,
)
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import (
    ClearElement,
    EnterPhase,
    FailElement,
    FlyTarget,
    OrderToExecute,
    ReleaseTarget,
    RestoreElement,
    RetireElement,
    SetPriority,
    UnlockPe,
)
from heronry_wire.management import MOST_FUNCTIONS, MOST_PRIORITY, Control, Operation

OPERATOR = "the operator"
UNLOCK_S = 30
_ALL_NODES = 0
_ONLY_ADVISES = "this manager only advises: give the order to the active manager"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What follows from an order, and the sentence that answers it.

    done: False if the order was refused.
    changes: the changes of the situation that follow.
    commands: each CONTROL to send to the PEs.
    """

    done: bool
    sentence: str
    changes: Changes = ()
    commands: tuple[Control, ...] = ()  # to the PEs
    is_unusable: bool = False  # the order names what the spec does not have


def module_problem(spec: Spec, element: str) -> str | None:
    """Say why `element` is not a module of the spec; None: it is one."""
    try:
        found = checked_element(spec, element)
    except UnknownElementError as error:
        return str(error)
    return None if found.startswith("module:") else f"{element} has no code that could fail: name a module"


class OperatorOrders:
    """Carries out the orders of the operator."""

    def __init__(self, settings: ManagerSettings, turn: Turn, known: Knowledge, requests: PlanRequests) -> None:
        self._spec, self._has_key = settings.spec, settings.key is not None
        self._turn, self._requests = turn, requests
        self._situation, self._deployment, self._script = known.situation, known.deployment, known.script

    def accept(self, order: OrderToExecute) -> Outcome:
        """Carry out an order.

        An order with a name that is not in the spec is refused; the sentence then lists the names of the spec.
        """
        try:
            match order:
                case EnterPhase(phase):
                    return self._enter(checked_phase(self._spec, phase))
                case SetPriority(function, priority):
                    return self._set_priority(checked_function(self._spec, function), priority)
                case FailElement() | ClearElement() | RetireElement() | RestoreElement():
                    return self._change_service(order)
                case FlyTarget(target, problem):
                    return self._fly(target, problem)
                case ReleaseTarget():
                    return self._release()
                case UnlockPe(element):  # pragma: no branch - nothing else is left
                    return self._unlock(checked_element(self._spec, element))
        except UnknownElementError as error:
            return Outcome(False, str(error), is_unusable=True)

    def _change_service(self, order: FailElement | ClearElement | RetireElement | RestoreElement) -> Outcome:
        element = checked_element(self._spec, order.element)
        match order:
            case FailElement():
                return self._fail(element)
            case ClearElement():
                return self._clear(element)
            case RetireElement():
                return self._retire(element)
            case RestoreElement():  # pragma: no branch - nothing else is left
                return self._restore(element)

    def _enter(self, phase: str) -> Outcome:
        before = self._situation.phase
        if phase == before:
            return Outcome(True, f"the phase is {phase} already")
        changes = self._situation.enter(phase, OPERATOR)
        follows = self._what_follows("a plan for it is on its way")
        return Outcome(True, f"the phase is {phase} from now on, it was {before}; {follows}", changes)

    def _set_priority(self, function: str, priority: int | None) -> Outcome:
        if not self._situation.can_change_priority(function):
            why = (
                f"commands can name only the first {MOST_FUNCTIONS} functions of a spec, and {function} is a later one"
            )
            return Outcome(False, why)
        if priority is not None and not 0 <= priority <= MOST_PRIORITY:
            sentence = f"a priority is a whole number from 0 to {MOST_PRIORITY}, not {priority}"
            return Outcome(False, sentence, is_unusable=True)
        changes = self._situation.order_priority(function, priority)
        word = "that of the spec" if priority is None else str(priority)
        if not changes:
            return Outcome(True, f"the priority of {function} is {word} already")
        told = Control(self._turn.term, _ALL_NODES, *self._situation.priority_fact(function))
        follows = self._what_follows("a plan for it is on its way")
        return Outcome(True, f"the priority of {function} is {word} from now on; {follows}", changes, (told,))

    def _fail(self, element: str) -> Outcome:
        situation, reason = self._situation, self._why_no_plan(element)
        if reason is not None:
            return Outcome(False, reason)
        lacks = situation.only_lacks(element)
        if situation.is_failed(element) and not lacks:
            return Outcome(True, f"{element} counts as failed already")
        changes = situation.latch(LatchedFault(element, OPERATOR, OPERATOR_CODE, 0, self._turn.now_ns))
        if lacks:
            return Outcome(True, f"{element} counts as failed until it is cleared, also when its code comes", changes)
        follows = self._what_follows("a plan without it is on its way")
        return Outcome(True, f"{element} counts as failed until it is cleared; {follows}", changes)

    def _why_no_plan(self, element: str) -> str | None:
        """Say why there can be no plan without an element; None: there can be one."""
        if element == self._situation.own_bus:
            why = f"{element} carries this manager's commands, and a plan without it would stop everything"
            return f"{why}: name what has failed on it"
        if element.startswith("channel:"):
            why = f"{element} is one of several channels with the same frames, so no plan would change"
            return f"{why}: name the bus if all of them have failed"
        return None

    def _retire(self, element: str) -> Outcome:
        situation = self._situation
        parts = [
            one for one in parts_of(self._spec, element) if not situation.is_failed(one) or situation.only_lacks(one)
        ]
        reason = self._why_no_plan(element) or self._why_needed(element)
        if reason is None and parts and not self._turn.silent:
            reason = self._why_not_now()
        if reason is not None:
            return Outcome(False, f"{element} stays in service: {reason}")
        if not parts:
            return Outcome(True, f"{element} is out of service already: nothing is planned there")
        for one in parts:
            situation.latch(LatchedFault(one, OPERATOR, OPERATOR_CODE, 0, self._turn.now_ns))
        then = (
            f"switch it off when 'heronry status' shows that nothing runs there; 'heronry restore {element}' ends this"
        )
        follows = self._what_follows(f"a plan without it is on its way: {then}")
        return Outcome(True, f"{element} is retired; {follows}", (PlanInTime(f"{element} retired by {OPERATOR}"),))

    def _why_needed(self, element: str) -> str | None:
        """Say which PEs are in service that only this element connects with the manager; None: there are none."""
        behind = [
            f"pe:{pe}"
            for pe in connected_by(self._spec, element)
            if not self._situation.is_failed(f"pe:{pe}")
            and not all(map(self._situation.is_failed, parts_of(self._spec, f"pe:{pe}")))
        ]
        return f"it alone connects {', '.join(behind)} with the manager: retire these first" if behind else None

    def _restore(self, element: str) -> Outcome:
        situation = self._situation
        held = [one for one in parts_of(self._spec, element) if situation.failed.code(one) == HELD_CODE]
        if held:
            before = "only the manager before this one knew whether a PE has reported or an operator retired these"
            return Outcome(False, f"{before}: {', '.join(held)}; end each with 'heronry clear' if it works")
        parts = [one for one in parts_of(self._spec, element) if situation.restore(one, OPERATOR)]
        if not parts:
            return Outcome(False, f"{element} is not retired: 'heronry clear' ends a fault that was reported")
        fields = filter(None, map(self._situation.field, parts))
        commands = tuple(Control(self._turn.term, _ALL_NODES, Operation.CLEAR, *field) for field in fields)
        cause = PlanNeeded(f"{element} restored by {OPERATOR}")
        follows = self._what_follows("a plan with it is on its way")
        return Outcome(True, f"{element} is in service again; {follows}", (cause,), commands)

    def _clear(self, element: str) -> Outcome:
        changes = self._situation.clear(element, OPERATOR)
        module = module_of(element)
        is_down = module != element and self._situation.is_failed(module)
        everywhere = f"{module} counts as failed on every PE: clear {module}" if is_down else None
        if changes is None:
            hint = everywhere or "see 'heronry status'"
            return Outcome(False, f"no fault is latched on {element}, and it is not in quarantine: {hint}")
        named = self._situation.field(element)
        told = () if named is None else (Control(self._turn.term, _ALL_NODES, Operation.CLEAR, *named),)
        waits = "it joins after its hold-down" if element.startswith("pe:") else "a plan with it is on its way"
        follows = everywhere or self._what_follows(waits)
        return Outcome(True, f"{element} no longer counts as failed; {follows}", changes, told)

    def _fly(self, target: Configuration | None, problem: str) -> Outcome:
        """Order the configuration of a script if it is legal now; else refuse it.

        target: that configuration; None: the script gives none, because of `problem`.
        """
        if self._turn.silent:
            return Outcome(False, _ONLY_ADVISES)
        reason = problem if target is None else self._why_not_now() or self._why_not_legal(target)
        if target is None or reason is not None:
            reason = reason or "the script cannot be read"
            if not self._script.is_ordered:
                self._script.refuse(reason)
            return Outcome(False, f"the script is refused, and nothing has changed: {reason}")
        follows = "the script flies unless the best plan, now being made, is better at level 1: see 'heronry status'"
        return Outcome(True, f"the script leads to a legal configuration; {follows}", (TargetOrdered(target),))

    def _why_not_now(self) -> str | None:
        requests = self._requests
        if self._script.is_ordered:
            return "a script waits for the best plan: give the order again"
        if not self._deployment.is_at_rest() or (requests.is_owed and not requests.in_background):
            return "a reconfiguration is under way: give the order again when 'heronry status' shows it done"
        return None

    def _why_not_legal(self, target: Configuration) -> str | None:
        broken = verify(self._spec, self._situation.now(), target)
        return str(broken[0]) if broken else None

    def _release(self) -> Outcome:
        if not self._script.release():
            return Outcome(False, "no script is held: see 'heronry status'")
        return Outcome(True, "the script is held no longer; a better plan is sought from now on", (TargetReleased(),))

    def _what_follows(self, where_it_commands: str) -> str:
        return _ONLY_ADVISES if self._turn.silent else where_it_commands

    def _unlock(self, element: str) -> Outcome:
        pe = self._spec.pes.get(element.removeprefix("pe:"))
        if pe is None or not element.startswith("pe:"):
            sentence = f"{element} has no lock: name a PE, such as pe:{next(iter(self._spec.pes))}"
            return Outcome(False, sentence, is_unusable=True)
        if not self._has_key:
            return Outcome(False, "nothing is locked, since this manager has no key: 'heronry key' makes one")
        if self._turn.silent:
            return Outcome(False, _ONLY_ADVISES)
        told = Control(self._turn.term, pe.node_id, Operation.UNLOCK, UNLOCK_S)
        return Outcome(
            True, f"{element} is unlocked for NMT commands and SDO writes, for {UNLOCK_S} s", commands=(told,)
        )
