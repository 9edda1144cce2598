"""One node's CAN controller on one bus: a mailbox for one frame, two error counters, and the state of its wires.

The node keeps its frames in a queue of its own, by priority, and hands over one at a time (protocol rule 13). A frame
that has been handed over waits for the bus in the mailbox and cannot be overtaken by a more urgent frame of the same
node; it is sent until it has been sent well (automatic retransmission), or until its time is over: the controller is
then told to abort it. (Most controllers can; SocketCAN has no call for it, and there one stale frame may go out when a
wire is mended. No consumer takes it: its sender is foreign by then.)

Error counters are those of ISO 11898-1 12.1.4, without the rules for single bits: a frame that fails costs its sender
8 and every receiver 1, one that succeeds gives back 1. Above 127 the controller is *error-passive*: it lets 8 bits go
by after each of its frames, so that others may go first. Above 255 it is *bus-off*: it neither sends nor hears, what
was in the mailbox is lost, and it is started again on purpose after `RESTART_NS` (Linux: `restart-ms`) and 128 times
11 bits.
"""

from collections.abc import Callable, Container
from dataclasses import dataclass, field

from heronry_wire.frame import Frame
from heronry_wire.sansio import Received

ERROR_PASSIVE_ABOVE = 127
BUS_OFF_ABOVE = 255
SUSPENDED_BITS = 8
RESTART_NS = 100_000_000
RESTART_BITS = 128 * 11


@dataclass(slots=True, eq=False)
class Waiting:
    """A frame in a queue or mailbox."""

    key: int  # arbitration key
    offer: int  # its number: of frames with equal keys the first goes first
    station: "Station"
    frame: Frame
    until_ns: int  # latest start


Urgency = tuple[int, int, Waiting]  # key and offer before all else: the most urgent one is the least


class _Everything:
    """Contains every identifier."""

    def __contains__(self, identifier: object) -> bool:
        return True


@dataclass(slots=True, eq=False)
class Station:
    """State of one controller; the bus changes it."""

    name: str
    port: int  # index of the bus among the node's own
    number: int  # among all stations that were ever on this bus
    listener: Callable[[Received], None]
    wants: Container[int] = field(default_factory=_Everything)  # identifiers; all others are filtered out
    left: Callable[[Frame], None] | None = None  # called whenever a frame has left
    can_send: bool = True  # the mailbox takes part in arbitration; follows from the five states below
    can_hear: bool = True  # follows from them too
    present: bool = True
    cut_off: bool = False  # neither sends nor hears
    receive_failed: bool = False  # sends, but does not hear
    transmit_failed: bool = False  # hears, but does not send
    off: bool = False  # bus-off
    stands_back_until_ns: int = 0  # until then only frames more urgent than data move to the mailbox
    stalled: bool = False  # the processor stands still: nothing moves from the queue to the mailbox
    fails: bool = False  # its transmitter destroys every frame it sends
    transmit_errors: int = 0
    receive_errors: int = 0
    mailbox: Waiting | None = None
    queue: list[Urgency] = field(default_factory=list)  # a heap

    def reconsider(self) -> None:
        """Compute anew, after a change of the wires, whether the station can send and hear."""
        self.can_send = self.present and not (self.cut_off or self.transmit_failed or self.off)
        self.can_hear = self.present and not (self.cut_off or self.receive_failed or self.off)

    @property
    def is_passive(self) -> bool:
        """Tell whether the station is error-passive."""
        return self.transmit_errors > ERROR_PASSIVE_ABOVE or self.receive_errors > ERROR_PASSIVE_ABOVE
