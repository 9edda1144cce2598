"""One bus of one node: frames in and out of python-can, the most urgent first (protocol rule 13).

*Sending.* A frame that was handed to the controller is *in flight* until its echo comes: with `receive_own_messages`,
python-can gives each frame back to its sender when the frame was sent. The link recognizes the echo by its identifier
and bytes. (SocketCAN marks the frames of this computer by a flag, but the frames of other programs have this flag,
too.) The next frame is handed over only after the echo. So if a more urgent frame is queued meanwhile, it goes first.
The hub of a software bus is a controller with several mailboxes, which compete by priority and from which frames can be
withdrawn: it takes that many frames at once. If an echo does not come within `ECHO_TIMEOUT_NS` (bus-off, an overrun of
the receive queue), the link gives the frame up and counts it. If the echo comes after all, the link still recognizes
it, and does not take it for a frame of another node. If the controller's own queue is full (ENOBUFS, a busy mailbox),
the link tries the frame again a millisecond later.

*Times.* Each arrival has a time: the link converts the time-stamp of the frame to the monotonic clock
(`arrival_times`). So a process that was paused does not take old frames for new ones, and setting the computer's time
of day changes nothing.

*States.* No error ends a link that was once open:

    open   frames go in and out
    lost   the interface is down or gone, the hub has ended, the controller is bus-off, or a back-end has raised an
           exception. The link closes the bus, drops all frames in its queue and all new ones, and tries to open the bus
           again every REOPEN_NS. It first restarts a SocketCAN interface whose controller is bus-off, unless Linux
           itself will do this (restart-ms). It does not use an interface with another bit rate than requested: sending
           there would destroy frames. A bus that may take seconds to open (`slow_opening`) is opened in a thread

`health` tells since when the bus has been lost, gives the link status events as sentences, and counts errors. LinkError
is raised only at the start, if the bus cannot be opened then. A channel of a replicated bus (`replicated_link`) may be
lost from the start, without an error.

*Filters.* A node need not receive all frames: `accept` makes the kernel (or the hub of a software bus) filter out
identifiers that the node does not take. Filters apply to echoes as well. So an identifier that is sent for the first
time is added to the filter before the frame goes out. `thin` leaves out most of the states that say nothing new.
`accept` may also name identifiers that wake nobody, if `be_patient` was called (`patient_port`).

*Haste.* While a driver says that nothing is urgent (`is_calm`), a frame may take a moment on a software bus, and its
echo may wait until another frame comes anyway, so that it wakes nobody. If another frame is queued meanwhile, the link
asks for the echo.

*Back-ends.* SocketCAN and the software bus echo frames and stamp them with this machine's clock; when `recv` gives
nothing, they have nothing left to read. Other back-ends may differ. With such a back-end a frame counts as sent when
`send` returns, and as arrived when the link reads it. The link itself drops frames that the node does not take, and
calls `recv` again while there is something to read. `frame_port` does the reading and the sending.
"""

import select
import socket
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from operator import attrgetter
from typing import Any

from heronry_wire.bare_can import can
from heronry_wire.bus_health import BusHealth
from heronry_wire.bus_opening import LinkError, Opened, bus_name, look_at_interface, open_bus
from heronry_wire.controller import ControllerState, read_error_frame
from heronry_wire.errors import HeronryError
from heronry_wire.frame import Frame
from heronry_wire.frame_port import WELL_KNOWN, Arrival, FramePort, Haste, port_of
from heronry_wire.patient_port import PatientPort
from heronry_wire.python_can import frames_dropped, is_full, sentence_of
from heronry_wire.slow_opening import SlowOpening
from heronry_wire.socketcand import see_whether_it_ended
from heronry_wire.thinning import Thinned
from heronry_wire.transmit_queue import TransmitQueue

ECHO_TIMEOUT_NS = 100_000_000
RETRY_NS = 1_000_000
REOPEN_NS = 250_000_000
STUCK_NS = 1_000_000_000  # if no frame leaves for so long, the bus is reported stuck
_BURST = 64  # most frames read in one turn: a flood must not starve the timers
_LATE_ECHOES = 16  # how many of the frames whose echo was given up are remembered
_arrival_ns = attrgetter("time_ns")


