"""One mutant against the flights, in a process of its own that was forked with everything imported.

A trial flies one flight after the other and ends at the first that goes wrong: the mutant is *killed*. A flight that
takes many times the processor time of the same flight without a mutant hangs: the kernel ends it, and the mutant is
killed, as is one that exceeds the memory limit. A mutant *survives* if every flight that runs its lines goes well; if
no flight runs them it survives without being tried.

The next flight is the one that has killed most mutants for its time so far. The order changes how long a trial takes,
and which flight is named as the killer, but not which mutants are killed.

The memory of a process is lost with it, but the plans are kept: they come with the first flights (`Baseline`), and
every trial uses them, unless the planner depends on the mutated file.
"""

import gc
import os
import pickle
import resource
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from typing import Any, TypeVar

from lab.mutation.flights import Flight, Landed, Specs, fly
from lab.mutation.mutants import Mutant
from lab.mutation.mutated_import import dependents, imports_of_ours, take_in

T = TypeVar("T")

_PATIENCE, _PATIENCE_S = 8, 8.0  # limit: a factor of the time without a mutant, plus seconds
_MEMORY_BYTES = 4 << 30  # above what is in use at the fork; address space that is reserved and not used counts too
_POLITENESS = 10
_PLANNING = "heronry_tools.sim.world.planning"
_PREPARING = frozenset(("heronry_manager.core.tables.compilation", "heronry_manager.core.tables.contingency_numbers"))


@dataclass(frozen=True, slots=True)
class Baseline:
    """A flight without a mutant: how it ended, the time it took, and which lines of the cores it ran."""

    flight: Flight
    landed: Landed
    cpu_s: float
    lines: Mapping[str, frozenset[int]]  # by file, relative to the checkout


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result for a mutant; `killed_by`: the flight that went wrong, None if it survived; `how`: that failure."""

    mutant: Mutant
    killed_by: str | None
    how: str
    flown: int = 0  # flights that went well
    changed: int = 0  # of these, how many had a different frame, or a frame at a different time
    cpu_s: float = 0.0


@dataclass(slots=True)
class Record:
    """How often a flight was flown with a mutant, and how often it killed one."""

    flown: int = 0
    killed: int = 0


@dataclass(slots=True)
class Report:
    """The results that a forked process sent before it ended."""

    told: list[Any] = field(default_factory=list)
    cpu_s: float = 0.0
    signal: int = 0
    failed: bool = False  # it did not end normally


class Trials:
    """Flies flights of one checkout in forked processes, `jobs` at a time."""

    def __init__(self, checkout: Path, flights: Sequence[Flight], jobs: int) -> None:
        """Import the flight code and the simulator."""
        import coverage  # noqa: F401, PLC0415 - slow, and not for --list

        import lab.conformance.conformance_tests  # noqa: F401, PLC0415 - flight code: see head

        self._checkout, self.flights, self._jobs = checkout, flights, jobs
        self._imports = imports_of_ours()
        self._baselines: dict[Flight, Baseline] = {}
        self._records = {flight: Record() for flight in flights}
        self._specs = Specs()
        for flight in flights:
            self._specs.keep(flight, checkout)

    def baselines(self) -> Iterator[Baseline]:
        """Fly every flight without a mutant."""
        for flight, report in forked(self.flights, self._jobs, self._fly_without):
            cpu_s, landed, lines, plans = report.told or (0.0, Landed("it hangs, or its process died"), {}, b"")
            if plans:
                sys.modules[_PLANNING].KNOWN_PLANS.update(pickle.loads(plans))
            self._baselines[flight] = Baseline(flight, landed, cpu_s, lines)
            yield self._baselines[flight]

    def verdicts(self, mutants: Iterable[Mutant]) -> Iterator[Verdict]:
        """Try every mutant, after the baselines; verdicts come as trials end."""
        gc.freeze()
        for mutant, report in forked(mutants, self._jobs, self._fly_with):
            yield self._verdict(mutant, report)

    def runs(self, mutant: Mutant) -> list[Baseline]:
        """Return the flights that run a mutant's lines, the most promising one first."""
        file = str(mutant.file)
        meeting = [one for one in self._baselines.values() if mutant.is_run_by(one.lines.get(file, frozenset()))]
        return sorted(meeting, key=lambda one: one.cpu_s / self._promise(one.flight))

    def _promise(self, flight: Flight) -> float:
        record = self._records[flight]
        return (record.killed + 1) / (record.flown + 2)

    def _verdict(self, mutant: Mutant, report: Report) -> Verdict:
        """Read the results of a trial: for each flight a `Flight` at its start and a `Landed` at its end."""
        flights = [told for told in report.told if isinstance(told, Flight)]
        landed = [told for told in report.told if isinstance(told, Landed)]
        for flight in flights:
            self._records[flight].flown += 1
        killed_by, how = None, ""
        if report.failed or len(landed) < len(flights):
            killed_by = str(flights[-1]) if flights else "the import"
            how = "it hangs" if report.signal == signal.SIGPROF else "its process died"
        elif landed and landed[-1].wrong is not None:
            killed_by, how = str(flights[len(landed) - 1]), landed[-1].wrong
        if killed_by is not None and flights:
            self._records[flights[-1]].killed += 1
        before = [self._baselines[flight].landed.digest for flight in flights[: len(landed)]]
        changed = sum(one.digest != digest for one, digest in zip(landed, before, strict=True))
        return Verdict(mutant, killed_by, how, len(landed), changed, report.cpu_s)

    # In the forked process

    def _fly_without(self, flight: Flight, tell: Callable[[object], None]) -> None:
        self._specs.take_over()
        planning = sys.modules[_PLANNING]
        known = set(planning.KNOWN_PLANS)
        began_s = time.process_time()
        landed, lines = _watched(lambda: fly(flight, self._checkout), self._checkout)
        plans = {key: plan for key, plan in planning.KNOWN_PLANS.items() if key not in known}
        for told in (time.process_time() - began_s, landed, lines, pickle.dumps(plans)):
            tell(told)

    def _fly_with(self, mutant: Mutant, tell: Callable[[object], None]) -> None:
        meeting = self.runs(mutant)
        if not meeting:
            return
        self._specs.take_over()
        self._mutate(mutant)
        for baseline in meeting:
            tell(baseline.flight)
            signal.setitimer(signal.ITIMER_PROF, _PATIENCE_S + _PATIENCE * baseline.cpu_s)
            landed = fly(baseline.flight, self._checkout)
            tell(landed)
            if landed.wrong is not None:
                return

    def _mutate(self, mutant: Mutant) -> None:
        file = self._checkout / mutant.file
        name = ".".join(mutant.file.with_suffix("").parts[1:])
        forgotten = dependents(name, self._imports)
        before = vars(sys.modules[_PLANNING])
        take_in(name, file, mutant.applied_to(file.read_bytes()), forgotten)
        from heronry_tools.sim.world import planning  # noqa: PLC0415 - flight code: see head

        if "heronry_manager.planner.exact" not in forgotten:
            planning.KNOWN_PLANS.update(before["KNOWN_PLANS"])
        if not _PREPARING & forgotten:
            planning.PREPARED.update(before["PREPARED"])


