"""Which functions have another priority than the spec gives them, and what may change it.

The priority of a function is the *spec's*, or *requested* by a module, or *ordered* by the operator:

    the operator    may set any priority of any function. The order stands until the operator ends it
    a module        may set a priority within the function's `priority_range`: its PE sends a request
                    (EMCY, PRIORITY_REQUEST). The last request counts

A change has the same consequences as a fault: a new plan and a new epoch. The criticality of the function
does not change. What the active manager does:

- An order: the priority changes without waiting time, to the ordered one or back to the spec's.
- A request that would change a priority, and comes less than CHANGE_NS after a request has changed the
  priority of this or another function: it is neither executed nor acknowledged. The PE repeats it, so the
  last of several requests is executed when the time is over.
- A request outside the range, or against the operator's order: it is acknowledged and refused, with an
  event that names the PE.
- Any other request: the priority changes, and the request is acknowledged.

A PE repeats a request until it is acknowledged, so a pause of the manager loses no request. The PE counts
its requests for each function from its start on, and a request carries its number. A request with a number
that the manager knows, or with an older one, is acknowledged and has no further effect. A manager that
restarts remembers priorities and numbers. A forged request can change a priority only within the spec's
range; an order of the operator prevents even that.

The active manager announces its facts in turn (`announcing`). So a standby manager hears each changed
priority (CONTROL, HOLDS), the end of a change (CLEAR), and which requests were executed. It drops a changed
priority that was not announced while all facts had their turn three times.
"""

from collections import Counter
from typing import Final

from heronry_dg.model import Function, Spec
from heronry_manager import events
from heronry_manager.core.memory import PriorityChanged, PriorityRequest, PriorityRestored
from heronry_manager.core.turn import Turn
from heronry_manager.events.situation import Priority
from heronry_wire.management import (
    BY_OPERATOR,
    MOST_FUNCTIONS,
    PRIORITY_REQUEST_NUMBERS,
    SPECS_PRIORITY,
    Control,
    ElementKind,
    Emergency,
    Operation,
)
from heronry_wire.sansio import NEVER_NS

CHANGE_NS = 1_000_000_000
_OPERATOR = "the operator"
_DEFAULT: Final = "default"  # the priority of the spec, in events


Fact = tuple[Operation, int, int]
"""What the active manager announces: operation, a and b of CONTROL."""