class Link:
    """One bus of a node: a python-can bus, with a queue of the frames to send."""

    def __init__(self, config: Mapping[str, Any], *, may_begin_lost: bool = False) -> None:
        """Open the bus that these keyword arguments of `can.Bus` describe; raises LinkError.

        may_begin_lost: do not raise where the bus cannot be opened now, but begin as a lost bus.
        """
        self.name = bus_name(config)
        self.health = BusHealth(self.name)
        self.echoes_lost = 0
        self.has_more = False  # the last `receive` took a whole burst
        self.queue = TransmitQueue()
        self.on_departure: Callable[[Frame, int, int], None] | None = None  # takes frame, now_ns, ns in the controller
        self._in_flight: list[tuple[Frame, int]] = []  # each with the time at which it was handed over
        self._departed: deque[int] = deque(maxlen=_BURST)  # ns in the controller, as `departures_ns` gives them
        self._given_up: deque[Frame] = deque(maxlen=_LATE_ECHOES)
        self._waiting_since_ns: int | None = None  # since when no frame has left
        self._again_ns: int | None = None  # when to try again to hand over a frame, or to open the bus
        self._wanted: frozenset[int] | None = None  # None: all identifiers
        self._sent: set[int] = set()  # identifiers whose echoes must pass the filters
        self._overruns = 0
        self._thinned: Thinned | None = None
        self._patient: frozenset[int] = frozenset()  # identifiers of the frames that wake nobody
        self._may_be_patient = False
        self._patient_port: PatientPort | None = None  # of the open bus
        self.is_calm = False  # nothing is urgent: frames may take a moment
        self.one_at_a_time = False  # even if the controller has several mailboxes
        self._config = {**config, "receive_own_messages": True}
        self._is_well_known = False
        self._fileno = -1
        self._bus: can.BusABC | None = None
        self._port: FramePort | None = None  # of the open bus
        self._connection: socket.socket | None = None  # as in `Opened`
        self._opening: SlowOpening | None = None
        if may_begin_lost:
            self._try_to_open(time.monotonic_ns(), None)
        else:
            self._open()

    @property
    def is_open(self) -> bool:
        """Tell whether the bus is open, so that `fileno` gives a descriptor."""
        return self._bus is not None

    @property
    def readers(self) -> Sequence["Link"]:
        """Return the links whose file descriptors are to be watched for incoming frames."""
        return (self,) if self._bus is not None else ()

    @property
    def off_since_ns(self) -> int | None:
        """Time in ns at which the bus was lost; None while it can be used."""
        return self.health.off_since_ns

    @property
    def has_link_events(self) -> bool:
        """Tell whether `take_link_events` has something to give."""
        return self.health.has_link_events

    def take_link_events(self) -> list[str]:
        """Return the link status events since the last call, each as a sentence."""
        return self.health.take_link_events()

    @property
    def nothing_waits(self) -> bool:
        """Tell whether no queued frame waits to be handed to the controller."""
        return not self.queue

    @property
    def all_left(self) -> bool:
        """Tell whether every queued frame has been sent on the bus."""
        return self._bus is not None and not self.queue and not self._in_flight and self._again_ns is None

    def fileno(self) -> int:
        """File descriptor that is readable when `receive` has frames; to be called only while `is_open`."""
        return self._fileno

    def send(self, frame: Frame, now_ns: int, until_ns: int | None = None) -> None:
        """Queue a frame; the link hands its most urgent frame to the controller once no other frame is in flight.

        until_ns: time in ns, on the clock of `now_ns`, after which the frame is dropped if it still waits. None: never.
        """
        if self.put(frame, until_ns):
            self.pump(now_ns)

    def put(self, frame: Frame, until_ns: int | None) -> bool:
        """Queue a frame for the next `pump`; on a lost bus, drop the frame and return False."""
        if self._bus is None:
            self.health.counts["not sent while lost"] += 1
            self._departed.append(0)  # a caller that waits for the frame to leave the queue must not wait for ever
            return False
        self.queue.push(frame, until_ns)
        if self._port is not None and len(self._in_flight) >= self._mailboxes():
            with self._surviving(time.monotonic_ns()):
                self._port.want_echo()
        return True

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Remove the queued frames with these identifiers.

        A frame that the controller already has is still sent, unless the controller can withdraw it.
        """
        self.queue.withdraw(identifiers)
        if self._port is not None and self._port.mailboxes > 1:
            withdrawn = [one for one in self._in_flight if one[0].can_id in identifiers and not one[0].extended]
            self._in_flight = [one for one in self._in_flight if one not in withdrawn]
            self._given_up.extend(frame for frame, _ in withdrawn)  # one of them may just have left
            if withdrawn:
                with self._surviving(time.monotonic_ns()):
                    self._port.withdraw(identifiers)

    def stand_back(self, until_ns: int) -> None:
        """Until `until_ns`, keep data frames, and frames with a lower priority than data, in the queue."""
        self.queue.stands_back_until_ns = until_ns

    def be_patient(self) -> None:
        """From now on let frames that `accept` calls patient wake nobody, if the back-end can do that.

        Then `receive` is to be called whenever the node wakes, and at least once in PATIENCE_NS.
        """
        self._may_be_patient = True
        with self._surviving(time.monotonic_ns()):
            self._open_patient_port()

    @property
    def is_patient(self) -> bool:
        """Tell whether frames may have come that wake nobody."""
        return self._patient_port is not None and bool(self._patient)

    def accept(self, identifiers: Collection[int], patient: frozenset[int] = frozenset()) -> None:
        """From now on receive only frames with these 11-bit identifiers.

        patient: those of them that need not make `fileno` readable (`be_patient`).
        """
        self._wanted, self._patient = frozenset(identifiers), patient
        with self._surviving(time.monotonic_ns()):
            self._set_filters()

    def thin(self, group: Thinned) -> None:
        """From now on receive only what `group` needs of its identifiers, as far as the back-end can."""
        self._thinned = group
        if self._port is not None:
            with self._surviving(time.monotonic_ns()):
                self._port.thin(group)

    @property
    def gathers(self) -> bool:
        """Tell whether the bus gathers frames for a moment, so that its reader need not."""
        return self._port is not None and self._port.gathers

    def receive(self, now_ns: int) -> list[Arrival]:
        """Read the frames that have arrived, up to a limit, without waiting; echoes and error frames are left out."""
        arrivals: list[Arrival] = []
        self.has_more = False
        if self._port is None:
            return arrivals
        try:  # not `_surviving`, which costs more than an empty read
            read, self.has_more = self._port.read(now_ns, _BURST)
            if self._patient_port is not None:
                read = self._with_patient_ones(self._patient_port, read, now_ns)
            for arrival in read:
                frame = arrival.frame
                if frame.error:
                    self._take_error_frame(frame, now_ns)
                elif self._wants(frame) and not self._is_echo(arrival, now_ns):
                    arrivals.append(arrival)
            if self.has_more:
                self._count_overruns(now_ns)
        except Exception as error:  # noqa: BLE001 - a back-end may raise anything
            self._lose(sentence_of(error), now_ns)
        return arrivals

    def pump(self, now_ns: int) -> None:
        """Hand the most urgent frame to the controller if the controller has no frame of this link.

        The driver calls this after `send`, and at `next_deadline_ns`.
        """
        if self._again_ns is not None:
            if now_ns < self._again_ns:
                return
            self._again_ns = None
        if self._bus is None:
            self._open_again(now_ns)
        while self._in_flight and now_ns >= self._in_flight[0][1] + ECHO_TIMEOUT_NS:
            self._given_up.append(self._in_flight.pop(0)[0])
            self.echoes_lost += 1
        if self._waiting_since_ns is not None and now_ns - self._waiting_since_ns > STUCK_NS:
            self.health.stuck(now_ns)
        if not self.queue:
            return
        with self._surviving(now_ns):
            while (
                self._port is not None
                and len(self._in_flight) < self._mailboxes()
                and (frame := self.queue.first(now_ns)) is not None
                and self._hand_over(frame, now_ns)
            ):
                pass
            if self._port is not None:
                self._port.flush()

    def next_deadline_ns(self) -> int | None:
        """Time in ns at which `pump` must be called next; None where there is no such time."""
        if self._again_ns is not None:
            return self._again_ns
        due_ns = self._in_flight[0][1] + ECHO_TIMEOUT_NS if self._in_flight else None
        if len(self.queue) and len(self._in_flight) < self._mailboxes():
            return self.queue.stands_back_until_ns if due_ns is None else min(self.queue.stands_back_until_ns, due_ns)
        return due_ns

    def close(self) -> None:
        """Close the bus."""
        self._port = None
        if self._patient_port is not None:
            patient_port, self._patient_port = self._patient_port, None
            patient_port.close()
        if self._opening is not None:
            self._opening.abandon()
            self._opening = None
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    @contextmanager
    def _surviving(self, now_ns: int) -> Iterator[None]:
        """Treat any exception that the bus raises in this context as a loss of the bus."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - a back-end may raise anything
            self._lose(sentence_of(error), now_ns)

    def _lose(self, reason: str, now_ns: int) -> None:
        with suppress(Exception):  # the bus is broken, and may raise again
            self.close()
        self._bus = self._port = None
        self.health.lost(now_ns, reason)
        dropped = self.queue.clear() + len(self._in_flight)
        self.health.counts["not sent while lost"] += dropped
        self._departed.extend([0] * dropped)
        self._waiting_since_ns = None
        self._in_flight.clear()
        self._given_up.clear()
        self._again_ns = now_ns + REOPEN_NS

    def _open(self, opened: Opened | None = None) -> None:
        """Open the bus, or take the bus in `opened`, and check that the bus works; raises LinkError."""
        look_at_interface(self._config)
        bus, self._fileno, self._connection = opened or open_bus(self._config)
        try:
            bus.recv(0)  # an interface that is down can be opened, and fails here
            look_at_interface(self._config)  # again: it may have come up since then, at another bit rate
            self._bus = bus
            self._is_well_known = bus.channel_info.partition(" ")[0] in WELL_KNOWN
            self._port = port_of(bus, has_nothing_left=self._has_nothing_left, noise=self._noted_noise)
            self._open_patient_port()
            self._set_filters()
            if self._thinned is not None:
                self._port.thin(self._thinned)
        except Exception as error:
            self._bus = bus
            self.close()
            if isinstance(error, LinkError):
                raise
            raise LinkError(f"{self.name} cannot be opened: {sentence_of(error)}") from error
        self._overruns = 0

    def _open_patient_port(self) -> None:
        if self._may_be_patient and self._is_well_known and self._bus is not None:
            self._patient_port = PatientPort(self._config)
            self._set_filters()

    def _with_patient_ones(self, port: PatientPort, read: list[Arrival], now_ns: int) -> list[Arrival]:
        """Return the frames that have been read, and those that woke nobody, in the order of their arrival."""
        patient, has_more = port.read(now_ns, _BURST)
        self.has_more = self.has_more or has_more
        return sorted(read + patient, key=_arrival_ns) if read and patient else read or patient

    def _open_again(self, now_ns: int) -> None:
        if self._is_well_known or self._config.get("interface") in WELL_KNOWN:
            self._try_to_open(now_ns, None)
            return
        self._opening = self._opening or SlowOpening(partial(open_bus, self._config))
        result = self._opening.result
        if result is None:
            self._again_ns = now_ns + REOPEN_NS
            return
        self._opening = None
        self._try_to_open(now_ns, result)

    def _try_to_open(self, now_ns: int, result: Opened | HeronryError | None) -> None:
        """Try to bring back a lost bus.

        result: the bus that a thread has opened, or the error with which the thread failed; None: open the bus here,
        without a thread.
        """
        try:
            if isinstance(result, HeronryError):
                raise result
            self._open(result)
        except HeronryError as error:
            self.health.lost(now_ns, str(error).partition(": ")[2])
            self._again_ns = now_ns + REOPEN_NS
        else:
            self.health.back(now_ns)

    def departures_ns(self) -> list[int]:
        """Return, for each frame that left the queue since the last call, for how long the controller had it, in ns.

        0 means that the time is not known, or that the frame was dropped because the bus is lost.
        """
        departed = list(self._departed)
        self._departed.clear()
        return departed

    def _is_echo(self, arrival: Arrival, now_ns: int) -> bool:
        """Tell whether a received frame is the echo of a frame that this link has handed to the controller.

        If it is the echo of the frame in flight, the next frame is handed to the controller.
        """
        frame = arrival.frame
        for place, (sent, handed_ns) in enumerate(self._in_flight):
            if sent == frame:
                self._left(frame, now_ns, max(1, arrival.time_ns - handed_ns))
                del self._in_flight[place]
                self._waiting_since_ns = now_ns if self._in_flight else None
                self.pump(now_ns)
                return True
        if self._given_up and frame in self._given_up:
            self._given_up.remove(frame)
            self._waiting_since_ns = None
            return True
        return False

    def _left(self, frame: Frame, now_ns: int, took_ns: int) -> None:
        self._departed.append(took_ns)
        if self.on_departure is not None:
            self.on_departure(frame, now_ns, took_ns)

    def _take_error_frame(self, frame: Frame, now_ns: int) -> None:
        report = read_error_frame(frame)
        self.health.reported(report, now_ns)
        if report.state is ControllerState.BUS_OFF:
            self._lose("its controller is bus-off", now_ns)

    def _count_overruns(self, now_ns: int) -> None:
        """Count the received frames for which SocketCAN had no room since the last call."""
        dropped = 0 if self._bus is None else frames_dropped(self._bus)
        dropped += 0 if self._patient_port is None else self._patient_port.dropped
        self.health.overrun(dropped - self._overruns, now_ns)
        self._overruns = dropped

    def _noted_noise(self) -> None:
        self.health.counts["not understood"] += 1

    def _has_nothing_left(self) -> bool:
        """Tell, after `recv` has given None, whether no frame is left to read.

        A None alone does not show this: `recv` also gives None if a serial modem has sent an answer, which is no frame.
        Raises OSError if the connection has ended.
        """
        if self._is_well_known or self._bus is None:
            return True
        if self._connection is not None:
            see_whether_it_ended(self._connection)
        return not select.select([self._fileno], [], [], 0)[0]

    def _wants(self, frame: Frame) -> bool:
        """Tell whether the node wants a frame; always true where the back-end itself filters."""
        if self._is_well_known or self._wanted is None:
            return True
        return frame.can_id in self._wanted and not frame.extended

    def _set_filters(self) -> None:
        if self._wanted is None or self._bus is None or not self._is_well_known:
            return
        patient: frozenset[int] = frozenset()
        if self._patient_port is not None:  # its filter comes first, so that no frame is missed between the two
            patient = self._patient - self._sent
            self._patient_port.accept(patient)
        accepted = sorted((self._wanted - patient) | self._sent)
        self._bus.set_filters([{"can_id": one, "can_mask": 0x7FF, "extended": False} for one in accepted])

    def _mailboxes(self) -> int:
        """Return how many frames the controller may have at once."""
        return 1 if self.one_at_a_time or self._port is None else self._port.mailboxes

    def _haste(self) -> Haste:
        """Return the haste of the first frame in the queue."""
        if not self.is_calm:
            return Haste.URGENT
        room = self._mailboxes() - len(self._in_flight)
        is_awaited = self.one_at_a_time or len(self.queue) > room  # one at a time: the next one waits before this queue
        return Haste.PROMPT if is_awaited else Haste.PATIENT

    def _hand_over(self, frame: Frame, now_ns: int) -> bool:
        """Hand the first frame of the queue to the controller; tells whether the controller had room."""
        assert self._port is not None
        if frame.can_id not in self._sent:
            self._sent.add(frame.can_id)
            self._set_filters()
        if self._waiting_since_ns is None:
            self._waiting_since_ns = now_ns
        if self.one_at_a_time:  # the time in the controller is measured: without what this turn has computed before
            now_ns = time.monotonic_ns()
        try:
            self._port.send(frame, self._haste())
        except (can.CanError, OSError) as error:
            if not is_full(error):
                raise
            self.health.counts["queue full"] += 1
            self._again_ns = now_ns + RETRY_NS
            return False
        self.queue.pop()
        if self._is_well_known:
            self._in_flight.append((frame, now_ns))
        else:
            self._left(frame, now_ns, 0)
            self._waiting_since_ns = None
        return True
