"""What an oracle of a run is: a small class that is told what happens and finds what must not be.

An oracle overrides the methods of what it wants to be told, and keeps what it has found in `violations`. The listeners
of each method are worked out once (`listeners`), so an oracle costs nothing for what it does not override. An oracle
asks no core, and changes nothing.

To add one: write its class, and name it in `registry`.
"""

from collections.abc import Iterable
from typing import NamedTuple

from heronry_dg.situation import Situation
from heronry_tools.sim.oracles.commanded import Epoch
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.replicated_port import Copy
from heronry_tools.sim.world.steps_seen import Driven, Moved
from heronry_wire.frame import Malformed
from heronry_wire.management import Emergency, ManagementMessage
from heronry_wire.state_frames import StatePage0


class StateSaid(NamedTuple):
    """Page 0 of a state, where it differs from the one before."""

    t_ns: int
    bus: str
    node: int
    pe: str  # whose node-ID it is
    page: StatePage0


class Oracle:
    """An oracle that listens to nothing, and has found nothing yet."""

    def __init__(self) -> None:
        self.violations: list[Violation] = []

    # Frames

    def seen(self, sent: Sent) -> None:
        """A frame was sent, on any bus, by any node."""

    def published(self, sent: Sent) -> None:
        """A data frame was sent, on any bus."""

    def copied(self, copy: Copy) -> None:
        """A node has been brought a copy of a frame on a replicated bus."""

    def carried(self, channel: int, sent: Sent) -> None:
        """A channel of a replicated bus, 0 or 1, has carried a frame."""

    def misled(self, t_ns: int, pes: Iterable[str]) -> None:
        """A stranger has sent an ALIVE that names these PEs, or a state of one that would be believed."""

    # What PEs send

    def state_sent(self, t_ns: int, node: int, data: bytes) -> None:
        """A state frame was on the managers' bus, whether it differs from the one before or not."""

    def ran(self, t_ns: int) -> None:
        """A PE has reported on the managers' bus that it runs something."""

    def said(self, state: StateSaid) -> None:
        """A PE has sent its state itself, on any of its buses."""

    def told(self, state: StateSaid) -> None:
        """A PE's state was on the managers' bus, sent by itself or by a gateway."""

    def emergency(self, sent: Sent, pe: str, message: Emergency | Malformed) -> None:
        """A PE has sent an EMCY itself, on any of its buses."""

    def handed_on(self, sent: Sent) -> None:
        """A gateway has handed on an EMCY of another PE."""

    def requested(self, node: int, message: Emergency) -> None:
        """A PE has requested a phase, on the managers' bus."""

    def measured(self, sent: Sent) -> None:
        """A gateway has reported on its radio, on the managers' bus."""

    # What managers send

    def manager_heard(self, t_ns: int) -> None:
        """A command or an ALIVE was on the managers' bus, from any manager."""

    def leased(self, t_ns: int) -> None:
        """A LEASE was on the managers' bus, from any manager."""

    def commanded(self, t_ns: int, station: str, message: ManagementMessage) -> None:
        """The active manager, at this station, has sent a new command."""

    def activated(self, t_ns: int, epoch: Epoch) -> None:
        """An epoch has been activated, and put together again, or cannot be."""

    def alive(self, t_ns: int, pes: frozenset[str]) -> None:
        """The active manager has sent an ALIVE: these PEs are available."""

    def began(self, t_ns: int) -> None:
        """A term was heard of that is higher than all before; before its first `alive`."""

    def entered(self, t_ns: int, phase: str | None) -> None:
        """A mission phase has begun."""

    # What modules do

    def moved(self, moved: Moved) -> None:
        """A PE lets the device of a module move."""

    def driven(self, driven: Driven) -> None:
        """A module was stepped that drives."""

    def looked(self, stepped: Driven) -> None:
        """A module was stepped that does not drive, and the simulator recorded its inputs."""

    # What is done to the aircraft, told by the code that does it

    def bus_split(self, t_ns: int, bus: str, is_split: bool) -> None:
        """A bus is broken in the middle, or whole again."""

    def altered(self) -> None:
        """Data are changed past the CRC from now on."""

    def manager_copied(self, station: str, twin: str) -> None:
        """A manager is about to be started once more, elsewhere, with a copy of its journal."""

    def manager_died(self, t_ns: int, station: str) -> None:
        """A manager has died, and left its journal."""

    def may_count_again(self) -> None:
        """From now on a manager may use numbers of commands that were used in its term already."""

    def may_forget_phase(self) -> None:
        """From now on a manager may begin with less than was known of the phase."""

    def ordered(self, t_ns: int, phase: str, term: int) -> None:
        """The operator has ordered a phase, and the manager has accepted that in a term."""

    def failed(self, t_ns: int, element: str) -> None:
        """A manager takes an element for failed, since the operator has declared it."""

    def cleared(self, t_ns: int, element: str, truth: Situation, *, everywhere: bool) -> None:
        """The operator has cleared an element that counted as down by `truth`; not everywhere: one manager knows."""


def listeners(oracles: Iterable[Oracle], hook: str) -> tuple[Oracle, ...]:
    """Oracles that override the method of this name: it needs to be called on them alone."""
    unheard = getattr(Oracle, hook)
    return tuple(one for one in oracles if getattr(type(one), hook) is not unheard)
