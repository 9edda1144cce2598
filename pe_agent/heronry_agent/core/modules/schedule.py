"""When each module is stepped: at exact multiples of its period, without bursts, and with a limit for every step.

*Releases.* A *release* is the moment at which a step of a module is due. The k-th release is k periods after the start
of the module. It is computed from k and not from the release before, so a rate of 30 Hz, whose period is not a whole
number of nanoseconds, does not drift. If several releases have passed while the PE was busy or paused, the module is
stepped once. The other releases are skipped and counted (`overruns`).

*Partitions.* Modules that are due at the same instant begin in the order of the spec. A partition receives all steps
that are due in it together, and computes them one by one. It receives no further steps before it has answered all of
these. Different partitions compute at the same time.

*Inputs from the same PE.* A module should get the newest values of other modules on its PE. So it waits for each module
whose outputs it reads and that was due just before it. The wait ends when these modules have answered, but at the
latest after a quarter of the waiting module's period. So if a module hangs or is late, the modules that read its
outputs go on without its new value. Only the other modules of its partition have to wait for it.

*Limits.* The time that a step has *spent* is its duration without the time in which it waited for a processor. So no
module is reported because the computer was overloaded or paused. The driver of the core measures this time. This file
decides when the driver measures it, and what the result means:

    overruns    OVERRUNS_IN_A_ROW steps in a row have each spent more than a period: the module cannot keep up
    hangs       one step has spent at least HUNG_NS, and at least FRESH_PERIODS periods, after which the last output of
                the module is not fresh any more. `overdue` gives the steps to measure
"""

from collections import Counter
from collections.abc import Iterator, KeysView, Mapping
from dataclasses import dataclass

from heronry_agent.core.step_times import HUNG_NS, NS_MHZ, hung_ns
from heronry_wire.sansio import NEVER_NS

OVERRUNS_IN_A_ROW = 10
_PATIENCE = 4  # a module waits for the modules whose outputs it reads, for at most 1/4 of its period


