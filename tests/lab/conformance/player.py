"""The player of the rest of the aircraft: sends frames on a bus, and keeps all frames of the node under test."""

from collections.abc import Callable, Iterable
from random import Random
from typing import NamedTuple

from heronry_tools.sim.world.bus import Faults, Sent, SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.frame_digest import FrameDigest
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER
from heronry_wire.management import ManagementMessage
from lab.peers import command_frame

MS = 1_000_000
SOON_NS = 1_500_000
"""An answer is immediate within this time: the longest frame and some that are more urgent, at 500 kbit/s and more."""


_digests: list[FrameDigest] = [FrameDigest()]  # the last one is that of the present test


def begin() -> FrameDigest:
    """Begin a conformance test; gives the digest of all its frames from now on."""
    _digests[:] = [FrameDigest()]
    return _digests[-1]


class ConformanceError(AssertionError):
    """A node does not conform to the protocol; the message says how."""


class Heard(NamedTuple):
    """A frame that the node under test has sent, and when it ended."""

    t_ns: int
    frame: Frame


class Player:
    """One station on one bus that plays all nodes but the one under test."""

    def __init__(self, clock: Clock, name: str, bitrate: int = 1_000_000) -> None:
        self.bus = SimulatedBus(name, bitrate, clock, Random(0), Faults())
        self.heard: list[Heard] = []
        self.hears: Callable[[Frame], None] | None = None  # called with each frame of the node, as it comes
        self.sign: Callable[[Frame], Frame | None] | None = None  # gives the TAG of a command
        self._clock = clock
        self._station = self.bus.join(f"{STRANGER}player", 0, lambda _: None, ())
        self.bus.taps += [_digests[-1].see, self._tap]

    def say(self, *frames: Frame) -> None:
        """Send frames, as soon as the bus is free."""
        for frame in frames:
            self.bus.offer(self._station, frame)

    def command(self, *messages: ManagementMessage, manager: int = FIRST_MANAGER) -> None:
        """Send commands of a manager, each with its TAG where there is a key."""
        for message in messages:
            frame = command_frame(message, manager)
            tag = None if self.sign is None else self.sign(frame)
            self.say(frame, *([] if tag is None else [tag]))

    def since(self, t_ns: int, identifiers: Iterable[int]) -> list[Heard]:
        """Return the frames of the node under test under some identifiers after a moment."""
        wanted = set(identifiers)
        return [one for one in self.heard if one.t_ns > t_ns and one.frame.can_id in wanted]

    def _tap(self, sent: Sent) -> None:
        if sent.sender.startswith(STRANGER):
            return
        self.heard.append(Heard(sent.end_ns, sent.frame))
        if self.hears is not None:
            self.hears(sent.frame)


class UnderTest:
    """One real node and its surroundings, in virtual time."""

    def __init__(self, period_ns: int) -> None:
        """`period_ns`: heartbeat period."""
        self.clock, self._period_ns = Clock(), period_ns

    @property
    def now_ns(self) -> int:
        """Return the virtual time, in ns."""
        return self.clock.now_ns

    def run(self, ms: float) -> int:
        """Let time pass; gives the time at which that began."""
        began_ns = self.now_ns
        self.clock.run_until(began_ns + round(ms * MS))
        self.validate()
        return began_ns

    def validate(self) -> None:
        """Raise where an invariant of the node does not hold."""

    def run_until(self, t_ns: int) -> None:
        """Let time pass up to a moment."""
        self.clock.run_until(t_ns)

    def run_into_next_period(self, ms: int) -> int:
        """Let time pass until `ms` into the next heartbeat period, after the beats of all nodes; gives that time."""
        self.clock.run_until(self.now_ns // self._period_ns * self._period_ns + self._period_ns + ms * MS)
        return self.now_ns


def demand(holds: bool, story: str) -> None:
    """Raise ConformanceError with the story where a condition does not hold."""
    if not holds:
        raise ConformanceError(story)


def equal(found: object, wanted: object, what: str) -> None:
    """Raise ConformanceError where a value is not the wanted one."""
    demand(found == wanted, f"{what}: {found}, and not {wanted}")
