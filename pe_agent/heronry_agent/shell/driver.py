"""The driver of an agent core: one select loop over the buses and the partitions of a PE, on CLOCK_MONOTONIC.

A turn of the loop:

1. Wait until a frame has come, a deadline is due, or the program that started the agent has ended.
2. Hand the received frames to the core, before any deadline that is due. Each frame is handed over with its age, since
   after a pause of this process an old frame must not count as new (protocol rule 6).
3. Hand the results of the partitions to the core, and then the deadline if it is due. Modules whose steps become due
   compute in their partitions while the loop goes on.

The kernel (or the hub of the software bus) filters out frames that the PE does not need at present. On a full bus these
are most of the frames.

A frame that could not leave within T_lease is dropped, because its authorization (protocol rule 6) does not last
longer.

This loop waits only in its select. Only this loop sends the state frames: if it hangs, the PE falls silent, and the
manager notices.

A lost bus does not end the agent (`heronry_wire.link` reopens it). Meanwhile the core continues and its frames are
dropped; after T_lease its exclusive outputs are no longer authorized (protocol rule 6). If the bus toward the manager
comes back after more than T_lease, other PEs may have taken over the modules of this PE. So the driver stops all
modules, listens for another node with this node-ID, and then starts unconfigured, as a new incarnation. While another
node has this node-ID (`own_node_id`), the PE stays silent and goes on listening.

*Haste.* While nothing is urgent, the loop does not hurry: frames may take a moment on a software bus (`link`), which
gathers them; on other buses the loop itself sleeps on for GATHER_NS when a frame has woken it, and reads what has come
by then. So several frames cost one turn. A PE with several buses, which may be a gateway, never sleeps on. A manager's
PING, PREPARE, SLICE or ACTIVATE, and a fault that this PE reports, are urgent, and so is the time after them. Of its
neighbours' states the PE receives what is new, and enough to know that it hears anybody (`thinning`).

*Patience.* The data that its modules read do not wake a PE with one bus (`patient_port`): it reads them in each turn,
and so before each step of a module.

In one turn a limited number of frames is read, more than the buffer of a socket holds: a flood of frames delays the
state frames, but does not stop them.

The loop ends when `stop` is called (by a signal), with `until_eof` when standard input ends, and when the PE, which
runs nothing, was given another table over the bus.
"""

import os
import select
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from typing import Any

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.vocabulary import (
    Action,
    ChannelsLost,
    Event,
    Left,
    ModuleEvent,
    Note,
    PrepareTable,
    SwitchTable,
)
from heronry_agent.shell.haste import Haste, needed_states
from heronry_agent.shell.own_node_id import NodeId, OwnNodeId
from heronry_agent.shell.partition_host import PartitionHost
from heronry_agent.shell.table_preparing import TablePreparing
from heronry_wire.authentication import Key
from heronry_wire.frame_port import Arrival
from heronry_wire.identifiers import state_id
from heronry_wire.link import Link
from heronry_wire.node_cost import CostMeter
from heronry_wire.patient_port import PATIENCE_NS
from heronry_wire.pe_table import PeTable
from heronry_wire.protocol_times import GATHER_NS
from heronry_wire.replicated_link import AnyLink, ReplicatedLink
from heronry_wire.sansio import Received, Send, StandBack, Tick, Withdraw
from heronry_wire.service_manager import ServiceManager
from heronry_wire.standstill import LatenessMeter

_NS_PER_S = 1_000_000_000
_BURSTS = 8  # bursts of 64 frames read in one turn; SocketCAN's default buffer holds fewer


def is_abandoned() -> bool:
    """Tell whether standard input has ended, which means that the program that started the agent has ended."""
    return bool(select.select([sys.stdin], [], [], 0)[0]) and not os.read(sys.stdin.fileno(), 4096)