@dataclass(slots=True)
class _Grid:
    module: int
    partition: str
    rate_mhz: int
    started_ns: int
    index: int = 0  # of the next release
    due_ns: int = 0
    late_steps: int = 0  # in a row
    patience_ns: int = 0
    hung_ns: int = 0  # how much a step may spend

    def __post_init__(self) -> None:
        self.due_ns = self.started_ns
        self.patience_ns = NS_MHZ // self.rate_mhz // _PATIENCE
        self.hung_ns = hung_ns(self.rate_mhz)

    def release(self, now_ns: int) -> int:
        """Set the next release to the first one after now; returns how many releases were skipped."""
        following = self.index + 1
        index = max(following, (now_ns - self.started_ns) * self.rate_mhz // NS_MHZ)
        while self.started_ns + index * NS_MHZ // self.rate_mhz <= now_ns:
            index += 1
        self.index, self.due_ns = index, self.started_ns + index * NS_MHZ // self.rate_mhz
        return index - following


@dataclass(slots=True)
class _Step:
    """A step that has begun, and whose end the partition has not reported yet."""

    module: int
    release: int
    due_ns: int
    look_ns: int  # when to have the step measured


class Schedule:
    """Decides when each module of one PE is stepped, and which steps take too long."""

    def __init__(self) -> None:
        self._grids: dict[int, _Grid] = {}
        self._steps: dict[str, dict[int, _Step]] = {}  # by partition and module
        self._due_ns: dict[int, int] = {}  # due times of releases that `due` gave and that have not begun
        self._producers: Mapping[int, frozenset[int]] = {}
        self._releases = 0
        self._next_ns: int | None = NEVER_NS  # None: to be computed again
        self.overruns: Counter[int] = Counter()

    @property
    def next_ns(self) -> int:
        """Time in ns at which a step can begin, or an unanswered step is to be measured, whichever comes first.

        NEVER_NS if no step can begin and none is unanswered. A module cannot begin a step while its partition computes
        one.
        """
        if self._next_ns is None:
            self._next_ns = self._find_next()
        return self._next_ns

    @property
    def modules(self) -> KeysView[int]:
        """Modules that are scheduled."""
        return self._grids.keys()

    def in_partition(self, partition: str) -> list[int]:
        """Return the scheduled modules of a partition, in the order of the spec."""
        return sorted(grid.module for grid in self._grids.values() if grid.partition == partition)

    def start(self, module: int, rate_mhz: int, now_ns: int, partition: str = "") -> None:
        """Schedule a module; its first step is due now.

        rate_mhz: rate in mHz (thousandths of a Hz).
        partition: name of the partition in which the module runs.
        """
        self.stop(module)
        self._grids[module] = _Grid(module, partition, rate_mhz, now_ns)
        self._next_ns = None

    def stop(self, module: int) -> None:
        """Remove a module from the schedule; an answer that comes later is not accepted by `end`."""
        grid = self._grids.pop(module, None)
        if grid is not None:
            self._forget(grid)
        self._next_ns = None

    def renumber(self, modules: Mapping[int, int]) -> None:
        """Give the modules that go on other indices; steps under way, and their answers, stay what they are."""
        for grid in self._grids.values():
            grid.module = modules[grid.module]
        self._grids = {grid.module: grid for grid in self._grids.values()}
        for partition, steps in self._steps.items():
            self._steps[partition] = {modules[module]: step for module, step in steps.items()}
            for module, step in self._steps[partition].items():
                step.module = module
        self._due_ns = {modules[module]: due_ns for module, due_ns in self._due_ns.items() if module in modules}
        self.overruns = Counter({modules[m]: times for m, times in self.overruns.items() if m in modules})
        self._next_ns = None

    def chain(self, producers: Mapping[int, frozenset[int]]) -> None:
        """Set the modules for which each module waits: the modules on this PE whose outputs it reads.

        producers: the index of a module that waits -> the indices of the modules for which it waits.
        """
        self._producers = producers
        self._next_ns = None

    def due(self, now_ns: int) -> Iterator[int]:
        """Yield the modules that are due now: the earliest first; those due at the same time in the order of the spec.

        For each module the caller calls `begin`, or skips the step, before it takes the next module.
        """
        if now_ns < self.next_ns:
            return
        self._next_ns = None
        steps = self._steps
        grids = [grid for grid in self._grids.values() if grid.due_ns <= now_ns and grid.partition not in steps]
        if len(grids) > 1:
            grids.sort(key=lambda g: (g.due_ns, g.module))
        for grid in grids:
            if self._release_ns(grid) <= now_ns:
                self._due_ns[grid.module] = grid.due_ns
                missed = grid.release(now_ns)
                if missed:
                    self.overruns[grid.module] += missed
                yield grid.module

    def begin(self, module: int, now_ns: int) -> int:
        """Note that a step of a module begins; returns the number of the step, which the answer has to repeat."""
        self._releases += 1
        grid = self._grids[module]
        step = _Step(module, self._releases, self._due_ns.pop(module, now_ns), now_ns + grid.hung_ns)
        self._steps.setdefault(grid.partition, {})[module] = step
        self._next_ns = None
        return self._releases

    def end(self, module: int, release: int, spent_ns: int) -> bool:
        """Note that a step has been answered.

        Returns False if the module has begun no step with the number `release`, or has been stopped since.

        spent_ns: the duration of the step without the time in which it waited for a processor.
        """
        grid = self._awaiting(module, release)
        if grid is None:
            return False
        self._forget(grid)
        is_late = spent_ns * grid.rate_mhz > NS_MHZ
        grid.late_steps = grid.late_steps + 1 if is_late else 0
        self._next_ns = None
        return True

    def again(self, module: int, release: int, now_ns: int) -> bool:
        """Note that a step was not computed, and make its module due again now.

        Returns False, without an effect, if no such step has begun, or its module has been stopped since.

        release: number of the step, as `begin` has returned it.
        """
        grid = self._awaiting(module, release)
        if grid is None:
            return False
        self._forget(grid)
        grid.due_ns = min(grid.due_ns, now_ns)
        grid.index -= 1
        self._next_ns = None
        return True

    def overruns_now(self, module: int) -> bool:
        """Tell whether each of the last OVERRUNS_IN_A_ROW steps of a module has spent more than a period."""
        return self._grids[module].late_steps >= OVERRUNS_IN_A_ROW

    def overdue(self, now_ns: int) -> list[tuple[int, int]]:
        """Return (module, release) of each unanswered step that the caller must measure now.

        To measure a step is to find out how long it has taken so far. A step is measured first when the time that
        it may spend (`hung_ns`) has passed since it began, then at the time that `hangs` sets. If `hangs` is not
        called, the step is measured again after the time `hung_ns`.
        """
        found = [step for steps in self._steps.values() for step in steps.values() if step.look_ns <= now_ns]
        for step in found:
            step.look_ns = now_ns + self._grids[step.module].hung_ns
        if found:
            self._next_ns = None
        return [(step.module, step.release) for step in found]

    def hangs(self, module: int, release: int, spent_ns: int, now_ns: int) -> bool:
        """Tell whether a step that has spent `spent_ns` so far hangs, and plan when to measure it next.

        Returns False, and plans nothing, if this step is not under way.
        """
        grid = self._awaiting(module, release)
        if grid is None:
            return False
        left_ns = grid.hung_ns - spent_ns
        self._steps[grid.partition][module].look_ns = now_ns + max(left_ns, HUNG_NS // 10)
        self._next_ns = None
        return left_ns <= 0

    def _find_next(self) -> int:  # runs for each step, so it skips modules that are due later than others
        """Compute `next_ns`."""
        next_ns = NEVER_NS
        for grid in self._grids.values():
            if grid.due_ns < next_ns and grid.partition not in self._steps:
                next_ns = min(next_ns, self._release_ns(grid))
        for steps in self._steps.values():
            for step in steps.values():
                next_ns = min(next_ns, step.look_ns)
        return next_ns

    def _awaiting(self, module: int, release: int) -> _Grid | None:
        """Return the entry of a module whose step with the number `release` has begun and has no answer yet.

        None: there is no such step.
        """
        grid = self._grids.get(module)
        step = None if grid is None else self._steps.get(grid.partition, {}).get(module)
        return grid if step is not None and step.release == release else None

    def _forget(self, grid: _Grid) -> None:
        """Forget the unanswered step of a module."""
        steps = self._steps.get(grid.partition, {})
        if steps.pop(grid.module, None) is not None and not steps:
            del self._steps[grid.partition]

    def _release_ns(self, grid: _Grid) -> int:
        """Return the time (ns) at which a step may begin: when it is due, or later if it waits for what it reads."""
        producers = self._producers.get(grid.module)
        return grid.due_ns + grid.patience_ns if producers and self._waits(grid, producers) else grid.due_ns

    def _waits(self, grid: _Grid, producers: frozenset[int]) -> bool:
        """Tell whether a module still waits for at least one of `producers`, the modules whose outputs it reads."""
        earliest_ns = grid.due_ns - grid.patience_ns
        for module in producers:
            producer = self._grids.get(module)
            if producer is None:
                continue
            if earliest_ns <= producer.due_ns and (producer.due_ns, module) < (grid.due_ns, grid.module):
                return True
            step = self._steps.get(producer.partition, {}).get(module)
            if step is not None and earliest_ns <= step.due_ns <= grid.due_ns:
                return True
        return False
