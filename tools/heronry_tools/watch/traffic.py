"""The load of a bus, by kind of traffic, from its frames: over the last second, given twice a second.

Bits are counted exactly (`heronry_wire.timing`), in slots of 100 ms. `peak` is the busiest slot of the last second.
All times are those of the frames, so a recording gives the same figures as the flight.
"""

from collections import Counter, deque
from dataclasses import dataclass, field
from functools import cache

from heronry_manager.events import BusSeen
from heronry_wire.controller import read_error_frame
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Use, classify
from heronry_wire.timing import exact_bits

SLOT_NS = 100_000_000
SLOTS = 10  # of which the last second consists
TELL_SLOTS = 5
KINDS = ("commands", "states", "data", "echoes", "services", "other")

_KIND_OF = {
    Use.MANAGEMENT: "commands",
    Use.STATE: "states",
    Use.EMCY: "states",
    Use.HEARTBEAT: "states",
    Use.GATEWAY: "states",
    Use.STANDARD_DATA: "data",
    Use.ALLOCATED_DATA: "data",
    Use.CHECKPOINT: "data",
    Use.ACTUATOR_ECHO: "echoes",
    Use.NODE_SERVICE: "services",
    Use.NMT: "services",
    Use.TIME: "services",
    Use.SDO_REQUEST: "services",
    Use.SDO_RESPONSE: "services",
}


@cache
def kind_of(can_id: int) -> str:
    """Return the kind of traffic to which a standard identifier belongs."""
    return _KIND_OF.get(classify(can_id).use, "other")


@dataclass(slots=True)
class _Slot:
    number: int
    frames: int = 0
    bits: Counter[str] = field(default_factory=Counter)


class Traffic:
    """Counts the frames on one bus, and gives the load of the bus at regular times (event `bus_seen`)."""

    def __init__(self, bus: str, bit_rate: int) -> None:
        self.bus, self._bit_rate = bus, bit_rate
        self._slots: deque[_Slot] = deque(maxlen=SLOTS)
        self._next_tell: int | None = None  # number of the slot with whose start the next observation is due
        self._errors = 0
        self._error_state: str | None = None

    def take(self, t_ns: int, frame: Frame) -> None:
        """Count a frame that ended at `t_ns`; the caller calls `until(t_ns)` first."""
        if frame.error:
            report = read_error_frame(frame)
            self._errors += 1
            self._error_state = self._error_state if report.state is None else report.state.name.lower()
            return
        number = t_ns // SLOT_NS
        if not self._slots or self._slots[-1].number < number:
            self._slots.append(_Slot(number))
        slot = self._slots[-1]
        slot.frames += 1
        slot.bits["other" if frame.extended else kind_of(frame.can_id)] += exact_bits(frame)
        if self._next_tell is None:
            self._next_tell = number + TELL_SLOTS

    def until(self, t_ns: int) -> list[BusSeen]:
        """Return, in a list, the `bus_seen` event that is due at `t_ns` or earlier; an empty list if none is due.

        If several events are due after a pause, only the last of them is returned.
        """
        number = t_ns // SLOT_NS
        if self._next_tell is None or number < self._next_tell:
            return []
        end = number - (number - self._next_tell) % TELL_SLOTS
        self._next_tell = end + TELL_SLOTS
        return [self._figures(end)]

    def _figures(self, end: int) -> BusSeen:
        last = [slot for slot in self._slots if end - SLOTS <= slot.number < end]
        bits = sum((slot.bits for slot in last), Counter[str]())
        busiest = max((slot.bits.total() for slot in last), default=0)
        return BusSeen(
            end * SLOT_NS,
            bus=self.bus,
            load=round(bits.total() / self._bit_rate, 4),
            peak=round(busiest * SLOTS / self._bit_rate, 4),
            bits_per_s={kind: bits[kind] for kind in KINDS},
            frames_per_s=sum(slot.frames for slot in last),
            errors=self._errors,
            error_state=self._error_state,
        )