class AgentDriver:
    """Runs an agent core on its buses, partitions and devices."""

    def __init__(
        self,
        table: PeTable,
        new_core: Callable[[PeTable], AgentCore],
        host: PartitionHost,
        links: Sequence[AnyLink],
        *,
        key: Key | None,
        tell: Callable[[Note], None],
        service: ServiceManager,
        meter: CostMeter,
        preparing: TablePreparing,
    ) -> None:
        """Make the first core.

        new_core: makes the core of a new incarnation, which flies by the given table.
        host: runs the partitions; reads and commands the devices.
        links: one for each port of the table, in the same order.
        key: of the fleet; None without authentication.
        tell: called with every line for the log, at once.
        service: reports to systemd, if systemd has started the agent.
        meter: measures what this loop costs.
        preparing: reads and prepares tables that come beside the one that flies.
        """
        self.core = new_core(table)
        self._preparing, self._numbers = preparing, preparing.numbers
        self._table, self._new_core, self._host, self._links, self._tell = table, new_core, host, links, tell
        self._key = key
        self._service, self._own_state = service, state_id(table.node_id)
        self._off_since_ns: int | None = None  # begin of the present outage of the uplink
        self._lost_channels: dict[int, frozenset[int]] = {}  # by port, as last handed to the core
        self._accepted: Collection[int] = ()  # identifiers that the links now receive
        self._haste, self._may_gather = Haste(table), len(links) == 1
        self._patient: Link | None = None  # the only link, if its data do not wake this loop
        self._until_eof = False
        self._lateness: LatenessMeter
        self._cost = meter
        self._stopping = False

    def stop(self) -> None:
        """End the loop soon; may be called in a signal handler."""
        self._stopping = True

    def run(self, *, until_eof: bool) -> PeTable | None:
        """Run until `stop` is called; with `until_eof`, also until standard input ends.

        Returns None, or the table that was given to this PE over the bus in place of its own: then the loop ends, too,
        when the answer to the sender is on the bus.
        """
        self._until_eof = until_eof
        period_ns = self._table.ports[self._table.uplink].heartbeat_ns
        self._lateness = LatenessMeter(period_ns, time.monotonic_ns(), time.thread_time_ns())
        always: list[Any] = [sys.stdin] if until_eof else []
        self._prepare_links()
        while not self._stopping:
            watched, host_due_ns = self._host.watch(time.monotonic_ns())
            readers: list[Any] = [*always, *watched]
            for link in self._links:
                readers += link.readers
            core_due_ns = self.core.next_deadline_ns()
            due_ns = min(core_due_ns, host_due_ns)
            for link in self._links:
                link_ns = link.next_deadline_ns()
                due_ns = due_ns if link_ns is None else min(due_ns, link_ns)
            now_ns = time.monotonic_ns()
            if self._patient is not None and self._patient.is_patient:
                due_ns = min(due_ns, now_ns + PATIENCE_NS)
            self._lateness.waits(core_due_ns, now_ns)
            self._cost.waits(now_ns)
            ready, _, _ = select.select(readers, [], [], max(0, due_ns - now_ns) / _NS_PER_S)
            self._let_frames_gather(ready, due_ns)
            self._woke(time.monotonic_ns())
            self._look_at_devices()
            if always and sys.stdin in ready and is_abandoned():
                break
            self._turn(ready)
            if self.core.new_table is not None and self._links[self._table.uplink].all_left:
                return self.core.new_table
        return None

    def _turn(self, ready: Sequence[object]) -> None:
        """Take all that has come, and do all that is due."""
        self._take_frames(ready)
        for event in self._host.take(ready, time.monotonic_ns()):
            self._tell_core(event)
        for prepared in self._preparing.take():
            self._step(time.monotonic_ns(), prepared)
        now_ns = time.monotonic_ns()
        if now_ns >= self.core.next_deadline_ns():
            self._step(now_ns, Tick())
        self._host.flush(now_ns)
        self._take_departures()
        self._pump(now_ns)
        self._look_at_links(now_ns)
        if self.core.identifiers is not self._accepted:
            self._accept(self.core.identifiers)

    def _prepare_links(self) -> None:
        """Leave out the neighbours' states that this PE does not need, and let a radio have one frame at a time.

        Where nothing is forwarded, data do not wake this loop. A radio's frames are measured, each of them; on a
        replicated bus each channel needs its own signs of life.
        """
        for port in self.core.radio_ports:
            link = self._links[port]
            if isinstance(link, Link):
                link.one_at_a_time = True
        uplink = self._links[self._table.uplink]
        if isinstance(uplink, Link) and self._table.uplink not in self.core.radio_ports:
            uplink.thin(needed_states(self._table))
            if self._may_gather:
                uplink.be_patient()
                self._patient = uplink

    def _let_frames_gather(self, ready: Sequence[object], due_ns: int) -> None:
        """Sleep on for a moment, if a frame has woken this loop, nothing is urgent, and the bus itself does not gather.

        The frames that come meanwhile are read in the same turn.

        due_ns: the next deadline, before which the sleep ends.
        """
        if not self._may_gather or len(ready) != 1 or self._links[0].gathers or ready[0] is not self._links[0]:
            return
        now_ns = time.monotonic_ns()
        if self._haste.is_calm(now_ns):
            time.sleep(max(0, min(GATHER_NS, due_ns - now_ns)) / _NS_PER_S)

    def _pump(self, now_ns: int) -> None:
        """Let each bus send what is queued for it."""
        is_calm = self._haste.is_calm(now_ns)
        for link in self._links:
            link.is_calm = is_calm
            link.pump(now_ns)

    def _woke(self, now_ns: int) -> None:
        self._cost.woke(now_ns)
        stood_still = self._lateness.woke(now_ns, time.thread_time_ns())
        if stood_still is not None:
            self._step(now_ns, stood_still)

    def _look_at_devices(self) -> None:
        """Renew what is allowed to be driven, from what is known now: after a pause, nothing exclusive."""
        if not self._host.has_real_devices:
            return
        now_ns = time.monotonic_ns()
        until_ns = self.core.output_authorization.until_ns(now_ns)
        self._host.look_at_devices(until_ns, self.core.lease_ns, now_ns)

    def _look_at_links(self, now_ns: int) -> None:
        """Log the link status events of all buses, and report changes of lost channels to the core.

        If the uplink is back after it was lost for more than T_lease, begin as a new incarnation.
        """
        for port, link in enumerate(self._links):
            if link.has_link_events:
                for sentence in link.take_link_events():
                    self._tell(Note("bus", sentence))
                    self._service.status(sentence)
            if isinstance(link, ReplicatedLink):
                self._compare_channels(port, link.lost_channels(now_ns))
        before_ns, self._off_since_ns = self._off_since_ns, self._links[self._table.uplink].off_since_ns
        if before_ns is not None and self._off_since_ns is None and now_ns - before_ns > self.core.lease_ns:
            self._begin_anew()

    def _compare_channels(self, port: int, lost: frozenset[int]) -> None:
        if lost != self._lost_channels.get(port, frozenset()):
            self._lost_channels[port] = lost
            self._step(time.monotonic_ns(), ChannelsLost(port, lost))

    def _begin_anew(self) -> None:
        """Stop all modules, wait while another node has this PE's node-ID, and begin as a new incarnation."""
        self._host.abandon()
        is_told, own = False, OwnNodeId.of(self._links, self._table, self._key)
        while own.look() in (NodeId.TAKEN, NodeId.UNPROVEN):
            if not is_told:
                taken = f"another node has taken node-ID {self._table.node_id}"
                self._tell(Note("clash", f"{taken}; this node stays silent until that node is gone"))
                is_told = True
            self._service.lives(time.monotonic_ns())  # the PE may be silent for long without a failure of this service
            self._stopping = self._stopping or (self._until_eof and is_abandoned())
            if self._stopping:
                return
        self._numbers.forget_beside()
        self.core, self._accepted, self._lost_channels = self._new_core(self._table), (), {}

    def _accept(self, identifiers: Collection[int]) -> None:
        self._accepted = identifiers
        for port, link in enumerate(self._links):
            if port not in self.core.radio_ports:
                link.accept(identifiers, self.core.patient_identifiers)

    def _take_frames(self, ready: Collection[object]) -> None:
        if self._patient is not None and self._patient.is_patient:
            links = [(0, self._links[0])]
        elif not ready:
            return
        else:
            links = [(port, link) for port, link in enumerate(self._links) if any(one in ready for one in link.readers)]
        if not links:
            return
        for _ in range(_BURSTS):
            for arrival, port in self._arrivals(links):
                now_ns = time.monotonic_ns()
                self._step(now_ns, Received(port, arrival.frame, max(0, now_ns - arrival.time_ns)))
            links = [(port, link) for port, link in links if link.has_more]
            if not links:
                return
            self._pump(time.monotonic_ns())

    def _take_departures(self) -> None:
        """Tell the core that frames to a radio have left the CAN controller, and how long each was in it."""
        for port in self.core.radio_ports:
            while departures := self._links[port].departures_ns():
                for took_ns in departures:
                    self._step(time.monotonic_ns(), Left(port, took_ns))

    def _arrivals(self, links: Sequence[tuple[int, AnyLink]]) -> list[tuple[Arrival, int]]:
        """Return the frames that have arrived, each with its port, in the order of their arrival."""
        found = []
        for port, link in links:
            now_ns = time.monotonic_ns()
            arrivals = link.receive(now_ns)
            self._haste.heard(arrivals, now_ns)
            found += [(arrival, port) for arrival in arrivals]
        if len(links) > 1:
            found.sort(key=lambda one: one[0].time_ns)
        return found

    def _step(self, now_ns: int, event: Event) -> None:
        """Give the core an event, and do what it wants.

        An action that is answered at once is an event of its own: what follows from the answer is done before what is
        left of the actions before it.
        """
        actions = self.core.step(now_ns, event)
        if not actions:  # as after most frames
            return
        waiting = deque((action, now_ns) for action in actions)
        while waiting:
            action, decided_ns = waiting.popleft()
            answer = self._carry_out(action, decided_ns)
            if answer is not None:
                answered_ns = time.monotonic_ns()
                follows = self.core.step(answered_ns, answer)
                waiting.extendleft((one, answered_ns) for one in reversed(follows))

    def _carry_out(self, action: Action, decided_ns: int) -> ModuleEvent | None:
        """Execute an action that the core decided at `decided_ns`; returns the answer if it comes at once."""
        match action:
            case Send(port, frame, until_ns):
                self._links[port].put(frame, decided_ns + self.core.lease_ns if until_ns is None else until_ns)
                self._haste.sends(frame.can_id, decided_ns)
                if frame.can_id == self._own_state:
                    self._service.lives(decided_ns)
            case Withdraw(identifiers):
                for link in self._links:
                    link.withdraw(identifiers)
            case StandBack(port, until_ns):
                self._links[port].stand_back(until_ns)
            case Note():
                self._tell(action)
            case PrepareTable():
                self._preparing.begin(action, self._table)
            case SwitchTable(table):
                self._switched(table)
            case _:
                answer = self._host.carry_out(self._numbers.inward(action), time.monotonic_ns())
                return None if answer is None else self._numbers.outward(answer)
        return None

    def _tell_core(self, event: ModuleEvent) -> None:
        """Give the core what the host reports of a module, unless its table does not have the module any more."""
        about = self._numbers.outward(event)
        if about is not None:
            self._step(time.monotonic_ns(), about)

    def _switched(self, table: PeTable) -> None:
        """Go on with the table that was beside; the buses are the same, but other nodes may be on them."""
        self._preparing.switched(table)
        self._table = table
        uplink = self._links[table.uplink]
        if isinstance(uplink, Link) and table.uplink not in self.core.radio_ports:
            uplink.thin(needed_states(table))
