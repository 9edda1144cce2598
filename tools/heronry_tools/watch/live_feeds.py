"""Live feeds: sources of events that come while a system runs.

    FollowedManager   the events of a manager on this computer, and the frames of its bus
    ListenedBuses     only the frames of buses, and the events that these frames show

A feed never sends on a bus. A feed is polled: `readers` gives the descriptors to wait on, and `poll` the events that
have come. If a manager ends, its feed stays open. The feed tries every second to connect to the manager again;
meanwhile `trouble` says that the manager is gone. If the manager flies by another spec from then on, or has changed to
another spec in flight, the feed has that spec, and its events are those of that spec from the next status on.
"""

import json
import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from heronry_dg.model import Spec
from heronry_manager.events import Event, ManagerStarted, Place, Status
from heronry_manager.events import Feed as FeedEvent
from heronry_manager.events.reading import events_in, read_event
from heronry_manager.shell.control_client import follow
from heronry_manager.shell.control_place import ControlError
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.demo.buses import BusChoice
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.watch.listening import Listening
from heronry_tools.watch.snapshot import Source
from heronry_wire.authentication import Key
from heronry_wire.bus_opening import LinkError
from heronry_wire.errors import HeronryError
from heronry_wire.frame import LoggedFrame
from heronry_wire.pe_table import PeTable

_AGAIN_NS = 1_000_000_000
_LATE_NS = 20_000_000  # a frame may be read up to this long after its end
_FIRST_LINE_S = 5.0


class Feed(Protocol):
    """A source of events; a view polls it.

    `spec` may be another one after a poll.
    """

    spec: Spec
    spec_file: Path | None  # None if the caller named the spec itself
    socket: Path | None  # of the manager that takes orders; None: no manager is followed
    source: Source
    trouble: str | None
    frames: list[LoggedFrame]  # heard in the last poll

    def readers(self) -> Sequence[Any]:
        """Return the descriptors (or objects with one) that become readable when something has come."""

    def poll(self) -> list[Event]:
        """Return the events since the last poll, without waiting."""

    def close(self) -> None:
        """Close the connection to the manager, or the buses."""


class HeardBuses:
    """The buses that a feed listens to, and the events that their frames give."""

    def __init__(self, spec: Spec, choices: Sequence[BusChoice], listening: Listening) -> None:
        """Open the buses; raises LinkError if one of them cannot be opened, and then leaves none open.

        choices: the interface and channel of each bus that is opened.
        listening: derives the events from the frames.
        """
        self._listening = listening
        self._ears: dict[str, Ear] = {}
        try:
            for choice in choices:
                self._ears[choice.name] = Ear(choice, spec.buses[choice.name])
        except LinkError:
            self.close()
            raise

    def readers(self) -> list[Any]:
        """Return the descriptors that become readable when a frame has come."""
        return [reader for ear in self._ears.values() for reader in ear.readers]

    def poll(self, frames: list[LoggedFrame]) -> list[Event]:
        """Return the events since the last poll, and append the frames heard since then to `frames`."""
        heard = [LoggedFrame(at, name, frame) for name, ear in self._ears.items() for at, frame in ear.hear()]
        heard.sort(key=lambda logged: logged.time_ns)
        frames += heard
        found = [one for logged in heard for one in self._listening.take(logged.channel, logged.time_ns, logged.frame)]
        return found + self._listening.until(time.monotonic_ns() - _LATE_NS)

    def close(self) -> None:
        """Close the buses."""
        for ear in self._ears.values():
            with suppress(HeronryError, OSError):
                ear.__exit__(None, None, None)
        self._ears.clear()


