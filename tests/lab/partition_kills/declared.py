"""Whether modules are restarted and given up as their spec declares: an oracle over the manager's events.

A module fails because a fault was injected into its partition, and for no other reason. Its PE builds it anew and
counts its failures, from one, as long as each comes within a minute of the one before; when its `restarts` are used up,
the next failure makes the PE give it up, and the manager plans without it. An agent that is started anew counts from
one again.

It is a failure when a module is reported without a recent fault in its partition; when a PE's count leaves a number
out, or goes on after the last restart; and when the PE gives a module up too early.

A PE repeats an EMCY until it is acknowledged: the same count may be received twice, and a count that comes meanwhile is
not sent. A partition that was stopped while it loaded its code is noticed when loading has taken too long, after 20 s.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from heronry_manager import events

LATELY_S = 30.0
FORGIVEN_S = 60.0
_DELAY_S = 5.0  # reports of two failures may be this much closer together, or further apart, than the failures


@dataclass(frozen=True, slots=True)
class Declared:
    """What the spec declares for a module."""

    partition: str
    restarts: int


@dataclass(slots=True)
class _Count:
    """A PE's reports of a failed module: the count, and the times of the first and the last report of that count."""

    times: int
    since_s: float
    until_s: float


Failure = events.ModuleRestarted | events.FaultReported


class DeclaredOracle:
    """Checks the events of one flight; `failures` are sentences."""

    def __init__(self, modules: Mapping[str, Declared]) -> None:
        self._modules = modules
        self._injected_s: dict[tuple[str, str], float] = {}  # by PE and partition
        self._counts: dict[tuple[str, str], _Count] = {}  # by PE and module
        self.failures: list[str] = []

    def injected(self, pe: str, partition: str, now_s: float) -> None:
        """Note that a partition of a PE was killed or stopped."""
        self._injected_s[pe, partition] = now_s

    def agent_killed(self, pe: str) -> None:
        """Forget the counts of this PE, since its next agent starts without them."""
        self._counts = {key: count for key, count in self._counts.items() if key[0] != pe}

    def heard(self, event: Failure, now_s: float) -> None:
        """Check an event about a module."""
        kind, _, module = event.element.partition(":")
        pe, times = event.by, event.times if isinstance(event, events.ModuleRestarted) else 0
        if kind != "module" or self._is_told_again(self._counts.get((pe, module)), times, now_s):
            return
        if now_s - self._injected_s.get((pe, self._modules[module].partition), -LATELY_S) >= LATELY_S:
            self.failures.append(f"{module} failed on {pe} without a fault injected there: {_words(event)}")
        if isinstance(event, events.ModuleRestarted):
            self._restarted(pe, module, times, now_s)
        else:
            self._given_up(pe, module, now_s)

    @staticmethod
    def _is_told_again(count: _Count | None, times: int, now_s: float) -> bool:
        """Tell whether this report repeats the last one, because its acknowledgement has not arrived."""
        if count is None or count.times != times or now_s - count.until_s > _DELAY_S:
            return False
        count.until_s = now_s
        return True

    def _restarted(self, pe: str, module: str, times: int, now_s: float) -> None:
        before = self._counts.get((pe, module), _Count(0, now_s, now_s))
        apart_s, most = now_s - before.since_s, self._modules[module].restarts
        goes_on = before.times < times and apart_s <= FORGIVEN_S + _DELAY_S
        begins_anew = times == 1 and (before.times == 0 or apart_s >= FORGIVEN_S - _DELAY_S)
        if times > most or not (goes_on or begins_anew):
            what = f"as restart {times} of {most}, after restart {before.times}"
            self.failures.append(f"{module} was restarted on {pe} {what}")
        self._counts[pe, module] = _Count(times, now_s, now_s)

    def _given_up(self, pe: str, module: str, now_s: float) -> None:
        before = self._counts.pop((pe, module), _Count(0, now_s, now_s))
        most = self._modules[module].restarts
        if before.times < most or now_s - before.since_s > FORGIVEN_S + _DELAY_S:
            self.failures.append(f"{module} was given up on {pe} after {before.times} of {most} restarts")


def _words(event: Failure) -> str:
    if isinstance(event, events.ModuleRestarted):
        return f"restarted, {event.times}"
    return f"given up, {event.code}"
