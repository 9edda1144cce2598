"""The interface of an oracle: it observes one flight and records every violation of one requirement.

An oracle overrides the methods below for the events that it needs, and appends violations to `violations`. `listeners`
determines once which oracles override a method, so an oracle costs nothing for all other events. An oracle calls no
core and changes nothing in the flight.

To add an oracle, write its class and add the class to `registry`.
"""

from collections.abc import Iterable
from typing import NamedTuple

from heronry_dg.situation import Situation
from heronry_tools.recording.commanded import Epoch
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.planning_seen import PlanningSeen
from heronry_tools.sim.world.replicated_port import Copy
from heronry_tools.sim.world.steps_seen import Driven, Moved, StateSeen, Withheld
from heronry_wire.frame import Malformed
from heronry_wire.management import Emergency, ManagementMessage
from heronry_wire.state_frames import StatePage0


class StateSaid(NamedTuple):
    """A page 0 of a PE that differs from the PE's last page 0; the PE itself or a gateway has sent it."""

    t_ns: int
    bus: str
    node: int
    pe: str  # the PE with this node-ID
    page: StatePage0


class Oracle:
    """Base of all oracles: its methods do nothing, and it has no violations yet."""

    def __init__(self) -> None:
        self.violations: list[Violation] = []

    # Frames

    def seen(self, sent: Sent) -> None:
        """Called when any node has sent a frame on any bus."""

    def published(self, sent: Sent) -> None:
        """Called when a node has sent a data frame on any bus."""

    def copied(self, copy: Copy) -> None:
        """Called when a channel of a replicated bus has delivered a copy of a frame to a node."""

    def carried(self, channel: int, sent: Sent) -> None:
        """Called when a channel of a replicated bus, 0 or 1, has carried a frame."""

    def misled(self, t_ns: int, pes: Iterable[str]) -> None:
        """Called when a foreign node has sent a forged frame about these PEs.

        The frame is an ALIVE that names them, or a state frame under the identifier of one PE.
        """

    # What PEs send

    def state_sent(self, t_ns: int, node: int, data: bytes) -> None:
        """Called when a PE has sent a state frame on the managers' bus, even if it equals the one before."""

    def ran(self, t_ns: int) -> None:
        """Called when a PE has reported on the managers' bus that it runs a module."""

    def said(self, state: StateSaid) -> None:
        """Called when a PE itself, not a gateway, has sent a changed page 0 on any of its buses."""

    def told(self, state: StateSaid) -> None:
        """Called when a page 0 of a PE was sent on the managers' bus, by the PE itself or by a gateway.

        Not called for a page 0 that is equal to the last one of the same PE.
        """

    def emergency(self, sent: Sent, pe: str, message: Emergency | Malformed) -> None:
        """Called when a PE itself, not a gateway, has sent an EMCY on any of its buses."""

    def handed_on(self, sent: Sent) -> None:
        """Called when a gateway has forwarded an EMCY of another PE."""

    def requested(self, node: int, message: Emergency) -> None:
        """Called when the request of a PE for a mission phase has come on the managers' bus.

        node: node-ID of the PE.
        """

    def wanted_priority(self, message: Emergency) -> None:
        """Called when a PE has requested a priority of a function on the managers' bus."""

    def measured(self, sent: Sent) -> None:
        """Called when a gateway has sent, on the managers' bus, a report on the bandwidth of its radio."""

    # What managers send

    def manager_heard(self, t_ns: int) -> None:
        """Called when any manager has sent a command or an ALIVE on the managers' bus."""

    def leased(self, t_ns: int) -> None:
        """Called when any manager has sent a LEASE on the managers' bus."""

    def commanded(self, t_ns: int, station: str, message: ManagementMessage) -> None:
        """Called when the active manager has sent a command; `station` is its station on the bus.

        Not called for a LEASE that is equal to the manager's last LEASE.
        """

    def activated(self, t_ns: int, epoch: Epoch) -> None:
        """Called once per epoch, after its first ACTIVATE.

        `epoch.configuration` is set if the frames give the configuration. Otherwise `epoch.flaw` says why they do not.
        """

    def alive(self, t_ns: int, pes: frozenset[str]) -> None:
        """Called when the active manager has sent an ALIVE that names these PEs as available."""

    def began(self, t_ns: int) -> None:
        """Called when a mastership begins: an ALIVE names a higher term than all earlier ALIVEs.

        It is called before `alive` is called for that ALIVE.
        """

    def entered(self, t_ns: int, phase: str | None) -> None:
        """Called when a mission phase has begun."""

    def planning(self, seen: PlanningSeen) -> None:
        """Called when a manager has requested a plan, and again when the manager gets the answer."""

    # What modules do

    def moved(self, moved: Moved) -> None:
        """Called when a PE has passed the command of a module to the module's device."""

    def driven(self, driven: Driven) -> None:
        """Called when a PE executes a step of a module.

        The module drives an actuator, or is a branch of a DEMUX.
        """

    def looked(self, stepped: Driven) -> None:
        """Called when a PE executes a step of any other module than those of `driven`.

        Only every eighth of these steps that have inputs is reported (`world.steps_seen`).
        """

    def withheld(self, step: Withheld) -> None:
        """Called when a PE executes a step of a module that leaves out an output of its mode."""

    def state_seen(self, seen: StateSeen) -> None:
        """Called when a module has saved its state, or has started from a state."""

    # What is done to the aircraft, reported by the code that does it

    def bus_split(self, t_ns: int, bus: str, is_split: bool) -> None:
        """Called when a bus has broken in the middle (`is_split`), or was repaired."""

    def silenced(self, t_ns: int, module: str, output: int) -> None:
        """Called when a module (on one PE: NAME@PE) ceases to give an output, counted from 1 in its mode; 0: all."""

    def unsilenced(self, module: str) -> None:
        """Called when a module (on one PE: NAME@PE) gives all its outputs again."""

    def altered(self) -> None:
        """Called when data frames begin to be altered in a way that their CRC does not detect."""

    def manager_copied(self, station: str, twin: str) -> None:
        """Called before a second manager starts at station `twin`, with a copy of the journal of `station`."""

    def manager_died(self, t_ns: int, station: str) -> None:
        """Called when the manager at this station has died; its journal remains on its disk."""

    def may_count_again(self) -> None:
        """Called when a manager may, from now on, reuse command numbers of its present term."""

    def may_forget_phase(self) -> None:
        """Called when a manager may, from now on, begin its mastership with a phase that has already ended."""

    def ordered(self, t_ns: int, phase: str, term: int) -> None:
        """Called when a manager has accepted, in this term, the operator's order for a phase."""

    def set_priority(self, t_ns: int, function: str, priority: int | None) -> None:
        """Called when a manager has accepted the operator's order for a priority.

        A `priority` of None is the priority of the spec.
        """

    def manager_jumped(self, t_ns: int, ahead_ns: int) -> None:
        """Called when the clock of a manager has jumped ahead by `ahead_ns`."""

    def script_ordered(self, t_ns: int, term: int | None) -> None:
        """Called when a manager has accepted, in this term, a script of the operator.

        A `term` of None means that the manager has released the script.
        """

    def failed(self, t_ns: int, element: str) -> None:
        """Called when a manager treats an element as failed because the operator has declared it failed."""

    def cleared(self, t_ns: int, element: str, truth: Situation, *, everywhere: bool) -> None:
        """Called when the operator has cleared an element.

        truth: the real situation just before the clearing. everywhere: False if only one of two managers knows of the
        order.
        """


def listeners(oracles: Iterable[Oracle], hook: str) -> tuple[Oracle, ...]:
    """Return the oracles that override the method of this name; the other oracles need not be called."""
    unheard = getattr(Oracle, hook)
    return tuple(one for one in oracles if getattr(type(one), hook) is not unheard)
