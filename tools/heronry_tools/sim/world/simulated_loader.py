"""The loader of a simulated PE: the store that flies, on files in memory, and a keeper that takes a while.

An order of the PE is done after a random time, as by the keeper of a real one (`heronry_agent.loader`). If the PE dies
meanwhile, its keeper dies at a random file operation: what it has written so far stays, and the next start of the PE
finds it. Signatures are not simulated, and nothing fails in its trial: live tests show both.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random

from heronry_agent.core.vocabulary import (
    ControlProgram,
    ImagesArrived,
    KeepParts,
    ModuleEvent,
    ProgramChanged,
    ProgramState,
    WriteProgram,
)
from heronry_agent.loader.folder import Folder
from heronry_agent.loader.store import Store, slot_file
from heronry_tools.sim.world.clock import Clock
from heronry_wire.bundle import MOST_BYTES
from heronry_wire.errors import HeronryError

_WORKS_MS = (50, 900)
_NS_PER_MS = 1_000_000
_OPERATIONS = 12  # more than any order has
_FAILED = 3


class _KeeperDiedError(Exception):
    """The keeper has died with its PE."""


class CodeDisk(Folder):
    """The folder of a loader, in memory; `left` counts the file operations that its keeper does before it dies."""

    def __init__(self) -> None:
        super().__init__(Path("/code"))
        self._files: dict[str, bytes] = {}
        self._drafts: dict[str, bytes] = {}
        self.left: int | None = None

    def make(self) -> None:
        """Remove the drafts that a crash has left."""
        self._drafts.clear()

    def read(self, name: str, most_bytes: int) -> bytes | None:
        """Return a file; None where there is none."""
        content = self._files.get(name)
        return None if content is None else content[:most_bytes]

    def draft(self, name: str, content: bytes) -> None:
        """Write the content that a file is to have; of a keeper that dies, half of it is written."""
        self._drafts[name] = content[: len(content) // 2]
        self._operate()
        self._drafts[name] = content

    def commit(self, name: str) -> None:
        """Let a file have the content of its draft."""
        self._operate()
        self._files[name] = self._drafts.pop(name)
        self._operate()

    def remove(self, name: str) -> None:
        """Let there be no such file."""
        self._files.pop(name, None)

    def _operate(self) -> None:
        if self.left is not None:
            self.left -= 1
            if self.left < 0:
                raise _KeeperDiedError


def active_code(disk: CodeDisk) -> bytes | None:
    """Return the bundle from which a PE runs, or will at its next start, as its disk says; None: there is none."""
    active = Store(disk).state().active
    return None if active is None else disk.read(slot_file(active), MOST_BYTES)


class SimulatedLoader:
    """The loader of one PE from a start of the PE to its end."""

    def __init__(
        self,
        clock: Clock,
        disk: CodeDisk,
        chance: Random,
        give: Callable[[ModuleEvent], None],
        came: Callable[[bytes], frozenset[str]],
    ) -> None:
        """Start from what the disk has.

        give: is called with what the loader answers.
        came: is called with the bundle from which code runs now; returns the images that the PE lacked until then.
        """
        self._clock, self._disk, self._chance, self._give, self._came = clock, disk, chance, give, came
        self._store = Store(disk)
        disk.left = None
        self._state = self._store.boot()
        self._pending: WriteProgram | ControlProgram | None = None
        self._error = 0
        self.kept_parts = self._store.kept()
        self._tell_code()

    @property
    def program(self) -> ProgramState:
        """Return what the core is told of this loader."""
        code = self._state.code
        if code is None:
            return ProgramState(error=self._error)
        return ProgramState(code.version, self._error, digest=bytes.fromhex(code.digest))

    def order(self, action: WriteProgram | KeepParts | ControlProgram) -> None:
        """Do what the core asks, after a while; parts are kept at once."""
        if isinstance(action, KeepParts):
            self._store.keep(action.content)
            return
        self._pending = action
        later_ns = self._chance.randint(*_WORKS_MS) * _NS_PER_MS
        self._clock.at(self._clock.now_ns + later_ns, lambda: self._work(action))

    def stop(self) -> None:
        """End with the PE: a keeper that is at work dies at some file operation."""
        pending, self._pending = self._pending, None
        if pending is not None:
            self._disk.left = self._chance.randrange(_OPERATIONS)
            with suppress(_KeeperDiedError, HeronryError):
                self._do(pending)

    def _work(self, action: WriteProgram | ControlProgram) -> None:
        if self._pending is not action:
            return
        self._pending, self._error = None, 0
        before = self._state.active
        try:
            self._do(action)
        except HeronryError:
            self._error = _FAILED
        self._state = self._store.state()
        self._give(ProgramChanged(self.program))
        if self._state.active != before:
            self._give(ImagesArrived(self._tell_code()))

    def _do(self, action: WriteProgram | ControlProgram) -> None:
        if isinstance(action, WriteProgram):
            self._store.receive(action.content, lambda _: None)
        elif action.is_start:
            self._store.start()
        else:
            self._store.clear()

    def _tell_code(self) -> frozenset[str]:
        if self._state.active is None:
            return frozenset()
        return self._came(active_code(self._disk) or b"")
