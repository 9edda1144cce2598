"""The loader as the agent's loop sees it: orders go in, keepers work, and what has changed comes out; nothing waits.

    idle        no keeper runs
    at work     one keeper (`keeper_process`) does one operation; further ones wait in their order
    on trial    the active code is judged by what its modules do (`trial`); then it is confirmed or taken back
    taken back  code has failed in its trial, and the disk's record does not say so yet

What counts follows from two things in one place (`_follow`): the record that the disk gave last, and what was taken
back. Code that was taken back is out of use whatever a record says, until one says that it is; the trial is always that
of the code that counts. Until the disk has recorded it, a restart of the agent counts as one more try.

What the disk still owes is asked for again every RETRY_NS until an answer has it: that code was taken back, has passed
its trial, or is started for the first time; or that the agent has lived for REST_NS beside code that was not started.
It is computed from the state, so nothing else is ever confirmed or taken back.

    a keeper that is killed or hangs                   is told as an operation that failed; the next has the record
    an order to start code while modules of it run     is refused: what runs is never touched
"""

from base64 import b64decode
from collections import deque
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import NamedTuple

from heronry_agent.core.vocabulary import (
    Action,
    ControlProgram,
    EndPartition,
    ImagesArrived,
    ImagesMissing,
    KeepParts,
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
from heronry_agent.loader.keeper_process import LOST, KeeperProcess
from heronry_agent.loader.store import State, reverted, slot_file
from heronry_agent.loader.trial import Trial, Verdict
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.sansio import NEVER_NS

RETRY_NS = 10_000_000_000
REST_NS = 60_000_000_000
_ERRORS = {FINE: 0, WRONG: 3, DISK: 5, TOO_LARGE: 6, NOT_FOR_HERE: 7}  # object 1F57h, as CiA 302-3 numbers them
_ORDERED = ("receive", "start", "clear")  # a client waits for what becomes of them


class _Operation(NamedTuple):
    name: str
    content: bytes = b""


class CodeLoader:
    """The loader of one PE; `next_ns` is the time in ns at which to call `take`, if no keeper is readable before."""

    def __init__(
        self, folder: Path, keeper: KeeperProcess, own: Mapping[int, ModuleEntry], tell: Callable[[str], None]
    ) -> None:
        """Ask the store for its state, which counts one more try of code on trial; waits for the disk for a while.

        folder: the folder of --code-dir.
        keeper: starts the keepers of this folder.
        own: by index, the modules whose code is not installed on this node.
        tell: called with a sentence for the log.
        """
        self._folder, self._keeper, self._own, self._tell = folder, keeper, dict(own), tell
        self._state, self._error = State({}), 0
        self._taken_back = ""  # the digest of the code
        self._now: _Operation | None = None
        self._queue: deque[_Operation] = deque()
        self._owed, self._again_ns = "", 0
        self._rest_ns = NEVER_NS  # when the agent has lived for long enough; known at the first call of `take`
        self._is_started = False  # a module of the code on trial was started
        self._running: set[int] = set()
        self._trial: Trial | None = None
        self.kept_parts = b""  # the last KeepParts, while its bundle is unfinished
        self.is_changed = False  # True: partitions of the loader's modules are to be started anew
        self._boot()

    @property
    def program(self) -> ProgramState:
        """Return what the core is told of this loader."""
        code = self._state.code
        at_work = any(one.name in _ORDERED for one in (self._now, *self._queue) if one is not None)
        version, digest = (0, "") if code is None else (code.version, code.digest)
        return ProgramState(version, self._error, at_work, bytes.fromhex(digest))

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
        return self._keeper.readers

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `take`."""
        return min(self._keeper.next_ns, self._again_ns)

    def ordered(self, action: Action, now_ns: int) -> list[ModuleEvent]:
        """Take an action of the core; returns the answers that are known at once."""
        match action:
            case WriteProgram(content):
                self.kept_parts = b""
                self._do(_Operation("receive", content), now_ns)
            case KeepParts(content):
                self.kept_parts = content
                self._queue = deque(one for one in self._queue if one.name != "keep")
                self._do(_Operation("keep", content), now_ns)
            case ControlProgram(is_start=True) if self._running:
                self._tell("code is not started while modules of the code before run: let them run elsewhere first")
                self._error = _ERRORS[NOT_FOR_HERE]
                return [ProgramChanged(self.program)]
            case ControlProgram(is_start):
                self.kept_parts = self.kept_parts if is_start else b""
                self._do(_Operation("start" if is_start else "clear"), now_ns)
            case StartModule(module) if module in self._own:
                self._running.add(module)
                self._is_started |= self._own[module].image in self.images
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
        events: list[ModuleEvent] = []
        if self._now is not None:
            said = self._keeper.heard(ready, now_ns)
            if said is not None:
                operation, self._now = self._now, None
                events = self._done(operation, said)
        self._rest_ns = min(self._rest_ns, now_ns + REST_NS)
        if self._now is None and self._queue:
            self._begin(self._queue.popleft(), now_ns)
        self._settle(now_ns)
        return events

    def abandon(self) -> None:
        """Note that all partitions have been ended."""
        self._running.clear()

    def close(self) -> None:
        """End the keeper that is at work; the store is whole whenever that is."""
        self._now = None
        self._keeper.close()

    def runs(self, partition: str) -> bool:
        """Tell whether a module of this partition runs."""
        return any(self._own[module].partition == partition for module in self._running)

    def _ended(self, partition: str) -> None:
        self._running -= {module for module in self._running if self._own[module].partition == partition}

    # What counts

    def _judged(self, now_ns: int) -> list[ModuleEvent]:
        """Draw the consequences of the trial."""
        events: list[ModuleEvent] = []
        code = self._state.code
        if self._trial is not None and self._trial.verdict is Verdict.FAILED and code is not None:
            self._tell(
                f"version {code.version} of {code.name} has failed ({self._trial.why}): the code before it is back"
            )
            self._taken_back = code.digest
            events = self._follow(self._state)
        self._settle(now_ns)
        return events

    def _follow(self, record: State) -> list[ModuleEvent]:
        """Let a record count, without what was taken back; returns what follows for the core."""
        if record.code is not None and record.code.digest == self._taken_back and record.tries is not None:
            record = reverted(record)
        else:
            self._taken_back = ""
        before, images, self._state = self._state, self.images, record
        if record.tries is None:
            self._trial = None
        elif self._trial is None or record.code != before.code:
            here = {module: entry for module, entry in self._own.items() if entry.image in self.images}
            self._trial = Trial(here, self.images, {entry.partition for entry in here.values()})
            self._is_started = False
        if (record.code, record.active) == (before.code, before.active):
            return [ProgramChanged(self.program)]
        self.is_changed = True
        gone = {image: f"image '{image}': the bundle that holds it is not in use" for image in images - self.images}
        events: list[ModuleEvent] = [ProgramChanged(self.program)]
        if self.images - images:
            events.append(ImagesArrived(self.images - images))
        return [*events, ImagesMissing(gone)] if gone else events

    def _settle(self, now_ns: int) -> None:
        """Ask the disk for what it owes, unless it was asked a moment ago."""
        owed = self._what_is_owed(now_ns)
        if not owed:
            rests = self._state.tries and not self._state.has_run
            self._owed, self._again_ns = "", self._rest_ns if rests else NEVER_NS
        elif owed != self._owed or now_ns >= self._again_ns:
            self._owed, self._again_ns = owed, now_ns + RETRY_NS
            if all(one is None or one.name != owed for one in (self._now, *self._queue)):
                self._do(_Operation(owed), now_ns)

    def _what_is_owed(self, now_ns: int) -> str:
        """Return the operation whose result the record lacks, or nothing."""
        if self._taken_back:
            return "revert"
        if self._trial is None:
            return ""
        if self._trial.verdict is Verdict.PASSED:
            return "confirm"
        if self._state.has_run:
            return ""
        if self._is_started:
            return "run"
        return "rest" if self._state.tries and now_ns >= self._rest_ns else ""

    # Keepers

    def _boot(self) -> None:
        said = self._keeper.boot()
        if said.problem != FINE:
            self._tell(said.sentence)
        if said.state is not None:
            self._follow(State.from_json(said.state))
        self.kept_parts = b64decode(said.kept)
        self.is_changed = False
        code = self._state.code
        if code is not None:
            trial = "" if self._state.tries is None else ", on trial"
            self._tell(f"code of {code.name}, version {code.version}{trial}")

    def _do(self, operation: _Operation, now_ns: int) -> None:
        if self._now is None:
            self._begin(operation, now_ns)
        else:
            self._queue.append(operation)

    def _begin(self, operation: _Operation, now_ns: int) -> None:
        self._now = operation
        self._keeper.begin(operation.name, operation.content, now_ns)

    def _done(self, operation: _Operation, said: Answer) -> list[ModuleEvent]:
        """Take the answer of a keeper; returns what follows for the core."""
        if said.problem != FINE and operation.name != "keep":  # without kept parts a restart begins anew
            self._tell(f"code: {said.sentence}" if said is LOST else f"a bundle is not used: {said.sentence}")
        if operation.name in _ORDERED:
            self._error = _ERRORS[said.problem]
        if said.state is None:
            return [ProgramChanged(self.program)]
        events = self._follow(State.from_json(said.state))
        code = self._state.code
        if said.problem == FINE and operation.name == "receive":
            self._tell("a bundle has come over the bus, is whole, and waits for its start")
        if said.problem == FINE and operation.name == "start" and code is not None:
            self._tell(f"version {code.version} of {code.name} is in use")
        if said.problem == FINE and operation.name == "confirm":
            self._tell("the code has run for a minute, and is kept")
        return events
