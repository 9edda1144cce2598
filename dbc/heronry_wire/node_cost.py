"""What a node costs its computer: how often it wakes, the processor time that it uses, and its longest turn.

The driver of an agent meters its loop by `CostMeter`, in windows of WINDOW_NS. The PE shows the last whole window as
object 2023h; the manager reads the object for the status. Nothing is decided by it.

A *turn* lasts from a wake-up until the loop waits again. The time in which the computer runs something else
counts, too.
"""

from collections.abc import Callable
from dataclasses import dataclass

WINDOW_NS = 10_000_000_000
_NS_PER_S = 1_000_000_000
_NS_PER_US = 1_000


@dataclass(frozen=True, slots=True)
class NodeCost:
    """The cost of a node in one window.

    wake_ups_per_s: turns of the agent's loop.
    agent_per_mille: processor time of the agent's process, in per mille of one core.
    modules_per_mille: the same of the processes of its partitions and drivers.
    longest_turn_us: longest turn of the agent's loop.
    """

    wake_ups_per_s: int
    agent_per_mille: int
    modules_per_mille: int
    longest_turn_us: int

    @property
    def sentence(self) -> str:
        """These figures for people."""
        shares = f"{self.agent_per_mille / 10:g} % of a core, its modules {self.modules_per_mille / 10:g} %"
        return f"{self.wake_ups_per_s} wake-ups/s, {shares}, longest turn {self.longest_turn_us / 1000:g} ms"


class CostMeter:
    """Meters a loop; it has no clock, and gets all times from the loop."""

    def __init__(self, now_ns: int, agent_ns: Callable[[], int], modules_ns: Callable[[], int]) -> None:
        """Begin the first window.

        agent_ns: returns the processor time of the agent's process so far.
        modules_ns: the same of all processes of partitions and drivers; it falls when one of them ends.
        """
        self._agent_ns, self._modules_ns = agent_ns, modules_ns
        self._last: NodeCost | None = None
        self._woke_ns = now_ns
        self._wake_ups, self._longest_ns = 0, 0
        self._begin(now_ns)

    @property
    def last(self) -> NodeCost | None:
        """The cost in the last whole window; None: there is none yet."""
        return self._last

    def woke(self, now_ns: int) -> None:
        """Note that the loop has woken."""
        self._woke_ns = now_ns
        self._wake_ups += 1

    def waits(self, now_ns: int) -> None:
        """Note that the loop begins to wait."""
        turn_ns = now_ns - self._woke_ns
        self._longest_ns = max(self._longest_ns, turn_ns)
        if now_ns >= self._end_ns:
            self._end_window(now_ns)

    def _begin(self, now_ns: int) -> None:
        self._begun_ns, self._end_ns = now_ns, now_ns + WINDOW_NS
        self._wake_ups = self._longest_ns = 0
        self._used_ns = self._agent_ns(), self._modules_ns()

    def _end_window(self, now_ns: int) -> None:
        window_ns, (agent_ns, modules_ns) = now_ns - self._begun_ns, self._used_ns
        wake_ups, longest_ns = self._wake_ups, self._longest_ns
        self._begin(now_ns)
        agent_now_ns, modules_now_ns = self._used_ns
        self._last = NodeCost(
            wake_ups * _NS_PER_S // window_ns,
            (agent_now_ns - agent_ns) * 1000 // window_ns,
            max(0, modules_now_ns - modules_ns) * 1000 // window_ns,
            longest_ns // _NS_PER_US,
        )
