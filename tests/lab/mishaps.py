"""Mishaps in random order, on real processes: after each the aircraft serves again what it served at the start.

    python -m lab.mishaps [SPEC] [--seed 1] [--count 60] [--heartbeat-ms 200] [--clock] [--json]

An aircraft with two managers flies on the software bus. A mishap kills or stops a PE, kills or stops the active
manager, stops its planner's process, or lets every disk refuse every write (RLIMIT_FSIZE of all nodes is 0); with
`--clock` it may also set the clock of the day, which needs root and a Linux of its own (tools/with-vcan starts one).
Each mishap lasts for a drawn time; then what was killed is started again, and what was stopped goes on. All of it is
drawn from the seed before the flight; the times at which processes react are not the same in each flight.

Verified, from the frames on the manager's bus (`heronry_tools.runtime.witness`): every function that was heard at the
start is heard again within PATIENCE_S of the end of a mishap; no two branches of a DEMUX are driven in turn; and after
the flight no process, socket or folder of it is left. Exit code 1 otherwise.
"""

import argparse
import json
import os
import resource
import select
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from heronry_manager.core.vocabulary import ClearElement
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_place import ControlError
from heronry_tools.console.errors import UserError, exit_code
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.witness import Witness
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER
from lab.benches.fleets import Aircraft, aircraft
from lab.benches.processes import children
from lab.slow_spec import slow_spec

PATIENCE_S = 60.0
HEARD_S = 2.0  # functions are heard again when all of them have been heard for so long
KINDS = ("PE killed", "PE stopped", "manager killed", "manager stopped", "planner stopped", "disks full")
CLOCK = "clock set"
_HOUR_S = 3_600


@dataclass(frozen=True, slots=True)
class Mishap:
    """One mishap. `pe`: the PE that it hits, if it hits one; `rest_s`: quiet time before it; `step_s`: of the clock."""

    kind: str
    pe: str
    length_s: float
    rest_s: float
    step_s: int


def drawn(seed: int, count: int, pes: Sequence[str], kinds: Sequence[str] = KINDS) -> list[Mishap]:
    """Draw the mishaps of a flight."""
    random = Random(seed)
    return [
        Mishap(
            kind=random.choice(kinds),
            pe=random.choice(pes),
            length_s=round(random.uniform(0.1, 3.0), 2),
            rest_s=round(random.uniform(0.0, 1.0), 2),
            step_s=random.choice((-2 * _HOUR_S, _HOUR_S, 24 * 365 * _HOUR_S)),
        )
        for _ in range(count)
    ]


class Flight:
    """One aircraft with two managers, and what was heard on its main bus."""

    def __init__(self, flown: Aircraft, ear: Ear) -> None:
        self._flown, self._fleet, self._ear = flown, flown.fleet, ear
        self.witness = Witness(flown.spec)
        self._streams: dict[int, EventStream] = {}
        self._expected: list[str] = []

    def begin(self) -> str | None:
        """Start all processes; gives a sentence where no function is served."""
        for node in (FIRST_MANAGER, LAST_MANAGER):
            self._start_manager(node)
        self._flown.start_pes()
        self._comes_true(lambda: any(map(self._served, self._flown.spec.functions)))
        self._listen(PATIENCE_S / 6)
        self._expected = [name for name in self._flown.spec.functions if self._served(name)]
        return None if self._expected else f"no function is served at the start: {self._fleet.last_words('manager')}"

    def suffer(self, mishap: Mishap) -> tuple[float, str | None]:
        """Let a mishap happen and end; gives the time until all is served again, and a sentence where it is not."""
        self._listen(mishap.rest_s)
        heal = self._begin(mishap)
        self._listen(mishap.length_s)
        heal()
        ended_s = time.monotonic()
        for node in [node for node, stream in self._streams.items() if stream.has_ended]:
            self._streams.pop(node)
            self._fleet.kill_manager(node)  # it has ended by itself: the other one manages
            self._start_manager(node)
        since_s = ended_s

        def is_served() -> bool:
            nonlocal since_s
            if not all(map(self._served, self._expected)):
                since_s = time.monotonic()
            return time.monotonic() - since_s >= HEARD_S

        back = self._comes_true(is_served)
        missing = [name for name in self._expected if not self._served(name)]
        sentence = None if back else f"{mishap.kind}: not served again in {PATIENCE_S:g} s: {', '.join(missing)}"
        if self.witness.rivals:
            one, other = self.witness.rivals.pop()
            self.witness.rivals.clear()
            sentence = f"{mishap.kind}: '{one.module}' and '{other.module}' drive in turn"
        return since_s - ended_s, sentence

    def _begin(self, mishap: Mishap) -> Callable[[], None]:
        """Begin a mishap; gives what ends it."""
        match mishap.kind:
            case "PE killed":
                self._fleet.kill_pe(mishap.pe)
                return lambda: self._start_pe(mishap.pe)
            case "manager killed":
                victim = self._fleet.active_manager()
                self._streams.pop(victim)
                self._fleet.kill_manager(victim)
                return lambda: self._start_manager(victim)
            case "PE stopped" | "manager stopped" as kind:
                node = mishap.pe if kind == "PE stopped" else self._fleet.active_manager()
                self._fleet.stop(node)
                return lambda: self._fleet.go_on(node)
            case "planner stopped":
                planners = self._planners()
                if not planners:
                    raise UserError("no manager has a planner's process that could be stopped")
                return _stopped(planners)
            case "disks full":
                return self._full_disks()
            case _:
                time.clock_settime(time.CLOCK_REALTIME, time.time() + mishap.step_s)
                return lambda: None

    def _full_disks(self) -> Callable[[], None]:
        before = {pid: resource.prlimit(pid, resource.RLIMIT_FSIZE) for pid in self._nodes()}
        for pid, (_, hard) in before.items():
            with suppress(ProcessLookupError):
                resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, hard))

        def heal() -> None:
            for pid, limits in before.items():
                with suppress(ProcessLookupError):
                    resource.prlimit(pid, resource.RLIMIT_FSIZE, limits)

        return heal

    def _nodes(self) -> list[int]:
        return [pid for pid in children(os.getpid()) if _words(pid) & {b"heronry_agent", b"manager"}]

    def _planners(self) -> list[int]:
        managers = [pid for pid in children(os.getpid()) if b"manager" in _words(pid)]
        return [p for m in managers for p in children(m) if b"heronry_manager.planner.service" in _words(p)]

    def _start_manager(self, node: int) -> None:
        self._streams[node] = EventStream(self._fleet.start_manager(node, standby=True))
        self._listen(HEARD_S)

    def _start_pe(self, pe: str) -> None:
        self._fleet.start_pe(pe)
        with suppress(ControlError):  # otherwise each hold-down is longer than the one before
            call(self._fleet.control_socket(self._fleet.active_manager()), ClearElement(f"pe:{pe}"))

    def _served(self, function: str) -> bool:
        return self.witness.served(function, time.monotonic_ns())

    def _comes_true(self, condition: Callable[[], bool]) -> bool:
        end_s = time.monotonic() + PATIENCE_S
        while not condition() and time.monotonic() < end_s:
            self._listen(0.05)
        return condition()

    def _listen(self, duration_s: float) -> None:
        end_s = time.monotonic() + duration_s
        while (left_s := end_s - time.monotonic()) > 0:
            open_streams = [stream for stream in self._streams.values() if not stream.has_ended]
            select.select([*self._ear.readers, *open_streams], [], [], left_s)
            for stream in open_streams:
                stream.take()
            for at_ns, frame in self._ear.hear():
                self.witness.see(at_ns, frame)


