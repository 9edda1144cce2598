"""Each priority that the manager announces was ordered, or was requested within its range and not too soon.

The oracle works from frames and from the operator's orders. The active manager announces a changed priority in HOLDS.
It announces in CLEAR that a function has the priority of the spec again. All other oracles use the announced priority
(`current`). The announced priority must be one of these:

- the priority that the operator has ordered last for the function. While an order stands, no request counts;
- a priority that a PE has requested (EMCY, PRIORITY_REQUEST), within the `priority_range` of the spec. Within one term,
  two changes that PEs have requested are at least `_CHANGE_NS` apart;
- the priority of the spec, if the operator has ordered it or a PE has requested it.

There are two exceptions:

1. For T_lease after an order, an older HOLDS may still be on its way. So during this time no announcement about the
   function is a violation.
2. At the start of a mastership the manager knows what it has in its journal, or has heard as a standby manager. So its
   first announcement about a function in a term may be any priority that was ever ordered or requested. This
   announcement does not count as a change: a requested change may follow immediately.

The time between two changes is measured by the manager's clock. If this clock jumps ahead, the jump is a part of that
time.
"""

from collections.abc import Callable, Mapping

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import Control, ElementKind, Emergency, ManagementMessage, Operation

_CHANGE_NS = 950_000_000  # a second, less the time that a frame may wait on its way
_OF_THE_SPEC, _ORDERED = 0xFFFF, 0x8000


class PriorityCheck(Oracle):
    """Records ordered and requested priorities, and verifies those that the manager announces."""

    def __init__(self, spec: Spec, changed: Callable[[int, Mapping[str, int]], None]) -> None:
        """Begin with the priorities of the spec; `changed` gets the time (ns) and changed priorities by function."""
        super().__init__()
        self.current: dict[str, int] = {}
        self._functions, self._changed = list(spec.functions.values()), changed
        self._on_its_way_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns
        self._asked: dict[str, set[int]] = {}  # by function: all that PEs have requested
        self._orders: dict[str, list[int]] = {}  # by function: all orders, the last one last
        self._ordered_ns: dict[str, int] = {}
        self._stands: dict[str, bool] = {}  # whether the last order is for another priority than that of the spec
        self._last: dict[int, int] = {}  # by term: when a change that a PE has requested was announced last
        self._jumps: list[tuple[int, int]] = []  # of the clock of any manager: when, and by how much
        self._told_in: dict[str, int] = {}  # by function: the term in which a change was announced last
        self._term = 0

    def take_over(self, before: "PriorityCheck") -> None:
        """Take over what the oracle of another spec knows of the functions with the same names."""
        there = {function.name for function in self._functions}
        self.current = {name: one for name, one in before.current.items() if name in there}
        self._asked = {name: asked for name, asked in before._asked.items() if name in there}
        self._orders = {name: orders for name, orders in before._orders.items() if name in there}
        self._ordered_ns = {name: t_ns for name, t_ns in before._ordered_ns.items() if name in there}
        self._stands = {name: stands for name, stands in before._stands.items() if name in there}
        self._told_in = {name: term for name, term in before._told_in.items() if name in there}
        self._last, self._jumps, self._term = before._last, before._jumps, before._term

    def set_priority(self, t_ns: int, function: str, priority: int | None) -> None:
        """Record that the manager has accepted the operator's order for a priority.

        A `priority` of None is the priority of the spec.
        """
        self._orders.setdefault(function, []).append(_OF_THE_SPEC if priority is None else priority)
        self._ordered_ns[function], self._stands[function] = t_ns, priority is not None

    def manager_jumped(self, t_ns: int, ahead_ns: int) -> None:
        """Record that the clock of a manager has jumped ahead."""
        self._jumps.append((t_ns, ahead_ns))

    def wanted_priority(self, message: Emergency) -> None:
        """Record that a PE requests a priority."""
        function = self._functions[message.index >> 8].name
        self._asked.setdefault(function, set()).add(message.detail)

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Verify a HOLDS or CLEAR that announces a priority."""
        if not isinstance(message, Control) or message.a & 0xFF != ElementKind.PRIORITY or message.term < self._term:
            return
        self._term, function = message.term, self._functions[message.a >> 8].name
        if message.operation is Operation.HOLDS:
            self._tell(t_ns, function, message.b & ~_ORDERED, is_ordered=bool(message.b & _ORDERED))
        elif message.operation is Operation.CLEAR and function in self.current:
            self._tell(t_ns, function, _OF_THE_SPEC, is_ordered=self._orders.get(function, [])[-1:] == [_OF_THE_SPEC])

    def _tell(self, t_ns: int, function: str, priority: int, *, is_ordered: bool) -> None:
        if self.current.get(function, _OF_THE_SPEC) == priority:
            return
        is_first = self._told_in.get(function) != self._term
        self._told_in[function] = self._term
        why_not = (
            self._order(function, priority, is_first=is_first)
            if is_ordered
            else self._request(t_ns, function, priority, is_first=is_first)
        )
        if why_not is not None and t_ns - self._ordered_ns.get(function, -self._on_its_way_ns) > self._on_its_way_ns:
            word = "of the spec" if priority == _OF_THE_SPEC else priority
            self.violations.append(Violation(t_ns, "priorities", f"priority {word} of {function}: {why_not}"))
        self.current.pop(function, None)
        self.current |= {function: priority} if priority != _OF_THE_SPEC else {}
        self._changed(t_ns, dict(self.current))

    def _order(self, function: str, priority: int, *, is_first: bool) -> str | None:
        orders = self._orders.get(function, [])
        may_be = orders if is_first else orders[-1:]
        return None if priority in may_be else f"the operator's orders were {orders}"

    def _request(self, t_ns: int, function: str, priority: int, *, is_first: bool) -> str | None:
        bounds = next(one.priority_range for one in self._functions if one.name == function)
        since_ns = _CHANGE_NS
        if not is_first:
            before_ns, self._last[self._term] = self._last.get(self._term, -_CHANGE_NS), t_ns
            since_ns = t_ns - before_ns + sum(ahead_ns for at_ns, ahead_ns in self._jumps if at_ns >= before_ns)
        if priority not in self._asked.get(function, ()):
            return "no PE has requested it"
        if bounds is None or (priority != _OF_THE_SPEC and not bounds[0] <= priority <= bounds[1]):
            return f"its range is {bounds}"
        if self._stands.get(function):
            return "the operator's order stands"
        return f"changed after {since_ns / 1e6:.0f} ms" if since_ns < _CHANGE_NS else None