class ChangedPriorities:
    """Keeps the priorities that differ from those of the spec, and decides on requests to change them."""

    def __init__(self, spec: Spec, turn: Turn) -> None:
        """Begin with the changed priorities and the requests that are remembered over a restart."""
        self._turn = turn
        self._functions = list(spec.functions.values())[:MOST_FUNCTIONS]
        self._index = {function.name: index for index, function in enumerate(self._functions)}
        self._changed: dict[str, PriorityChanged] = dict(turn.memory.priorities)
        self._last = {key: (one.incarnation, one.number) for key, one in turn.memory.priority_requests.items()}
        self._requested_ns = -NEVER_NS  # when a request has changed a priority
        self._untold: Counter[str] = Counter()  # beats since another manager announced a priority
        self._told_function: int | None = None  # the function whose priority another manager has just told

    def now(self) -> dict[str, int]:
        """Return the present priority of each function whose priority differs from the spec's."""
        return {name: one.priority for name, one in self._changed.items()}

    def all(self) -> list[PriorityChanged]:
        """List the priorities that differ from the spec's, each with its origin (operator or module)."""
        return list(self._changed.values())

    def facts(self) -> list[Fact]:
        """List the facts for a standby manager, each as operation, a and b of a CONTROL.

        There is a fact for each function whose priority is changed, or for which a request was executed.
        """
        functions = {*self._changed, *(function for _, function in self._last)}
        return [self.told(index) for index in sorted(map(self.index_of, functions))]

    def accepted(self, index: int) -> list[PriorityRequest]:
        """Return, for each PE, the last executed request for the priority of the function with this index."""
        name = self._functions[index].name
        return [one for (_, function), one in self._turn.memory.priority_requests.items() if function == name]

    def told(self, index: int) -> Fact:
        """Return the CONTROL that announces the priority of a function with this index, as operation, `a` and `b`."""
        changed = self._changed.get(self._functions[index].name)
        # CLEAR tells the priority of the spec
        return (Operation.CLEAR, _place(index), 0) if changed is None else _held(index, changed)

    # Requests and orders

    def can_change(self, function: str) -> bool:
        """Tell whether CONTROL can name the function: only the spec's first MOST_FUNCTIONS functions have an index."""
        return function in self._index

    def index_of(self, function: str) -> int:
        """Return the index of a function in CONTROL and in requests."""
        return self._index[function]

    def order(self, function: str, priority: int | None) -> str | None:
        """Set the priority of a function by an order of the operator; None: the spec's priority again.

        Gives the cause of a new plan, or None if nothing changes.
        """
        if priority is None:
            return self._restore(function, _OPERATOR)
        return self._change(PriorityChanged(function, priority, by_operator=True), _OPERATOR)

    def requested(self, pe: str, incarnation: int, request: Emergency) -> list[str] | None:
        """Decide on a PE's request for a priority; gives the causes of a new plan.

        An empty list: the request is acknowledged, but changes no priority. None: it must not be acknowledged,
        so that the PE repeats it.
        """
        index, number = divmod(request.index, PRIORITY_REQUEST_NUMBERS)
        if index >= len(self._functions):
            return None
        function = self._functions[index]
        if not self._is_new(pe, incarnation, function.name, number):
            return []
        why_not = self._refusal(function, request.detail)
        is_change = why_not is None and self._differs(function.name, request.detail)
        if is_change and self._turn.now_ns - self._requested_ns < CHANGE_NS:
            return None
        self._accept(pe, incarnation, function.name, number)
        if why_not is not None:
            wanted: Priority = _DEFAULT if request.detail == SPECS_PRIORITY else request.detail
            self._turn.emit(events.PriorityRefused, function=function.name, priority=wanted, by=pe, why=why_not)
        if not is_change:
            return []
        self._requested_ns = self._turn.now_ns
        change = self._execute(function.name, request.detail, pe)
        return [] if change is None else [change]

    def _refusal(self, function: Function, priority: int) -> str | None:
        """Say why a request for this priority is refused; None: it is accepted."""
        held, bounds = self._changed.get(function.name), function.priority_range
        if bounds is None:
            return "the spec gives it no priority_range"
        if priority != SPECS_PRIORITY and not bounds[0] <= priority <= bounds[1]:
            return f"its priority_range is {bounds[0]} to {bounds[1]}"
        if held is not None and held.by_operator:
            return f"the operator has set {held.priority}"
        return None

    def _differs(self, function: str, priority: int) -> bool:
        held = self._changed.get(function)
        return (SPECS_PRIORITY if held is None else held.priority) != priority

    def _execute(self, function: str, priority: int, by: str) -> str | None:
        if priority == SPECS_PRIORITY:
            return self._restore(function, by)
        return self._change(PriorityChanged(function, priority, by_operator=False), by)

    def _change(self, changed: PriorityChanged, by: str) -> str | None:
        before = self._changed.get(changed.function)
        self._untold[changed.function] = 0
        if before == changed:
            return None
        self._changed[changed.function] = changed
        self._turn.keep(changed)
        return self._emit(changed.function, before, changed, by)

    def _restore(self, function: str, by: str) -> str | None:
        before = self._changed.pop(function, None)
        if before is None:
            return None
        self._turn.keep(PriorityRestored(function))
        return self._emit(function, before, None, by)

    def _emit(self, function: str, before: PriorityChanged | None, after: PriorityChanged | None, by: str) -> str:
        was: Priority = _DEFAULT if before is None else before.priority
        now: Priority = _DEFAULT if after is None else after.priority
        self._turn.emit(events.PriorityChanged, function=function, priority=now, before=was, by=by)
        return f"priority {now} of {function}, requested by {by}"

    def _is_new(self, pe: str, incarnation: int, function: str, number: int) -> bool:
        last_incarnation, last = self._last.get((pe, function), (incarnation, number - 1))
        behind = (last - number) % PRIORITY_REQUEST_NUMBERS
        return incarnation != last_incarnation or behind >= PRIORITY_REQUEST_NUMBERS // 2

    def _accept(self, pe: str, incarnation: int, function: str, number: int) -> None:
        self._last[pe, function] = incarnation, number
        self._turn.keep(PriorityRequest(pe, incarnation, function, number))

    # What another manager tells

    def overheard(self, manager: int, told: Control) -> list[str] | None:
        """Take over a priority that the active manager announces; gives the causes of a new plan.

        Gives no cause if the priority does not change or the function is not known, and None if the CONTROL is not
        about a priority.
        """
        kind, index = told.a & 0xFF, told.a >> 8
        is_priority = kind == ElementKind.PRIORITY and told.operation in (Operation.HOLDS, Operation.CLEAR)
        self._told_function = index if is_priority and index < len(self._functions) else None
        if not is_priority or self._told_function is None:
            return [] if is_priority else None
        function, by = self._functions[index].name, f"manager {manager}"
        if told.operation is Operation.CLEAR:
            change = self._restore(function, by)
        else:
            ordered = bool(told.b & BY_OPERATOR)
            change = self._change(PriorityChanged(function, told.b & ~BY_OPERATOR, ordered), by)
        return [] if change is None else [change]

    def answered(self, pe: str, incarnation: int, index: int) -> None:
        """Note that the active manager has acknowledged a PE's request for the priority of a function.

        If the active manager has announced the priority of the same function immediately before, it has executed
        the request. Then the number of the request is remembered.

        index: index of the function and number of the request, in one number as in CONTROL.
        """
        function, number = divmod(index, PRIORITY_REQUEST_NUMBERS)
        name = self._functions[function].name if function < len(self._functions) else ""
        if function == self._told_function and self._is_new(pe, incarnation, name, number):
            self._accept(pe, incarnation, name, number)

    def held_no_longer(self, longest_beats: int) -> list[str]:
        """Count a beat of the active manager, and drop each priority that it has ceased to announce.

        A priority that was not announced for more than `longest_beats` beats becomes that of the spec again. Gives one
        cause of a new plan for each priority that was dropped.
        """
        self._untold = Counter({name: self._untold[name] + 1 for name in self._changed})
        late = [name for name, beats in self._untold.items() if beats > longest_beats]
        changes = [self._restore(name, "the active manager, which no longer announces it") for name in late]
        return [change for change in changes if change is not None]


def _held(index: int, one: PriorityChanged) -> Fact:
    return Operation.HOLDS, _place(index), one.priority | (BY_OPERATOR if one.by_operator else 0)


def _place(index: int) -> int:
    return ElementKind.PRIORITY | index << 8