def _stopped(pids: Sequence[int]) -> Callable[[], None]:
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)

    def heal() -> None:
        for pid in pids:
            with suppress(ProcessLookupError):  # its manager has replaced it
                os.kill(pid, signal.SIGCONT)

    return heal


def _words(pid: int) -> set[bytes]:
    with suppress(OSError):
        return set(Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0"))
    return set()


def left_behind(folder: Path) -> list[str]:
    """Name what is left of a run: its folder with the sockets in it, and processes that name the folder."""
    left = [f"the folder {folder} is left"] if folder.exists() else []
    pids = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdecimal()]
    naming = [pid for pid in pids if any(os.fsencode(folder) in word for word in _words(pid))]
    return [*left, *(f"process {pid} is left" for pid in naming)]


def _tell(number: int, mishap: Mishap, after_s: float, sentence: str | None, *, as_json: bool) -> None:
    if as_json:
        told = {"number": number, **asdict(mishap), "served_after_s": round(after_s, 2), "failure": sentence}
        print(json.dumps(told), flush=True)
        return
    became = sentence or f"all is served {after_s:.2f} s after its end"
    pe = f" ({mishap.pe})" if mishap.kind.startswith("PE") else ""
    print(f"{number:3} {mishap.kind}{pe} for {mishap.length_s:g} s: {became}", flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; gives the exit code."""
    parser = argparse.ArgumentParser(description="Let mishaps happen to real processes, and verify what comes of each.")
    parser.add_argument("spec", nargs="?", default="elevator_and_chute", metavar="SPEC", help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="the same one draws the same mishaps")
    parser.add_argument("--count", type=int, default=60, metavar="N", help="mishaps (default 60)")
    parser.add_argument("--heartbeat-ms", type=int, default=200, metavar="MS", help="of every bus (default 200)")
    parser.add_argument("--clock", action="store_true", help="also set the clock of this computer (needs root)")
    parser.add_argument("--json", action="store_true", help="one line of JSON for each mishap")
    arguments = parser.parse_args(argv)
    kinds = (*KINDS, CLOCK) if arguments.clock else KINDS
    failures: list[str] = []
    with ExitStack() as stack:
        own = Path(stack.enter_context(TemporaryDirectory()))
        file = slow_spec(arguments.spec, own, heartbeat_ms=arguments.heartbeat_ms)
        mishaps = drawn(arguments.seed, arguments.count, list(load_spec(str(file)).pes), kinds)
        with aircraft(str(file)) as flown, Ear(flown.main, flown.spec.buses[flown.main.name]) as ear:
            folder, flight = flown.fleet.folder, Flight(flown, ear)
            failures += filter(None, [flight.begin()])
            for number, mishap in enumerate(mishaps if not failures else (), 1):
                after_s, sentence = flight.suffer(mishap)
                failures += filter(None, [sentence])
                _tell(number, mishap, after_s, sentence, as_json=arguments.json)
        failures += left_behind(folder)
    for failure in failures:
        print(f"FAILURE: {failure}", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(exit_code(main, "mishaps"))
