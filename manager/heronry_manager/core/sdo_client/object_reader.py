"""Reads objects of PEs by SDO (CiA 301, 7.2.4), one at a time: details for which EMCY and state frames have no room.

    idle      nothing is being read
    opened    an object was requested. The answer has a short value itself, or the length of a long value
    segments  a long value comes in segments. Each segment is requested, `segment_ns` after the answer before; the
              toggle bit alternates
    left      another SDO client has made a request to the PE (`heard_other`). The PE is left to that client until
              SILENCE_NS after the client's last request. If an object of the PE was being read, the object is read
              anew after that. Other PEs are read meanwhile
    served    this manager brings something to the PE (`one_served`): its objects wait until that is over
    waiting   the last try gave no value, and the caller of `read` allows another try. The object is read anew after
              SILENCE_NS. Other objects are read meanwhile

A try ends without a value in three cases; then the next object in the queue is read:

    - the PE aborts the transfer
    - an answer does not fit the request
    - no answer comes within SILENCE_NS

If no try is left, the object counts as unreadable. If an object waits for another try and is requested once more, the
new request takes the place of that try.

    a lost answer     the try ends after SILENCE_NS
    a late answer     is dropped if no object of its PE is being read. Otherwise it ends the try of that object
    a doubled answer  ends the try, since the next answer was expected. After the last answer of a value it counts as
                      a late answer

A late or doubled answer that fits the request by chance gives a wrong value. SDO has no authentication, so any node can
forge an answer. The values are for people; no decision may depend on them.

A PE uses at most a tenth of the bus for its answers. A PE has one SDO server; in this server a new request replaces the
transfer of another client. So this client gives way to other clients. It can still disturb another client if its
request and the first request of that client are under way at the same time. If another client never pauses, this
client reads nothing from that PE.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id
from heronry_wire.sansio import NEVER_NS, Send
from heronry_wire.sdo import (
    COMMAND_BITS,
    EXPEDITED,
    LAST_SEGMENT,
    MESSAGE_BYTES,
    SEGMENT_UPLOAD,
    SEGMENT_UPLOAD_ANSWER,
    SIZE_GIVEN,
    TOGGLE,
    UPLOAD,
    UPLOAD_ANSWER,
    command_of,
    expedited_length,
    read_head,
    read_length,
    segment,
    segment_data,
    with_data,
)

SILENCE_NS = 1_000_000_000
"""The longest wait for one answer, in ns: a PE drops its client after that time. Also the pause before another try."""

_MOST_WAITING = 64
_MOST_BYTES = 4_096

Take = Callable[[bytes | None], None]
"""What to do with the value of an object; None: it cannot be read."""


@dataclass(slots=True, eq=False)
class _Reading:
    node: int
    index: int
    sub_index: int
    take: Take
    tries: int  # this one and those that may follow
    not_before_ns: int = 0  # 0: this is the first try
    length: int | None = None  # of a long value, once it is known
    data: bytes = b""
    toggle: int = 0
    is_paused: bool = False  # before the request for the next segment

    def anew(self) -> "_Reading":
        """Return a copy of this reading as it was before its first request."""
        return replace(self, length=None, data=b"", toggle=0, is_paused=False)

    def is_of(self, other: "_Reading") -> bool:
        """Tell whether this reading and the other one read the same object."""
        return (self.node, self.index, self.sub_index) == (other.node, other.index, other.sub_index)


@dataclass(slots=True)
class ObjectReader:
    """The SDO client of a manager.

    send: is called with each frame to send.
    segment_ns: least time in ns from an answer to the request for the next segment.
    next_ns: the time in ns at which to call `tick`.
    """

    send: Callable[[Send], None]
    segment_ns: int = 0
    next_ns: int = NEVER_NS
    _now: _Reading | None = None
    _waiting: deque[_Reading] = field(default_factory=deque)
    _left_until_ns: dict[int, int] = field(default_factory=dict)  # by node: another client has it

    def read(self, node: int, index: int, sub_index: int, take: Take, now_ns: int, *, tries: int = 1) -> None:
        """Queue an object for reading; `take` is called once, with the value of the object.

        `take` is called with None in four cases:

        - the object cannot be read
        - too many objects wait already
        - the object waits for another try, and is requested once more
        - the reader has to drop all objects (`give_up`)

        tries: largest number of tries; another try follows only if the last one gave no value.
        """
        reading = _Reading(node, index, sub_index, take, tries)
        for replaced in [one for one in self._waiting if one.is_of(reading) and one.not_before_ns]:
            self._waiting.remove(replaced)
            replaced.take(None)
        if len(self._waiting) >= _MOST_WAITING:
            take(None)
            return
        self._waiting.append(reading)
        self._begin_next(now_ns)

    def heard(self, node: int, message: bytes, now_ns: int) -> None:
        """Process an answer of a PE's SDO server; drop the answer if this manager awaits none from this PE."""
        reading = self._now
        if reading is None or reading.node != node:
            return
        is_good = len(message) == MESSAGE_BYTES and self._take(reading, message)
        if not is_good:
            self._end(None, now_ns)
        elif reading.length == len(reading.data):
            self._end(reading.data, now_ns)
        elif self.segment_ns:
            reading.is_paused, self.next_ns = True, now_ns + self.segment_ns
        else:
            self._ask_on(reading, now_ns)

    def is_reading(self, node: int) -> bool:
        """Tell whether an object of this node is being read."""
        return self._now is not None and self._now.node == node

    def leave(self, node: int, now_ns: int) -> None:
        """Read nothing from a node until SILENCE_NS after the next `heard_other`."""
        self._left_until_ns[node] = NEVER_NS
        self._begin_next(now_ns)

    def heard_other(self, node: int, now_ns: int) -> None:
        """Note that another client has sent a request to a PE, and leave the PE to that client for SILENCE_NS."""
        self._left_until_ns[node] = now_ns + SILENCE_NS
        reading = self._now
        if reading is not None and reading.node == node:
            self._now = None
            self._waiting.appendleft(reading.anew())
        self._begin_next(now_ns)

    def tick(self, now_ns: int) -> None:
        """End a try whose answer has not come within SILENCE_NS; begin to read the next object that may be read."""
        if now_ns < self.next_ns:
            return
        if self._now is None:
            self._begin_next(now_ns)
        elif self._now.is_paused:
            self._ask_on(self._now, now_ns)
        else:
            self._end(None, now_ns)

    def give_up(self) -> None:
        """Drop all objects that are being read or queued, since this manager is not active any more."""
        given_up = [*([] if self._now is None else [self._now]), *self._waiting]
        self._now, self.next_ns = None, NEVER_NS
        self._waiting.clear()
        for reading in given_up:
            reading.take(None)

    def _ask_on(self, reading: _Reading, now_ns: int) -> None:
        reading.is_paused = False
        self._say(segment(SEGMENT_UPLOAD | reading.toggle, b""), now_ns)

    def _take(self, reading: _Reading, message: bytes) -> bool:
        """Process an answer to the present request; tells whether the answer fits that request."""
        command = command_of(message)
        if reading.length is None:
            return self._opened(reading, command, message)
        if command & (COMMAND_BITS | TOGGLE) != SEGMENT_UPLOAD_ANSWER | reading.toggle:
            return False
        reading.data += segment_data(message)
        reading.toggle ^= TOGGLE
        return bool(command & LAST_SEGMENT) == (len(reading.data) == reading.length)

    def _opened(self, reading: _Reading, command: int, message: bytes) -> bool:
        index, sub_index, rest = read_head(message)
        if command & COMMAND_BITS != UPLOAD_ANSWER or (index, sub_index) != (reading.index, reading.sub_index):
            return False
        if command & EXPEDITED:
            reading.data = rest[: expedited_length(command) if command & SIZE_GIVEN else None]
            reading.length = len(reading.data)
        else:
            reading.length = read_length(rest)
        return reading.length <= _MOST_BYTES

    def _begin_next(self, now_ns: int) -> None:
        if self._now is not None:
            return
        self.next_ns = min((self._free_ns(reading) for reading in self._waiting), default=NEVER_NS)
        if self.next_ns <= now_ns:
            self._now = next(reading for reading in self._waiting if self._free_ns(reading) <= now_ns)
            self._waiting.remove(self._now)
            self._say(with_data(UPLOAD, self._now.index, self._now.sub_index), now_ns)

    def _free_ns(self, reading: _Reading) -> int:
        return max(reading.not_before_ns, self._left_until_ns.get(reading.node, 0))

    def _say(self, message: bytes, now_ns: int) -> None:
        assert self._now is not None
        self.next_ns = now_ns + SILENCE_NS
        self.send(Send(0, Frame(sdo_request_id(self._now.node), message)))

    def _end(self, value: bytes | None, now_ns: int) -> None:
        reading, self._now, self.next_ns = self._now, None, NEVER_NS
        assert reading is not None
        if value is None and reading.tries > 1 and not any(one.is_of(reading) for one in self._waiting):
            again = replace(reading.anew(), tries=reading.tries - 1, not_before_ns=now_ns + SILENCE_NS)
            self._waiting.append(again)
        else:
            reading.take(value)
        self._begin_next(now_ns)
