"""The queue of a gateway for a radio: limited, most urgent frame first, and only the newest frame of each kind.

    push      adds a frame. The new frame replaces an older frame of the same kind, for example a datum of the same
              source, or the previous LEASE: over a slow radio an old datum is worse than none. Frames of which none may
              be lost (slices, commands, emergencies) replace only an identical frame
    take      removes the most urgent frame that its class may send now

There are two classes of frames, data and management, since data must leave management the share of the bandwidth that
the spec reserves. SDO counts as data, but each of its frames is sent. The bandwidth of each class is limited by a token
bucket. Each frame counts with its worst-case length, as in plans, so the data of a plan that fits its bus also fit this
queue.

In three cases the queue drops a frame, and counts it as dropped:

- A newer datum replaces a datum.
- The queue is full: the least urgent frame is dropped.
- The time limit of a frame is so near that less time is left than one frame takes on the radio. (Otherwise the driver
  would drop the frame silently, and the port would wait a whole period for its departure.)
"""

from dataclasses import dataclass

from heronry_wire.canaerospace import type_and_service_of
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, Use, classify
from heronry_wire.state_frames import page_of
from heronry_wire.timing import worst_bits

CAPACITY = 64  # frames
DATA_BURST_BITS = 8 * worst_bits(8)
MANAGEMENT_BURST_BITS = 32 * worst_bits(8)  # a slice and its PREPARE
_NS_PER_S = 1_000_000_000
_DATA = frozenset((Use.STANDARD_DATA, Use.ALLOCATED_DATA))
_IN_DATAS_SHARE = _DATA | {Use.SDO_REQUEST, Use.SDO_RESPONSE}
_LATEST_COUNTS = _DATA | {Use.HEARTBEAT, Use.GATEWAY}
_LATEST_COMMANDS = frozenset((Command.LEASE, Command.ALIVE))
_PATIENT_COMMANDS = frozenset((Command.PREPARE, Command.SLICE, Command.ACTIVATE, Command.CONTROL))

_Key = tuple[int, bytes]


@dataclass(slots=True)
class Bucket:
    """A token bucket: `bits` may be sent now, and `rate` bit/s are added, up to `burst` bits."""

    rate: int
    burst: int
    bits: int
    filled_ns: int
    _rest: int = 0  # the fraction of a bit beyond `bits`, in billionths

    def fill(self, now_ns: int) -> None:
        """Add the bits that the bucket has gained since the last call, at `rate`; it holds at most `burst` bits."""
        gained = self.rate * (now_ns - self.filled_ns) + self._rest
        self.bits, self._rest = self.bits + gained // _NS_PER_S, gained % _NS_PER_S
        if self.bits >= self.burst:
            self.bits, self._rest = self.burst, 0
        self.filled_ns = now_ns

    def has_ns(self, bits: int) -> int:
        """Time in ns at which the bucket will have `bits`, if none are taken before."""
        if bits <= self.bits:
            return self.filled_ns
        missing = (bits - self.bits) * _NS_PER_S - self._rest
        return self.filled_ns - (-missing // max(1, self.rate))


@dataclass(slots=True)
class Waiting:
    """A frame in the queue, and what decides when it is sent or dropped.

    key: a newer frame with the same key replaces this one.
    order: among frames with the same identifier, the one with the lowest order is sent first.
    until_ns: time in ns after which the frame is dropped.
    bits: worst-case length of the frame.
    """

    frame: Frame
    key: _Key
    is_data: bool
    order: int
    until_ns: int
    bits: int


class RadioQueue:
    """Frames that wait for one radio."""

    def __init__(self, rate: int, data_per_mille: int, now_ns: int) -> None:
        """Begin with an empty queue and full token buckets: each class of frames may send a whole burst at once.

        rate: bandwidth of the radio in bit/s.
        data_per_mille: share of the bandwidth that data may take, in thousandths.
        """
        self.dropped = 0
        self._data_per_mille = data_per_mille
        self._under_way_ns = worst_bits(8) * _NS_PER_S // rate
        self._waiting: dict[_Key, Waiting] = {}
        self._pushed = 0
        self._data = Bucket(0, DATA_BURST_BITS, DATA_BURST_BITS, now_ns)
        self._management = Bucket(0, MANAGEMENT_BURST_BITS, MANAGEMENT_BURST_BITS, now_ns)
        self.pace(rate, now_ns)

    def __len__(self) -> int:
        return len(self._waiting)

    def pace(self, rate: int, now_ns: int) -> None:
        """Set the bandwidth that the queue may use to `rate` bit/s; data and management each get a part of it."""
        for bucket in (self._data, self._management):
            bucket.fill(now_ns)
        self._data.rate = rate * self._data_per_mille // 1000
        self._management.rate = rate - self._data.rate

    def push(self, frame: Frame, until_ns: int) -> None:
        """Add a frame; it will be dropped if it cannot leave before `until_ns`."""
        use = classify(frame.can_id)
        key = _key(frame, use.use, use.command)
        older = self._waiting.get(key)
        self._pushed += 1
        order = self._pushed if older is None else older.order
        is_data = use.use in _IN_DATAS_SHARE
        self.dropped += older is not None and use.use in _DATA
        self._waiting[key] = Waiting(frame, key, is_data, order, until_ns, worst_bits(len(frame.data)))
        if len(self._waiting) > CAPACITY:
            last = max(self._waiting.values(), key=_rank)
            del self._waiting[last.key]
            self.dropped += 1

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Drop the waiting frames with these CAN identifiers."""
        self._waiting = {key: one for key, one in self._waiting.items() if one.frame.can_id not in identifiers}

    def take(self, now_ns: int) -> Waiting | None:
        """Remove and return the most urgent frame that may be sent now; None if there is none.

        A frame may be sent if its token bucket, that of data or that of management, has enough bits for it.
        """
        self._expire(now_ns)
        for bucket in (self._data, self._management):
            bucket.fill(now_ns)
        may_go = [one for one in self._waiting.values() if one.bits <= self._bucket(one).bits]
        if not may_go:
            return None
        first = min(may_go, key=_rank)
        self._bucket(first).bits -= first.bits
        del self._waiting[first.key]
        return first

    def next_ns(self) -> int | None:
        """Time in ns at which `take` returns a frame, if no frame is added before; None while the queue is empty."""
        return min((self._bucket(one).has_ns(one.bits) for one in self._waiting.values()), default=None)

    def _bucket(self, one: Waiting) -> Bucket:
        return self._data if one.is_data else self._management

    def _expire(self, now_ns: int) -> None:
        late = [one.key for one in self._waiting.values() if one.until_ns < now_ns + self._under_way_ns]
        for key in late:
            del self._waiting[key]
        self.dropped += len(late)


def is_patient(frame: Frame) -> bool:
    """Tell whether a frame is a command that still has its effect when it comes late.

    These are all commands but LEASE, ALIVE, PING and TAG.
    """
    return classify(frame.can_id).command in _PATIENT_COMMANDS


def _rank(one: Waiting) -> tuple[int, int]:
    return one.frame.can_id, one.order


def _key(frame: Frame, use: Use, command: Command | None) -> _Key:
    """Key under which a frame waits: a newer frame with the same key replaces an older one."""
    if use in _LATEST_COUNTS or command in _LATEST_COMMANDS:
        return frame.can_id, b""
    if use is Use.STATE:
        page = page_of(frame.data)
        return frame.can_id, b"" if page is None else bytes((page,))  # one kind for each page
    if use is Use.ACTUATOR_ECHO:
        return frame.can_id, type_and_service_of(frame.data)  # one kind for each device
    return frame.can_id, frame.data
