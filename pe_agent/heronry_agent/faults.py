"""Faults found on this PE, told as EMCY until the manager has acknowledged each (rule 8).

A fault is pending from the moment it is found until CONTROL acknowledges its element; while it is pending it is sent
once in a heartbeat period, and finding it again adds nothing. An acknowledged fault that is still being reported, by a
monitor that runs 40 times a second, stays quiet for a second and is then pending again: the manager may have healed
the element in the meantime. A lost EMCY or a lost acknowledgement costs a repetition, a doubled one nothing.
"""

from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.sansio import NEVER_NS

QUIET_NS = 1_000_000_000

_ERROR_REGISTER = 0x81  # CiA 301 object 1001h: generic error, manufacturer specific
_Key = tuple[FaultCode, ElementKind, int]


class Faults:
    """Pending faults of one PE."""

    def __init__(self, node: int, period_ns: int) -> None:
        """`period_ns` is the heartbeat period of the bus on which EMCY goes out."""
        self._emcy_id = emcy_id(node)
        self._period_ns = period_ns
        self._pending: dict[_Key, tuple[int, Frame]] = {}  # when to send it again, and what
        self._quiet_until_ns: dict[_Key, int] = {}
        self.next_ns = NEVER_NS

    @property
    def pending(self) -> bool:
        """Tell whether some fault waits for its acknowledgement."""
        return bool(self._pending)

    def found(self, code: FaultCode, kind: ElementKind, index: int, detail: int, now_ns: int) -> Frame | None:
        """A fault was found: the EMCY to send now, or None while it is pending or quiet."""
        key = (code, kind, index)
        if key in self._pending:
            return None
        if code is FaultCode.REPORTED and now_ns < self._quiet_until_ns.get(key, now_ns):
            return None
        emergency = Emergency(code, _ERROR_REGISTER, kind, index, min(max(detail, 0), 0xFFFF))
        frame = Frame(self._emcy_id, emergency.encode())
        self._pending[key] = (now_ns + self._period_ns, frame)
        self._find_next()
        return frame

    def acknowledge(self, kind: int, index: int, now_ns: int) -> bool:
        """The manager has heard every fault of this element; tells whether one was pending."""
        heard = [key for key in self._pending if key[1:] == (kind, index)]
        for key in heard:
            del self._pending[key]
            self._quiet_until_ns[key] = now_ns + QUIET_NS
        self._find_next()
        return bool(heard)

    def tick(self, now_ns: int) -> list[Frame]:
        """Repeat what has not been acknowledged."""
        due = [(key, frame) for key, (at_ns, frame) in self._pending.items() if now_ns >= at_ns]
        for key, frame in due:
            self._pending[key] = (now_ns + self._period_ns, frame)
        self._find_next()
        return [frame for _, frame in due]

    def _find_next(self) -> None:
        self.next_ns = min((at_ns for at_ns, _ in self._pending.values()), default=NEVER_NS)
