"""The loader as the agent's loop sees it: orders go in, keepers work, and what has changed comes out; nothing waits.

    idle        no keeper runs
    at work     one keeper (`keeper`) does one operation; further ones wait in their order
    on trial    the active code is judged by what its modules do (`trial`); then it is confirmed or taken back

Code that is taken back is out of use at once, whatever the disk says; the record follows as soon as the disk takes it,
and until then a restart of the agent counts as one more try. A confirmation that the disk does not take is repeated.

    a keeper that is killed, or hangs for KEEPER_NS    is told as an operation that failed; the next one asks for the
                                                       state anew
    an order to start code while modules of it run     is refused: what runs is never touched
"""

import json
import os
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from heronry_agent.core.vocabulary import (
    Action,
    ControlProgram,
    EndPartition,
    ImagesArrived,
    ImagesMissing,
    ModuleEvent,
    PartitionEnded,
    ProgramChanged,
    ProgramState,
    StartFailed,
    StartModule,
    StopModule,
    WriteProgram,
)
from heronry_agent.loader.keeper import DISK, FINE, NOT_FOR_HERE, TOO_LARGE, WRONG, Answer
from heronry_agent.loader.store import State, reverted, slot_file
from heronry_agent.loader.trial import Trial, Verdict
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.sansio import NEVER_NS

KEEPER_NS = 60_000_000_000
RETRY_NS = 10_000_000_000
_BOOT_S = 10.0
_STANDS_BACK = 5  # steps of "niceness", as a partition's
_MOST_ANSWER = 1 << 20
_ERRORS = {FINE: 0, WRONG: 3, DISK: 5, TOO_LARGE: 6, NOT_FOR_HERE: 7}  # object 1F57h, as CiA 302-3 numbers them
_INHERITED = ("HOME", "LANG", "LD_LIBRARY_PATH", "PATH", "TZ", "VIRTUAL_ENV")
_LOST = Answer(DISK, "the process that keeps the code ended or hung: look whether the disk works", None, None)


class _Operation(NamedTuple):
    name: str
    content: bytes = b""
    is_ordered: bool = False  # a client waits for what becomes of it