class FollowedManager:
    """The feed of a manager on this computer, with the traffic of the manager's bus if the bus can be opened."""

    source: Source = "manager"

    def __init__(self, path: Path, *, hears_bus: bool = True) -> None:
        """Connect to the manager whose socket has the path `path`.

        hears_bus: also open the manager's bus; if it cannot be opened, the feed has no traffic.

        Raises ControlError if the manager does not listen or sends no status, and UserError if the manager's spec
        cannot be read.
        """
        self.socket: Path | None = path
        self._path = path
        self.trouble: str | None = None
        self.frames: list[LoggedFrame] = []
        self.spec_file: Path | None
        self._line = follow(path)
        try:
            first, self._rest = _first_of(self._line, path)
            self.spec, self.spec_file = _spec_of(first)
        except BaseException:
            self._line.close()
            raise
        self._line.setblocking(False)
        self._events: list[Event] = [first]
        self._try_again_ns, self._hears_bus = 0, hears_bus
        self._buses = self._opened(first.bus)

    def readers(self) -> Sequence[Any]:
        """Return the descriptors that become readable when an event of the manager, or a frame of the bus, has come."""
        line = [] if self.trouble else [self._line]
        return [*line, *([] if self._buses is None else self._buses.readers())]

    def poll(self) -> list[Event]:
        """Return the events since the last poll; tries to connect again to a manager that had ended.

        Raises UserError if the manager flies by another spec, and that cannot be read.
        """
        events, self._events = self._events, []
        self.frames.clear()
        if self._buses is not None:
            events += self._buses.poll(self.frames)
        if self.trouble is not None:
            self._again()
        else:
            events += self._lines()
        return events

    def close(self) -> None:
        """Close the connection and the bus."""
        self._line.close()
        if self._buses is not None:
            self._buses.close()

    def _lines(self) -> list[Event]:
        while True:
            try:
                chunk = self._line.recv(1 << 16)
            except BlockingIOError:
                break
            except OSError:
                chunk = b""
            if not chunk:
                self.trouble = f"the manager on {self._path.name} has gone; waiting for it"
                break
            self._rest += chunk
        *lines, self._rest = self._rest.split(b"\n")
        found: list[Event] = []
        for event in events_in(lines):
            found.append(event)
            if isinstance(event, ManagerStarted) and event.spec_digest != self.spec.digest:
                self.trouble = f"the aircraft has changed to {event.spec}"  # its status says where that spec is
                break
            if isinstance(event, Status) and event.status["spec_digest"] != self.spec.digest:
                self._changes_to(event)
        return found

    def _changes_to(self, status: Status) -> None:
        """Go on with the spec that a status names, and with the bus of its manager."""
        self.spec, self.spec_file = _spec_of(status)
        before, self._buses = self._buses, self._opened(status.bus)
        if before is not None:
            before.close()

    def _again(self) -> None:
        if time.monotonic_ns() < self._try_again_ns:
            return
        self._try_again_ns = time.monotonic_ns() + _AGAIN_NS
        with suppress(ControlError):
            line = follow(self._path)
            self._line.close()
            line.setblocking(False)
            self._line, self._rest, self.trouble = line, b"", None

    def _opened(self, bus: Place) -> HeardBuses | None:
        """Open the manager's bus; None if it cannot be opened, which is no error: the feed then has no traffic."""
        if not self._hears_bus:
            return None
        model = self.spec.buses[bus.name]
        if not bus.channel or " " in bus.interface:  # only the manager's can.conf names the channel
            return None
        choice = BusChoice(bus.name, bus.interface, bus.channel, None, is_ours=False, channels=model.channels)
        with suppress(HeronryError):
            return HeardBuses(self.spec, [choice], Listening(self.spec, time.monotonic_ns(), tells_why=True))
        return None


class ListenedBuses:
    """A feed that only listens to buses: without the events of a manager, it does not show why epochs change."""

    source: Source = "bus"
    socket: Path | None = None

    def __init__(
        self, spec: Spec, choices: Sequence[BusChoice], *, key: Key | None = None, tables: tuple[PeTable, ...] = ()
    ) -> None:
        """Open the buses; raises LinkError if one of them cannot be opened.

        choices: the interface and channel of each bus that is opened.
        key: the key of the flight; None: the flight has no key.
        tables: the tables of the PEs, with the contingencies on board.
        """
        self.spec = spec
        self.spec_file: Path | None = None
        self.trouble: str | None = None
        self.frames: list[LoggedFrame] = []
        now_ns = time.monotonic_ns()
        self._buses = HeardBuses(spec, choices, Listening(spec, now_ns, key=key, tables=tables))
        self._events: list[Event] = [FeedEvent(now_ns, "bus", knows_why=False, spec=spec.name, spec_digest=spec.digest)]

    def readers(self) -> Sequence[Any]:
        """Return the descriptors that become readable when a frame has come."""
        return self._buses.readers()

    def poll(self) -> list[Event]:
        """Return the events since the last poll."""
        self.frames.clear()
        events, self._events = self._events, []
        return events + self._buses.poll(self.frames)

    def close(self) -> None:
        """Close the buses."""
        self._buses.close()


def status_now(path: Path) -> Status:
    """Return the status of the manager whose socket has the path `path`, with the plan that runs, and its bus.

    Raises ControlError if the manager does not listen, or sends no status.
    """
    with follow(path) as line:
        return _first_of(line, path)[0]


def _first_of(line: socket.socket, path: Path) -> tuple[Status, bytes]:
    """Read the status with which a manager begins; gives also the bytes that came after it. Raises ControlError."""
    line.settimeout(_FIRST_LINE_S)
    rest = b""
    while b"\n" not in rest:
        try:
            chunk = line.recv(1 << 16)
        except OSError:
            chunk = b""
        if not chunk:
            raise ControlError(
                f"the manager on {path} gives no status: restart the manager with this version of heronry"
            )
        rest += chunk
    text, _, rest = rest.partition(b"\n")
    first = read_event(text)
    if not isinstance(first, Status):
        raise ControlError(
            f"the manager on {path} cannot be followed: {_refusal(text)}; if it is of another version of heronry, "
            "restart it with this version"
        )
    return first, rest


def _spec_of(first: Status) -> tuple[Spec, Path]:
    """Load the spec with which a manager flies, from its file or else from the copy that the manager keeps.

    Raises UserError if the file has changed since the manager loaded it, and there is no copy.
    """
    copy = first.status.get("files", {}).get("flies")
    for file in (first.file, *(() if copy is None else (copy,))):
        with suppress(UserError, HeronryError):
            spec = load_spec(file)
            if spec.digest == first.status["spec_digest"]:
                return spec, Path(file)
    raise UserError(f"{first.file} has changed since the manager was started: undo the change, or restart the manager")


def _refusal(line: bytes) -> str:
    """Return the sentence in the answer of a manager that cannot be followed; if it has none, the answer itself."""
    with suppress(ValueError):
        match json.loads(line):
            case {"sentence": str(sentence)}:
                return sentence
            case _:
                pass
    return line.decode(errors="replace")
