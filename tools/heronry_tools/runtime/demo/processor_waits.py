"""How long the processes of a demo have waited for a processor.

In a demo each process stands for a computer of its own. When other programs keep the processors of this computer busy,
a process of the demo waits for a processor. If it waits too long, the other nodes count its node as lost, although
nothing has failed. When a PE is lost, the demo can say how long the PE's process waited. The agent itself reports this
standstill on the bus, but only later.

The kernel adds up these waits for each process (`/proc/PID/schedstat`, second number, in ns). It adds a wait when the
wait has ended.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

_LOOK_AGAIN_NS = 50_000_000
_PROC = Path("/proc")


@dataclass(frozen=True, slots=True)
class Wait:
    """How long a process has waited for a processor: for `for_ns` in all, within the last `of_ns`.

    who: name of the process: 'pe:NAME', 'manager NODE', or 'bus NAME'.
    """

    who: str
    for_ns: int
    of_ns: int


class ProcessorWaits:
    """Samples how long processes have waited for a processor.

    The caller passes in all times, in ns of one clock.
    """

    def __init__(self, window_ns: int, proc: Path = _PROC) -> None:
        """Begin without samples.

        window_ns: how far back `longest` looks.
        proc: the folder in which the kernel shows the processes.
        """
        self._window_ns, self._proc = window_ns, proc
        self._samples: deque[tuple[int, Mapping[int, int]]] = deque()  # time, waits so far by process number

    def look(self, now_ns: int, processes: Mapping[str, int]) -> None:
        """Sample how long each of these processes has waited for a processor.

        No effect within 50 ms after the last sample.

        processes: name of a process -> its process number.
        """
        if self._samples and now_ns - self._samples[-1][0] < _LOOK_AGAIN_NS:
            return
        self._samples.append((now_ns, {number: self._waited_ns(number) for number in processes.values()}))
        while len(self._samples) > 1 and self._samples[1][0] <= now_ns - self._window_ns:
            self._samples.popleft()

    def longest(self, now_ns: int, pe: str, processes: Mapping[str, int]) -> Wait:
        """Return the longest wait that may have made a PE silent: that of its process, of a manager or of a bus.

        The waits of a process are added up from the newest sample that is at least `window_ns` old; if there is none,
        from the first sample. If the demo's own process had to wait, it took no samples meanwhile, so the sample may be
        much older than `window_ns`.
        """
        began_ns, before = self._samples[0] if self._samples else (now_ns, {})
        of_ns = now_ns - began_ns
        waits = [
            Wait(who, self._waited_ns(number) - before[number], of_ns)
            for who, number in processes.items()
            if number in before and (who == f"pe:{pe}" or not who.startswith("pe:"))
        ]
        return max(waits, key=lambda wait: wait.for_ns, default=Wait(f"pe:{pe}", 0, of_ns))

    def _waited_ns(self, number: int) -> int:
        """Return the time in ns for which a process has waited for a processor since its start.

        Returns 0 if the process has ended, or the kernel does not count this time.
        """
        try:
            return int((self._proc / str(number) / "schedstat").read_text().split()[1])
        except (OSError, ValueError, IndexError):
            return 0
