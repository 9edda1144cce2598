"""The manager's end of the planner's process: starts the process, sends requests and reads answers.

At most one request is inside the process. Further requests wait here in their order, so that a write never meets a full
pipe. Only `wait_until_ready`, `ask` and `close` block. An event loop watches the descriptor `fileno()`, which stays the
same for the life of the client, and calls `poll()` whenever this descriptor is readable. If the process hangs, the
caller has to call `cancel()`.

`hold(True)` stops the process (SIGSTOP), so that it takes no processor time at all, and `hold(False)` lets it go on
where it was. A process that starts is stopped only when it has loaded the solver: before, it may not have arranged yet
to end with its client (`service`), and a stopped process cannot do so.

Every request gets exactly one answer, `Planned` or `Failed`; only a request that `cancel()` drops gets none. If the
process ends, its request has failed, and the next request starts another process.
"""

import os
import select
import signal
import subprocess
import sys
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from selectors import EVENT_READ, DefaultSelector
from types import TracebackType
from typing import BinaryIO, Self

from heronry_dg.findings import SpecError
from heronry_dg.loader import load_bytes
from heronry_dg.model import Spec
from heronry_dg.objective import Placement
from heronry_dg.plan import Plan, PlanError, check_names, plan_with_bounds
from heronry_dg.situation import Situation
from heronry_manager.planner.messages import (
    MessageError,
    Ready,
    Refusal,
    Request,
    Solution,
    read_answer,
    request_line,
)
from heronry_wire.errors import HeronryError

_CHUNK = 65536
_LONGEST_END_S = 2.0  # for how long a process that is asked to end may take; then it is killed
LONGEST_START_S = 60.0


class PlannerError(HeronryError):
    """The planner's process cannot be used, or could not answer."""


@dataclass(frozen=True, slots=True)
class Planned:
    """The answer to a request: a plan that the verifier has accepted."""

    request: int
    plan: Plan


@dataclass(frozen=True, slots=True)
class Failed:
    """The request gave no plan; `reason` says why."""

    request: int
    reason: str


class PlannerClient:
    """The planner of one spec in a process of its own, which loads the solver when it is started."""

    def __init__(self, spec: Spec, file: Path, *, niceness: int = 0, starts: bool = True) -> None:
        """Start the process, or (starts: False) let `start` or the first request do that.

        Raises PlannerError if `file` has another meaning now than when `spec` was loaded, or there is no room for it.

        niceness: 0..19, as in nice(2): a higher value gives the process less time on a busy computer.
        """
        data = file.read_bytes()
        if _digest(data, file.name) != spec.digest:
            raise PlannerError(f"{file} has changed since it was loaded: start 'heronry manager' again")
        self._name = file.name
        self.ready = False
        self._niceness = niceness
        self._spec = spec
        self._file = _in_memory(data)
        self._selector = DefaultSelector()
        self._waiting: deque[Request] = deque()
        self._inside: Request | None = None  # the request that the process works on
        self._unread = b""
        self._process: _Process | None = None
        self._is_held = False
        if starts:
            self.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def fileno(self) -> int:
        """Return the descriptor that is readable when `poll` has something to do."""
        return self._selector.fileno()

    @property
    def process_id(self) -> int | None:
        """Identifier of the planner's process; None while there is none."""
        return None if self._process is None else self._process.process_id

    def start(self) -> None:
        """Start the process if there is none.

        The calling thread must go on as long as this program: the process ends with its thread (`parent_death`).
        """
        if self._process is None:
            self._process = _Process(self._file.fileno(), self._name, self._niceness)
            self._selector.register(self._process.answers, EVENT_READ)

    def request(self, number: int, now: Situation, running: Placement | None) -> None:
        """Request a plan; `poll` returns the answer, with this number."""
        self._waiting.append(Request(number, now, running))
        self._send_next()

    def poll(self) -> list[Planned | Failed]:
        """Return the answers that have arrived, without waiting."""
        found: list[Planned | Failed] = []
        while self._process is not None and self._selector.select(timeout=0):
            chunk = os.read(self._process.answers.fileno(), _CHUNK)
            if not chunk:
                found.extend(self._ended())
                continue
            *lines, self._unread = (self._unread + chunk).split(b"\n")
            for line in lines:
                found.extend(self._read(line))
        return found

    def hold(self, is_held: bool) -> None:
        """Stop the process, or let it go on; requests meanwhile wait. No effect if this is so already."""
        if is_held != self._is_held:
            self._is_held = is_held
            if self._process is not None and self.ready:
                self._process.signal(signal.SIGSTOP if is_held else signal.SIGCONT)

    def cancel(self) -> None:
        """Drop all requests that have no answer yet; if the process works on one of them, start a new process."""
        self._waiting.clear()
        if self._inside is not None:
            self._stop(kill=True)
            self.start()

    def wait_until_ready(self) -> None:
        """Block until the process has loaded the solver; raises PlannerError if the process ends instead.

        If the process hangs, the call returns after `LONGEST_START_S` seconds, and `ready` is still False.
        """
        until_s = time.monotonic() + LONGEST_START_S
        while not self.ready and (left_s := until_s - time.monotonic()) > 0:
            if self._process is None:
                raise PlannerError("the planner's process ended before it was ready; standard error has its message")
            self._wait(left_s)
            self.poll()

    def ask(self, now: Situation, running: Placement | None = None) -> Plan:
        """Request a plan and wait for it; raises PlannerError if planning fails, or another request is under way."""
        if self._inside is not None or self._waiting:
            raise PlannerError(
                "another request for a plan is under way: take its answer from poll(), or cancel the request"
            )
        self.request(0, now, running)
        while True:
            self._wait()
            for answer in self.poll():
                if isinstance(answer, Failed):
                    raise PlannerError(answer.reason)
                return answer.plan

    def close(self) -> None:
        """End the planner's process, and close the file with the spec."""
        self._stop(kill=False)
        self._selector.close()
        self._file.close()

    def _wait(self, longest_s: float | None = None) -> None:
        select.select([self.fileno()], [], [], longest_s)

    def _stop(self, *, kill: bool) -> int | None:
        """End the process and return its exit code; None if there is no process."""
        process, self._process = self._process, None
        self.ready, self._inside, self._unread = False, None, b""
        if process is None:
            return None
        self._selector.unregister(process.answers)
        return process.end(kill=kill)

    def _send_next(self) -> None:
        if self._inside is not None or not self._waiting:
            return
        self.start()
        assert self._process is not None
        self._inside = self._waiting.popleft()
        self._process.send(request_line(self._inside))

    def _ended(self, why: str | None = None) -> list[Planned | Failed]:
        """Kill the planner's process if it still runs, and report the request that was sent to it as failed.

        The next request starts another process. Returns an empty list if the process had no request.

        why: a sentence, if the manager ends the process; None: the process has ended by itself.
        """
        request = self._inside
        code = self._stop(kill=True)
        self._send_next()
        reason = why or f"the planner's process ended (exit code {code})"
        return [] if request is None else [Failed(request.number, reason)]

    def _read(self, line: bytes) -> list[Planned | Failed]:
        try:
            answer = read_answer(line)
        except MessageError as error:
            return self._ended(f"the manager has ended the planner's process, which wrote a wrong line: {error}")
        if isinstance(answer, Ready):
            self.ready = True
            if self._is_held and self._process is not None:
                self._process.signal(signal.SIGSTOP)
            return []
        request, self._inside = self._inside, None
        self._send_next()
        return [] if request is None else [self._outcome(request, answer)]

    def _outcome(self, request: Request, answer: Solution | Refusal) -> Planned | Failed:
        """Convert the answer of the planner's process to the answer for the caller.

        The process has verified its plan. A plan with names that the spec does not have becomes a failure.
        """
        if isinstance(answer, Refusal):
            return Failed(request.number, answer.reason)
        try:
            check_names(self._spec, answer.configuration)
        except PlanError as error:
            return Failed(request.number, f"the planner's answer cannot be read: {error}")
        found = answer.configuration, answer.objective, answer.bounds
        return Planned(request.number, plan_with_bounds(self._spec, request.now, *found))