class CodeLoader:
    """The loader of one PE; `next_ns` is the time in ns at which to call `take`, if no keeper is readable before."""

    def __init__(
        self, folder: Path, key: Path | None, own: Mapping[int, ModuleEntry], tell: Callable[[str], None]
    ) -> None:
        """Ask the store for its state, which counts one more try of code on trial; waits for the disk for a while.

        folder: the folder of --code-dir.
        key: file of the public key; None: code need not be signed.
        own: by index, the modules whose code is not installed on this node.
        tell: called with a sentence for the log.
        """
        self._command = [sys.executable, "-m", "heronry_agent.loader.keeper", str(folder)]
        self._folder, self._key, self._own, self._tell = folder, key, dict(own), tell
        self._state, self._error = State({}), 0
        self._keeper: subprocess.Popen[bytes] | None = None
        self._now: _Operation | None = None
        self._queue: deque[_Operation] = deque()
        self._said = b""
        self._limit_ns = self._again_ns = NEVER_NS
        self._running: set[int] = set()
        self._trial: Trial | None = None
        self.is_changed = False  # True: partitions of the loader's modules are to be started anew
        self._boot()

    @property
    def program(self) -> ProgramState:
        """Return what the core is told of this loader."""
        code = self._state.code
        return ProgramState(0 if code is None else code.version, self._error)

    @property
    def images(self) -> frozenset[str]:
        """Return the images of this PE's table whose code the active bundle holds."""
        code = self._state.code
        wanted = frozenset(entry.image for entry in self._own.values())
        return frozenset() if code is None else wanted.intersection(code.images)

    @property
    def path(self) -> str | None:
        """Return the file from which the partitions of this PE import; None: it has no code of its own."""
        return None if self._state.active is None else str(self._folder / slot_file(self._state.active))

    @property
    def readers(self) -> Collection[int]:
        """Return what `select` is to wait for."""
        return () if self._keeper is None or self._keeper.stdout is None else (self._keeper.stdout.fileno(),)

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `take`."""
        return min(self._limit_ns, self._again_ns)

    def ordered(self, action: Action, now_ns: int) -> list[ModuleEvent]:
        """Take an action of the core; returns the answers that are known at once."""
        match action:
            case WriteProgram(content):
                self._do(_Operation("receive", content, is_ordered=True), now_ns)
            case ControlProgram(is_start=True) if self._running:
                self._tell("code is not started while modules of the code before run: let them run elsewhere first")
                self._error = _ERRORS[NOT_FOR_HERE]
                return [ProgramChanged(self.program)]
            case ControlProgram(is_start):
                self._do(_Operation("start" if is_start else "clear", is_ordered=True), now_ns)
            case StartModule(module) if module in self._own:
                self._running.add(module)
            case StopModule(module):
                self._running.discard(module)
            case EndPartition(partition):
                self._ended(partition)
            case _:
                return []
        if self._trial is not None:
            self._trial.ordered(action)
        return self._judged(now_ns)

    def heard(self, event: ModuleEvent, now_ns: int) -> list[ModuleEvent]:
        """Take what a module host reports; returns what follows for the core."""
        if isinstance(event, PartitionEnded):
            self._ended(event.partition)
        elif isinstance(event, StartFailed):
            self._running.discard(event.module)
        if self._trial is None:
            return []
        self._trial.heard(event, now_ns)
        return self._judged(now_ns)

    def take(self, ready: Collection[object], now_ns: int) -> list[ModuleEvent]:
        """Read what a keeper says, and begin what is due; returns what follows for the core."""
        if now_ns >= self._again_ns:
            self._again_ns = NEVER_NS
            self._queue_once("confirm" if self._trial is not None else "revert")
        events: list[ModuleEvent] = []
        if now_ns >= self._limit_ns or any(one in ready for one in self.readers):
            events = self._hear_keeper(now_ns)
        if self._now is None and self._queue:
            self._begin(self._queue.popleft(), now_ns)
        return events

    def abandon(self) -> None:
        """Note that all partitions have been ended."""
        self._running.clear()

    def close(self) -> None:
        """End the keeper that is at work; the store is whole whenever that is."""
        keeper, self._keeper, self._now, self._limit_ns = self._keeper, None, None, NEVER_NS
        if keeper is None:
            return
        with suppress(ProcessLookupError):
            keeper.kill()
        keeper.wait()
        if keeper.stdout is not None:
            keeper.stdout.close()

    def runs(self, partition: str) -> bool:
        """Tell whether a module of this partition runs."""
        return any(self._own[module].partition == partition for module in self._running)

    def _ended(self, partition: str) -> None:
        self._running -= {module for module in self._running if self._own[module].partition == partition}

    # The trial

    def _judged(self, now_ns: int) -> list[ModuleEvent]:
        trial = self._trial
        if trial is None or trial.verdict is Verdict.RUNNING:
            return []
        code = self._state.code
        assert code is not None
        if trial.verdict is Verdict.PASSED:
            if not trial.is_told:
                trial.is_told = True
                self._do(_Operation("confirm"), now_ns)
            return []
        self._trial = None
        self._tell(f"version {code.version} of {code.name} has failed ({trial.why}): the code before it is back")
        self._do(_Operation("revert"), now_ns)
        return self._switch(reverted(self._state))

    def _switch(self, state: State) -> list[ModuleEvent]:
        """Let another state count; returns what follows for the core."""
        before, self._state = (self.images, self._state.active), state
        if (self.images, state.active) == before:
            return [ProgramChanged(self.program)]
        self.is_changed = True
        self._trial = self._new_trial() if state.tries is not None else None
        gone = {image: f"image '{image}': the bundle that holds it is not in use" for image in before[0] - self.images}
        events: list[ModuleEvent] = [ProgramChanged(self.program)]
        if self.images - before[0]:
            events.append(ImagesArrived(self.images - before[0]))
        return [*events, ImagesMissing(gone)] if gone else events

    def _new_trial(self) -> Trial:
        here = {module: entry for module, entry in self._own.items() if entry.image in self.images}
        return Trial(here, self.images, {entry.partition for entry in here.values()})

    # Keepers

    def _boot(self) -> None:
        try:
            done = subprocess.run(
                [*self._command, "boot"],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=_environment(),
                timeout=_BOOT_S,
                check=False,
            )
            said = _read(done.stdout)
        except (OSError, subprocess.TimeoutExpired):
            said = _LOST
        if said.problem != FINE:
            self._tell(said.sentence)
        if said.state is not None:
            self._state = State.from_json(said.state)
        code = self._state.code
        if code is not None:
            trial = "" if self._state.tries is None else ", on trial"
            self._tell(f"code of {code.name}, version {code.version}{trial}")
        self._trial = None if self._state.tries is None else self._new_trial()

    def _do(self, operation: _Operation, now_ns: int) -> None:
        if self._now is None:
            self._begin(operation, now_ns)
        else:
            self._queue.append(operation)

    def _queue_once(self, name: str) -> None:
        if all(waiting.name != name for waiting in self._queue):
            self._queue.append(_Operation(name))

    def _begin(self, operation: _Operation, now_ns: int) -> None:
        """Start a keeper; if that is not possible, `take` reports it at the time limit, which is now."""
        self._now, self._said, self._limit_ns = operation, b"", now_ns + KEEPER_NS
        arguments = [operation.name] if self._key is None else [operation.name, str(self._key)]
        try:
            content = os.memfd_create("bundle", os.MFD_CLOEXEC)
            with os.fdopen(content, "w+b") as stream:
                stream.write(operation.content)
                stream.flush()
                stream.seek(0)
                self._keeper = subprocess.Popen(
                    [*self._command, *arguments],
                    stdin=stream,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    env=_environment(),
                    process_group=0,
                )
            os.setpriority(os.PRIO_PROCESS, self._keeper.pid, os.getpriority(os.PRIO_PROCESS, 0) + _STANDS_BACK)
        except OSError:
            self._limit_ns = now_ns

    def _hear_keeper(self, now_ns: int) -> list[ModuleEvent]:
        if now_ns < self._limit_ns:
            came = b"".join(os.read(reader, _MOST_ANSWER) for reader in self.readers)
            self._said += came
            if came and not self._said.endswith(b"\n"):
                return []
        operation, said = self._now, _read(self._said)
        self.close()
        assert operation is not None
        return self._done(operation, said, now_ns)

    def _done(self, operation: _Operation, said: Answer, now_ns: int) -> list[ModuleEvent]:
        if said.problem != FINE:
            self._tell(f"code: {said.sentence}" if said is _LOST else f"a bundle is not used: {said.sentence}")
        if operation.name in ("confirm", "revert"):
            return self._settled(operation, said, now_ns)
        self._error = _ERRORS[said.problem]
        if said.state is None:
            return [ProgramChanged(self.program)]
        state = State.from_json(said.state)
        if said.problem == FINE and operation.name == "receive":
            self._tell("a bundle has come over the bus, is whole, and waits for its start")
        if said.problem == FINE and operation.name == "start" and state.code is not None:
            self._tell(f"version {state.code.version} of {state.code.name} is in use")
        return self._switch(state)

    def _settled(self, operation: _Operation, said: Answer, now_ns: int) -> list[ModuleEvent]:
        """Take what has become of a confirmation, or of the record of code that was taken back."""
        if said.problem != FINE or said.state is None:
            self._again_ns = now_ns + RETRY_NS
            return []
        if operation.name == "confirm":
            self._trial = None
            self._tell("the code has run for a minute, and is kept")
        self._state = State.from_json(said.state)
        return []


def _read(line: bytes) -> Answer:
    try:
        return Answer(**json.loads(line))
    except (ValueError, TypeError):
        return _LOST


def _environment() -> dict[str, str]:
    return {k: v for k, v in os.environ.items() if k in _INHERITED or k.startswith(("LC_", "PYTHON"))}
