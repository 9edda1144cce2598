"""What a judge of a run is: a small class that is told what happens and says what must not be.

A judge overrides what it wants to be told, and keeps what it has found in `violations`. Who is told is worked out once
(`listeners`), so a judge costs nothing for what it does not ask for. A judge asks no core, and changes nothing.

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
    """Page 0 of a state, where it is news."""

    t_ns: int
    bus: str
    node: int
    pe: str  # whose node-ID it is
    page: StatePage0


class Oracle:
    """A judge that asks for nothing, and has found nothing yet."""

    def __init__(self) -> None:
        self.violations: list[Violation] = []

    # Frames

    def seen(self, sent: Sent) -> None:
        """A frame was sent, on any bus, by anybody."""

    def published(self, sent: Sent) -> None:
        """A data frame was sent, on any bus."""

    def copied(self, copy: Copy) -> None:
        """A node has been brought a copy of a frame on a replicated bus."""

    def carried(self, channel: int, sent: Sent) -> None:
        """A channel of a replicated bus, 0 or 1, has carried a frame."""

    def misled(self, t_ns: int, pes: Iterable[str]) -> None:
        """A stranger has sent an ALIVE that names these PEs, or a state of one that would be believed."""

    # What PEs say

    def state_sent(self, t_ns: int, node: int, data: bytes) -> None:
        """A state frame was on the managers' bus, news or not."""

    def ran(self, t_ns: int) -> None:
        """Somebody has said on the managers' bus that he runs something."""

    def said(self, state: StateSaid) -> None:
        """A PE says itself how it is, on any of its buses."""

    def told(self, state: StateSaid) -> None:
        """A PE's state was told on the managers' bus, by itself or by a gateway."""

    def emergency(self, sent: Sent, pe: str, message: Emergency | Malformed) -> None:
        """A PE has sent an EMCY itself, on any of its buses."""

    def handed_on(self, sent: Sent) -> None:
        """Another PE, a gateway, has sent an EMCY of one."""

    def requested(self, node: int, message: Emergency) -> None:
        """A PE has asked for a phase, on the managers' bus."""

    def measured(self, sent: Sent) -> None:
        """A gateway has reported on its radio, on the managers' bus."""

    # What managers say

    def manager_heard(self, t_ns: int) -> None:
        """A command or an ALIVE was on the managers' bus, whoever had sent it."""

    def leased(self, t_ns: int) -> None:
        """A LEASE was on the managers' bus, whoever had sent it."""

    def commanded(self, t_ns: int, station: str, message: ManagementMessage) -> None:
        """The manager that commands, at this station, has said something new."""

    def activated(self, t_ns: int, epoch: Epoch) -> None:
        """An epoch has been activated, and put together again, or cannot be."""

    def alive(self, t_ns: int, pes: frozenset[str]) -> None:
        """The manager that commands has sent an ALIVE: these PEs are counted on."""

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
        """A module was stepped that does not drive, and somebody has looked at what it was given."""

    # What is done to the aircraft, told by who does it

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
        """The operator has ordered a phase, and the manager has obeyed in a term."""

    def failed(self, t_ns: int, element: str) -> None:
        """A manager takes an element for failed, since the operator has said so."""

    def cleared(self, t_ns: int, element: str, truth: Situation, *, everywhere: bool) -> None:
        """The operator has cleared an element that counted as down by `truth`; not everywhere: one manager knows."""


def listeners(oracles: Iterable[Oracle], hook: str) -> tuple[Oracle, ...]:
    """Those that want to be told: they override the method of this name."""
    unheard = getattr(Oracle, hook)
    return tuple(one for one in oracles if getattr(type(one), hook) is not unheard)