def _digest(data: bytes, name: str) -> str | None:
    """Return the digest of a spec in a file; None if it is no spec any more."""
    try:
        return load_bytes(data, name).digest
    except SpecError:
        return None


def _in_memory(data: bytes) -> BinaryIO:
    """Make a file that child processes inherit and can open by /dev/fd.

    The file is in memory, because not every file system lets a process open a deleted file again.

    Raises PlannerError if the limit on the size of files leaves no room for it.
    """
    file = os.fdopen(os.memfd_create("heronry-spec"), "w+b", buffering=0)
    try:
        file.write(data)
    except OSError as error:
        file.close()
        raise PlannerError(f"the planner cannot be given the spec: {error.strerror}; see 'ulimit -f'") from None
    return file


class _Process:
    """One process of `heronry_manager.planner.service`, with its two pipes."""

    def __init__(self, spec_fd: int, name: str, niceness: int) -> None:
        os.lseek(spec_fd, 0, os.SEEK_SET)
        standing_back = ["nice", "-n", str(niceness)] if niceness else []  # also while it loads the solver
        self._process = subprocess.Popen(
            [*standing_back, sys.executable, "-m", "heronry_manager.planner.service", str(spec_fd), name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(spec_fd,),
            process_group=0,  # Ctrl-C in a terminal is for the manager, which ends this process
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self.process_id = self._process.pid
        self._requests = self._process.stdin
        self.answers = self._process.stdout

    def send(self, line: bytes) -> None:
        """Write a request; a process that has ended is noticed only when its answers are read."""
        with suppress(BrokenPipeError):
            self._requests.write(line)
            self._requests.flush()

    def signal(self, number: signal.Signals) -> None:
        """Send a signal; no effect if the process has ended."""
        self._process.send_signal(number)

    def end(self, *, kill: bool) -> int:
        """End the process by closing its standard input, or by `kill`; return its exit code."""
        if kill:
            self._process.kill()
        else:
            self.signal(signal.SIGCONT)  # a stopped process would not notice
        with suppress(BrokenPipeError):
            self._requests.close()
        self.answers.close()
        try:
            return self._process.wait(None if kill else _LONGEST_END_S)
        except subprocess.TimeoutExpired:  # it hangs
            self._process.kill()
            return self._process.wait()
