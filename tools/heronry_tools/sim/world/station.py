"""A node's CAN controller on one bus: a mailbox for one frame, two error counters, and the state of its wires.

*Mailbox.* The node keeps its frames in its own queue, by priority, and moves one at a time to the mailbox (protocol
rule 13). A more urgent frame of the same node cannot overtake the frame in the mailbox. The frame in the mailbox is
repeated until it is sent without error (automatic retransmission), or until its time limit has passed and the node
aborts it. (A real node with SocketCAN cannot abort a frame, although most controllers could. So it may send one old
frame when a wire is mended. No consumer accepts this frame: by then its sender is not the source of the datum.)

*Error counters.* They follow ISO 11898-1 12.1.4, without the rules for single bits. A failed frame adds 8 at its sender
and 1 at every receiver; a frame without error subtracts 1.

    above 127    *error-passive*: the controller waits for 8 bits after each of its frames, so that others may send
                 first
    above 255    *bus-off*: the controller neither sends nor hears, and the frame in the mailbox is lost. The controller
                 is restarted after `RESTART_NS` (Linux: `restart-ms`) and then 128 times 11 bits
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
    """A frame that waits in a queue or mailbox."""

    key: int  # arbitration key
    offer: int  # serial number: of frames with equal keys the lower is sent first
    station: "Station"
    frame: Frame
    until_ns: int  # latest start of its transmission


Urgency = tuple[int, int, Waiting]  # key, offer, frame: the most urgent one is the smallest


class _Everything:
    """A set that contains every identifier."""

    def __contains__(self, identifier: object) -> bool:
        return True


@dataclass(slots=True, eq=False)
class Station:
    """The state of one CAN controller on a simulated bus; the bus changes this state."""

    name: str
    port: int  # index of the bus among the node's buses
    number: int  # serial number among all stations that were ever on this bus
    listener: Callable[[Received], None]
    wants: Container[int] = field(default_factory=_Everything)  # identifiers; all others are filtered out
    left: Callable[[Frame], None] | None = None  # called whenever a frame has been sent
    can_send: bool = True  # the mailbox takes part in arbitration; follows from the five states below
    can_hear: bool = True  # follows from the same states
    present: bool = True
    cut_off: bool = False  # neither sends nor hears
    receive_failed: bool = False  # sends, but does not hear
    transmit_failed: bool = False  # hears, but does not send
    off: bool = False  # bus-off
    stands_back_until_ns: int = 0  # until then only frames more urgent than data move to the mailbox
    stalled: bool = False  # the processor is paused: nothing moves from the queue to the mailbox
    fails: bool = False  # its transmitter destroys every frame it sends
    transmit_errors: int = 0
    receive_errors: int = 0
    mailbox: Waiting | None = None
    queue: list[Urgency] = field(default_factory=list)  # a heap

    def reconsider(self) -> None:
        """Recompute `can_send` and `can_hear` after a change of the wires."""
        self.can_send = self.present and not (self.cut_off or self.transmit_failed or self.off)
        self.can_hear = self.present and not (self.cut_off or self.receive_failed or self.off)

    @property
    def is_passive(self) -> bool:
        """Tell whether the station is error-passive."""
        return self.transmit_errors > ERROR_PASSIVE_ABOVE or self.receive_errors > ERROR_PASSIVE_ABOVE
