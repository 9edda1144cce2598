"""Code over the bus, as CiA 302-3 has it: the door to a loader, which the agent's driver has or has not.

    1F50h sub 1    a client writes a bundle, whole
    1F51h sub 1    1 starts what was written, 3 forgets it. 0 is taken, and stops nothing: a manager has started it
    1F56h sub 1    the version of the code that runs; 0: none
    1F57h sub 1    bit 0: the loader is at work, so nothing can be written now; bits 7..1: why the last order failed
    2030h sub 1    one part of a bundle: its SHA-256 (32 bytes), its length (4), where the part begins (4), the part
    2030h sub 2    how far such a transfer has come: the SHA-256 (32 bytes) and the bytes in order (4)
    2030h sub 3    which bundle the code that runs is of: its SHA-256 (32 bytes); two bundles may have one version

A master of any make writes 1F50h. 2030h is an extension of ours: a transfer that was cut off goes on from where it was,
also from another client (`received_parts`). An order to clear begins anew. When the last part has come and the SHA-256
is right, the bundle is what a write of 1F50h would have brought.

This file keeps the bytes of an unfinished bundle, and what the loader has said last. It decides
nothing on code: it hands orders on as actions (`WriteProgram`, `ControlProgram`), and the loader answers by the event
`ProgramChanged`. A loader that does not answer leaves bit 0 set, and nothing else stops.

What has come is kept (`KeepParts`), at most once in KEEP_NS, so a transfer goes on after a restart, where it was up to
so long before. Whatever was kept, the SHA-256 of the whole decides.
"""

from enum import IntEnum

from heronry_agent.core.canopen.received_parts import ReceivedParts
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import ControlProgram, KeepParts, ProgramState, WriteProgram
from heronry_wire.sdo import Abort

KEEP_NS = 10_000_000_000  # a process is started each time
STOP, START, CLEAR = 0, 1, 3
_AT_WORK = 1


class FlashError(IntEnum):
    """Why the loader's last order failed: bits 7..1 of object 1F57h (CiA 302-3)."""

    NONE = 0
    NO_PROGRAM = 1
    UNKNOWN_FORMAT = 2
    DAMAGED = 3
    TOO_LARGE = 6
    WRITE = 5
    SECURED = 7


class Programs:
    """The objects of the loader of one PE."""

    def __init__(self, turn: Turn, state: ProgramState, kept: bytes = b"") -> None:
        """Begin with what the loader says at the start of the agent; kept: what was kept last (`KeepParts`)."""
        self._turn, self._state = turn, state
        self._is_at_work = False
        self._is_stopped = False
        self._parts = ReceivedParts(kept)
        self._keep_ns = turn.now_ns  # when to keep again what has come

    @property
    def version(self) -> int:
        """Return the value of 1F56h."""
        return self._state.version

    @property
    def control(self) -> int:
        """Return the value of 1F51h."""
        return START if self._state.version and not self._is_stopped else STOP

    @property
    def status(self) -> int:
        """Return the value of 1F57h."""
        return self._state.error << 1 | (_AT_WORK if self._is_at_work else 0)

    @property
    def received(self) -> bytes:
        """Return the value of 2030h sub 2."""
        return self._parts.encoded

    @property
    def active(self) -> bytes:
        """Return the value of 2030h sub 3."""
        return self._state.digest

    def takes_bytes(self) -> bool:
        """Tell whether something can be written now."""
        return not self._is_at_work

    def changed(self, state: ProgramState) -> None:
        """Take what the loader says."""
        self._state, self._is_at_work = state, state.is_at_work

    def write(self, content: bytes) -> Abort | None:
        """Hand a whole bundle to the loader."""
        if self._is_at_work:
            return Abort.DEVICE_STATE
        self._is_at_work = True
        self._parts.forget()
        self._turn.do(WriteProgram(content))
        return None

    def write_part(self, content: bytes) -> Abort | None:
        """Take one part of a bundle; the last one hands the bundle to the loader."""
        if self._is_at_work:
            return Abort.DEVICE_STATE
        whole = self._parts.take(content)
        if whole is None and self._turn.now_ns >= self._keep_ns:
            self._keep_ns = self._turn.now_ns + KEEP_NS
            self._turn.do(KeepParts(self._parts.as_one))
        return self.write(whole) if isinstance(whole, bytes) else whole

    def order(self, value: int) -> Abort | None:
        """Execute a write of 1F51h."""
        if value not in (STOP, START, CLEAR):
            return Abort.VALUE
        if self._is_at_work:
            return Abort.DEVICE_STATE
        self._is_stopped = value != START
        if value == CLEAR:
            self._parts.forget()
        if value != STOP:
            self._is_at_work = True
            self._turn.do(ControlProgram(is_start=value == START))
        return None
