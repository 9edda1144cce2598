"""A gateway's port to a radio: it sends one frame at a time, and measures how fast the radio is (protocol rule 9).

Frames wait in `radio_queue`. The next frame is handed to the CAN controller only when the one before has left it
(`Left`). So more urgent and newer frames can still overtake the others, and the time that a frame takes can be
measured. From these times `link_meter` computes the usable bandwidth. The queue sends at the measured rate plus a
tenth: if the measurement is a little too low, the data that the plan sends over the radio still pass. The port also
reports the usable bandwidth to the manager, once in a heartbeat period of the radio, and immediately when the radio is
gone or back.

A frame without a time limit of its own is dropped when it has waited for T_lease (five heartbeat periods of the
uplink), as on every bus. Commands that have the same effect when they come late may wait for five heartbeat periods of
the radio instead, which may be longer. If no `Left` has come for a frame after a period of the radio, the port stops
waiting for it and sends the next one. This also happens if the frame has left but the event `Left` was lost in an
overrun of a receive queue; then the port has idled for that period.
"""

from heronry_agent.core.forwarding.link_meter import LinkMeter
from heronry_agent.core.forwarding.radio_queue import RadioQueue, is_patient
from heronry_agent.core.table_index import TableIndex
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import PER_MILLE, SEQUENCES, LinkReport, LinkState
from heronry_wire.sansio import NEVER_NS, Send

_HEADROOM_PERCENT = 110
_LEAST_PACE = 50  # per mille of the bit rate: without frames the usable bandwidth could not be measured
_PATIENCE_PERIODS = 5


class RadioPort:
    """A port by which a gateway sends over a radio, away from the manager."""

    def __init__(self, port: int, index: TableIndex, now_ns: int) -> None:
        """Begin to measure the bandwidth of the radio, and to report it to the manager.

        port: number of the port in the table.
        """
        entry = index.table.ports[port]
        self.next_ns = self._report_ns = now_ns + entry.heartbeat_ns
        self._port, self._entry, self._node, self._uplink = port, entry, index.node, index.uplink
        self._lease_ns = index.lease_ns
        self._queue = RadioQueue(entry.bitrate, entry.data_per_mille, now_ns)
        self._meter = LinkMeter(entry.bitrate, entry.heartbeat_ns, entry.misses, now_ns)
        self._in_flight: tuple[Frame, int] | None = None  # the frame in the controller, and when it was handed over
        self._moved = False  # whether a frame came or left since the last step
        self._sequence = 0

    def heard(self, frame: Frame, now_ns: int) -> list[Send]:
        """Note a frame that came from the radio; returns the report that the radio is back, if it was gone."""
        return self._report(now_ns) if self._meter.heard(frame, now_ns) else []

    def send(self, frame: Frame, until_ns: int | None, since_ns: int) -> None:
        """Queue a frame for the radio.

        until_ns: time in ns at which to drop the frame. None: T_lease after `since_ns` or, for a command that has the
            same effect when it comes late (`is_patient`), five heartbeat periods of the radio after `since_ns`.
        since_ns: time in ns at which the frame was made here, or arrived here to be forwarded.
        """
        patience_ns = _PATIENCE_PERIODS * self._entry.heartbeat_ns if is_patient(frame) else self._lease_ns
        self._queue.push(frame, since_ns + patience_ns if until_ns is None else until_ns)
        self._moved = True

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Drop the unsent frames with these CAN identifiers."""
        self._queue.withdraw(identifiers)

    def left(self, took_ns: int) -> None:
        """Note that the frame in the controller has left it, `took_ns` after it was handed over; 0: time unknown."""
        if self._in_flight is not None:
            self._meter.left(self._in_flight[0], took_ns)
            self._in_flight, self._moved = None, True

    def step(self, now_ns: int) -> list[Send]:
        """Return the frames to send now: the report to the manager, if it is due, and the radio's next frame."""
        if now_ns < self.next_ns and not self._moved:
            return []
        self._moved = False
        out = self._reports(now_ns)
        if self._in_flight is not None and now_ns >= self._given_up_ns():
            self._meter.stuck(now_ns - self._in_flight[1])
            self._in_flight = None
        if self._in_flight is None:
            out += self._hand_over(now_ns)
        self.next_ns = self._find_next_ns()
        return out

    def _reports(self, now_ns: int) -> list[Send]:
        """Return the report on the radio to the manager, if it is due now; else an empty list.

        It is due when a heartbeat period of the radio has ended, and when the radio has just gone.
        """
        is_gone, is_due = now_ns >= self._meter.gone_ns, now_ns >= self._report_ns
        self._meter.gone = self._meter.gone or is_gone
        if is_due:
            self._meter.next_period()
            periods = (now_ns - self._report_ns) // self._entry.heartbeat_ns + 1
            self._report_ns += periods * self._entry.heartbeat_ns
        return self._report(now_ns) if is_gone or is_due else []

    def _hand_over(self, now_ns: int) -> list[Send]:
        first = self._queue.take(now_ns)
        if first is None:
            return []
        self._in_flight = first.frame, now_ns
        self._meter.handed_over()
        return [Send(self._port, first.frame, first.until_ns)]

    def _given_up_ns(self) -> int:
        assert self._in_flight is not None
        return self._in_flight[1] + self._entry.heartbeat_ns

    def _find_next_ns(self) -> int:
        waits_ns = self._queue.next_ns() if self._in_flight is None else self._given_up_ns()
        return min(self._report_ns, self._meter.gone_ns, NEVER_NS if waits_ns is None else waits_ns)

    def _report(self, now_ns: int) -> list[Send]:
        """Return the report to the manager, and set the pace of the queue to 1.1 times the usable bandwidth.

        The pace is at most the bit rate of the radio, and at least a twentieth of it, even if no bandwidth is usable.
        """
        usable = 0 if self._meter.gone else self._meter.usable()
        pace = max(_LEAST_PACE, min(PER_MILLE, usable * _HEADROOM_PERCENT // 100))
        self._queue.pace(self._entry.bitrate * pace // PER_MILLE, now_ns)
        self._sequence = (self._sequence + 1) % SEQUENCES
        report = LinkReport(
            node=self._node,
            state=LinkState.GONE if self._meter.gone else LinkState.UP,
            sequence=self._sequence,
            usable=usable,
            delivered=self._meter.delivered_percent(),
            queued=len(self._queue),
            dropped=self._queue.dropped,
        )
        assert self._entry.link_id is not None
        return [Send(self._uplink, Frame(self._entry.link_id, report.encode()))]