def _watched(do: Callable[[], T], checkout: Path) -> tuple[T, dict[str, frozenset[int]]]:
    """Call a function; gives its result and the lines of the cores that it ran."""
    from coverage import Coverage  # noqa: PLC0415 - a development dependency

    from lab.mutation.flight_code import core_files  # noqa: PLC0415 - flight code: see head

    files = {str(checkout / file): str(file) for file in core_files(checkout)}
    watch = Coverage(data_file=None, config_file=False, include=list(files))
    watch.start()
    try:
        done = do()
    finally:
        watch.stop()
    data = watch.get_data()
    return done, {files[file]: frozenset(data.lines(file) or ()) for file in data.measured_files()}


def forked(
    tasks: Iterable[T], jobs: int, do: Callable[[T, Callable[[object], None]], None]
) -> Iterator[tuple[T, Report]]:
    """Do every task in a process of its own, `jobs` at a time; gives each report when its process has ended."""
    running: dict[int, tuple[T, int, bytearray]] = {}  # by the reading end of the pipe
    waiting = iter(tasks)
    with DefaultSelector() as selector:
        try:
            while True:
                while len(running) < jobs and (task := next(waiting, None)) is not None:
                    pipe, pid = _fork(task, do)
                    running[pipe] = task, pid, bytearray()
                    selector.register(pipe, EVENT_READ)
                if not running:
                    return
                for key, _ in selector.select():
                    task, pid, told = running[key.fd]
                    data = os.read(key.fd, 1 << 16)
                    told += data
                    if not data:
                        selector.unregister(key.fd)
                        os.close(key.fd)
                        del running[key.fd]
                        yield task, _ended(pid, told)
        finally:
            for pipe, (_, pid, _) in running.items():
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
                os.close(pipe)


def _fork(task: T, do: Callable[[T, Callable[[object], None]], None]) -> tuple[int, int]:
    """Start a process that does a task; gives the reading end of its pipe, and its process number."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid:
        os.close(writing)
        return reading, pid
    code = 1
    try:
        _settle_in(reading)
        with os.fdopen(writing, "wb") as pipe:

            def tell(told: object) -> None:
                pickle.dump(told, pipe)
                pipe.flush()

            do(task, tell)
        code = 0
    finally:
        os._exit(code)


def _settle_in(reading: int) -> None:
    """Give this process a low priority, no terminal, and a limit of memory."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.nice(_POLITENESS)
    most_bytes = _address_space_bytes() + _MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))
    os.close(reading)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(nowhere, stream)


def _address_space_bytes() -> int:
    """Return the address space of this process: a solver's threads reserve some gigabytes."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()


def _ended(pid: int, told: bytearray) -> Report:
    """Wait for a process that has closed its pipe, and read its results; the last one may be incomplete."""
    _, status, used = os.wait4(pid, 0)
    signalled = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    report = Report(cpu_s=used.ru_utime + used.ru_stime, signal=signalled, failed=status != 0)
    words = BytesIO(told)
    with suppress(EOFError, pickle.UnpicklingError):
        while True:
            report.told.append(pickle.load(words))
    return report
