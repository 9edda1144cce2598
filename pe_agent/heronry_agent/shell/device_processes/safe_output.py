"""Decides what an actuator does at each moment: the newest command, its limits, its end of validity, the safe action.

    driving   executes the newest command, inside `limits` and not faster than `rate_limit`
    safe      has taken the safe action. Only a command that is newer than all before makes it drive again

driving becomes safe when the command's end of validity has passed, when the command is an order to be safe, or when a
value has lasted as long as the driver allows (`lasts_ms`). This state machine knows no clock and no device; the process
asks it what to do, does it, and tells that it was done.
"""

from collections.abc import Callable
from dataclasses import dataclass

from heronry_agent.module import Value
from heronry_agent.shell.device_processes.judgement import is_inside
from heronry_agent.shell.device_processes.shared_block import Entry
from heronry_wire.sansio import NEVER_NS

_STEP_NS = 5_000_000  # between two steps of a limited change
_LONGEST_STEP_NS = 4 * _STEP_NS  # after a pause a change goes on, and does not catch up
_NS_PER_S = 1_000_000_000
Lasts = Callable[[float], int | None]


@dataclass(frozen=True, slots=True)
class Move:
    """Write this value."""

    value: float


@dataclass(frozen=True, slots=True)
class TakeSafeAction:
    """Take the safe action; `reason` is a sentence for the log, empty if it was ordered."""

    reason: str = ""


@dataclass(frozen=True, slots=True)
class OutputLimits:
    """`limits` and `rate_limit` of an actuator."""

    least: float | None = None
    most: float | None = None
    per_s: float | None = None

    def clipped(self, value: float) -> float:
        """Return the value of the range that is nearest to a command."""
        raised = value if self.least is None else max(value, self.least)
        return raised if self.most is None else min(raised, self.most)


class SafeOutput:
    """The state of one actuator."""

    def __init__(self, limits: OutputLimits, *, begun_anew: bool = False) -> None:
        """Begin safe; the process takes the safe action before it asks for the first time.

        begun_anew: a process before this one has had commands. For how long its last value has lasted is not known, so
            it counts as too long.
        """
        self._limits = limits
        self._is_driving = False
        self._done = 0  # number of the newest command that was taken up, or refused
        self._goal = 0.0
        self._position: float | None = None  # as last written; None: unknown, so the first command is not slowed down
        self._moved_ns = 0
        self._spent_until_ns: int | None = None  # when the present value has lasted long enough
        self._is_spent = begun_anew  # a value has lasted too long: wait for one that may last

    @property
    def done(self) -> int:
        """Number of the newest command that was taken up, or refused."""
        return self._done

    @property
    def is_driving(self) -> bool:
        """Tell whether a command is being executed, so that the safe action is still to come."""
        return self._is_driving

    def next_deadline_ns(self, until_ns: int) -> int:
        """Time in ns at which to ask again, if no command comes before; `until_ns`: end of validity."""
        if not self._is_driving:
            return NEVER_NS
        deadlines = [until_ns + 1, self._spent_until_ns or NEVER_NS]
        if self._position != self._goal:
            deadlines.append(self._moved_ns + _STEP_NS)
        return min(deadlines)

    def decide(self, entry: Entry | None, until_ns: int, now_ns: int, lasts_ns: Lasts) -> Move | TakeSafeAction | None:
        """Return what to do now; None: nothing.

        entry: the newest command; None if there is none yet, or if it cannot be read.
        until_ns: end of validity of the newest command.
        lasts_ns: how long the driver lets a value last, in ns; None: without end.
        """
        if self._is_driving and now_ns > until_ns:
            return self._become_safe(entry, "the end of validity of its command has passed")
        if self._spent_until_ns is not None and now_ns >= self._spent_until_ns:
            self._is_spent = True
            return self._become_safe(entry, "it has been on for its longest time")
        if entry is not None and entry.number > self._done:
            self._done = entry.number
            if entry.value is None:
                return self._become_safe(entry, "")
            return self._take_up(entry.value, until_ns, now_ns, lasts_ns)
        if self._is_driving and self._position != self._goal and now_ns >= self._moved_ns + _STEP_NS:
            return Move(self._next_position(now_ns))
        return None

    def moved(self, value: float, now_ns: int) -> None:
        """Note that a value was written, by a `Move` or as the safe action."""
        self._position, self._moved_ns = value, now_ns

    def released(self) -> None:
        """Note that the actuator was released: where it is, nobody knows."""
        self._position = None

    def _take_up(self, value: Value, until_ns: int, now_ns: int, lasts_ns: Lasts) -> Move | None:
        if not isinstance(value, (int, float)) or not is_inside(value, None, None) or now_ns > until_ns:
            return None
        goal = self._limits.clipped(float(value))
        span_ns = lasts_ns(goal)
        if span_ns is None:
            self._is_spent, self._spent_until_ns = False, None
        elif self._is_spent:
            return None
        elif self._spent_until_ns is None:
            self._spent_until_ns = now_ns + span_ns
        self._goal, self._is_driving = goal, True
        return Move(self._next_position(now_ns))

    def _next_position(self, now_ns: int) -> float:
        if self._limits.per_s is None or self._position is None:
            return self._goal
        most = self._limits.per_s * min(now_ns - self._moved_ns, _LONGEST_STEP_NS) / _NS_PER_S
        way = self._goal - self._position
        return self._goal if abs(way) <= most else self._position + (most if way > 0 else -most)

    def _become_safe(self, entry: Entry | None, reason: str) -> TakeSafeAction:
        self._is_driving, self._spent_until_ns = False, None
        if entry is not None and reason and not self._is_spent:
            self._done = max(self._done, entry.number)  # an expired command is not executed when its time is renewed
        return TakeSafeAction(reason)
