"""The interface of an oracle: it observes one run and records every violation of one requirement.

An oracle overrides the methods below for the events that it needs, and appends what it finds to `violations`.
`listeners` determines once which oracles override a method, so an oracle costs nothing for all other events. An oracle
calls no core and changes nothing in the run.

To add an oracle, write its class and add the class to `registry`.
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
    """Page 0 of a PE's state, reported to the oracles where it differs from the PE's page 0 before."""

    t_ns: int
    bus: str
    node: int
    pe: str  # the PE with this node-ID
    page: StatePage0


class Oracle:
    """Base of all oracles: it overrides no method, and has no violations yet."""

    def __init__(self) -> None:
        self.violations: list[Violation] = []

    # Frames

    def seen(self, sent: Sent) -> None:
        """Any node has sent a frame on any bus."""

    def published(self, sent: Sent) -> None:
        """A node has sent a data frame on any bus."""

    def copied(self, copy: Copy) -> None:
        """A channel of a replicated bus has delivered a copy of a frame to a node."""

    def carried(self, channel: int, sent: Sent) -> None:
        """A channel of a replicated bus, 0 or 1, has carried a frame."""

    def misled(self, t_ns: int, pes: Iterable[str]) -> None:
        """A foreign node has sent an ALIVE that names these PEs, or a state frame in the name of one of them."""

    # What PEs send

    def state_sent(self, t_ns: int, node: int, data: bytes) -> None:
        """A PE has sent a state frame on the managers' bus, even if the frame equals the PE's state frame before."""

    def ran(self, t_ns: int) -> None:
        """A PE has reported on the managers' bus that it runs a module."""

    def said(self, state: StateSaid) -> None:
        """A PE itself, not a gateway, has sent its state on any of its buses."""

    def told(self, state: StateSaid) -> None:
        """A PE's state was on the managers' bus; the PE itself or a gateway has sent it."""

    def emergency(self, sent: Sent, pe: str, message: Emergency | Malformed) -> None:
        """A PE itself, not a gateway, has sent an EMCY on any of its buses."""

    def handed_on(self, sent: Sent) -> None:
        """A gateway has forwarded an EMCY of another PE."""

    def requested(self, node: int, message: Emergency) -> None:
        """A PE has requested a mission phase on the managers' bus."""

    def wanted_priority(self, message: Emergency) -> None:
        """A PE has requested a priority of a function on the managers' bus."""

    def measured(self, sent: Sent) -> None:
        """A gateway has reported the bandwidth of its radio on the managers' bus."""

    # What managers send

    def manager_heard(self, t_ns: int) -> None:
        """Any manager has sent a command or an ALIVE on the managers' bus."""

    def leased(self, t_ns: int) -> None:
        """Any manager has sent a LEASE on the managers' bus."""

    def commanded(self, t_ns: int, station: str, message: ManagementMessage) -> None:
        """The active manager, at this station, has sent a new command."""

    def activated(self, t_ns: int, epoch: Epoch) -> None:
        """An epoch's first ACTIVATE was sent, and its configuration was read back from the frames or cannot be."""

    def alive(self, t_ns: int, pes: frozenset[str]) -> None:
        """The active manager has sent an ALIVE that names these PEs as available."""

    def began(self, t_ns: int) -> None:
        """An ALIVE names a term higher than any before; called before the first `alive` of that term."""

    def entered(self, t_ns: int, phase: str | None) -> None:
        """A mission phase has begun."""

    # What modules do

    def moved(self, moved: Moved) -> None:
        """A PE has allowed the device of a module to move."""

    def driven(self, driven: Driven) -> None:
        """A module that drives an output was stepped."""

    def looked(self, stepped: Driven) -> None:
        """A module that drives no output was stepped, and the simulator recorded its inputs."""

    # What is done to the aircraft, reported by the code that does it

    def bus_split(self, t_ns: int, bus: str, is_split: bool) -> None:
        """A bus has broken in the middle (`is_split`), or was mended."""

    def altered(self) -> None:
        """From now on data frames are altered in a way that their CRC does not detect."""

    def manager_copied(self, station: str, twin: str) -> None:
        """A second manager is about to start at station `twin`, with a copy of the journal of `station`."""

    def manager_died(self, t_ns: int, station: str) -> None:
        """The manager at this station has died; its journal remains on its disk."""

    def may_count_again(self) -> None:
        """From now on a manager may reuse command numbers of its present term."""

    def may_forget_phase(self) -> None:
        """From now on a manager may begin its mastership without all that was known of the phase."""

    def ordered(self, t_ns: int, phase: str, term: int) -> None:
        """The operator has ordered a phase, and the manager has accepted the order in this term."""

    def set_priority(self, t_ns: int, function: str, priority: int | None) -> None:
        """The operator has ordered a priority (None: that of the spec), and the manager has accepted the order."""

    def script_ordered(self, t_ns: int, term: int | None) -> None:
        """The operator has ordered a script, and a manager has accepted it in this term; None: a release."""

    def failed(self, t_ns: int, element: str) -> None:
        """A manager treats an element as failed because the operator has declared it failed."""

    def cleared(self, t_ns: int, element: str, truth: Situation, *, everywhere: bool) -> None:
        """The operator has cleared an element.

        truth: the real situation just before. everywhere: False where only one manager knows of the order.
        """


def listeners(oracles: Iterable[Oracle], hook: str) -> tuple[Oracle, ...]:
    """Give the oracles that override the method of this name; no other oracle needs the call."""
    unheard = getattr(Oracle, hook)
    return tuple(one for one in oracles if getattr(type(one), hook) is not unheard)
