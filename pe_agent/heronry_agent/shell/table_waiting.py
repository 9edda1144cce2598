"""A PE without a table: it was started with its node-ID only, and waits on the bus until it receives its table by SDO.

    waiting   the node is a CANopen node that runs nothing: boot-up, heartbeat PRE-OPERATIONAL, SDO, NMT, node services.
              It sends no state frame, so a manager counts it as down and plans without it
    given     a client, mostly the manager, has written object 2020h with a table that can be used and has this node-ID,
              as text or compressed (`compressed_table`). The node still sends the answer to the client; then the agent
              starts as if the table had come from a file

With a key the node sends a nonce to a manager that it hears, and the manager answers with the command WELCOME, as with
every PE (`authenticity`). The node executes only the commands LEASE and UNLOCK; UNLOCK allows SDO writes for some
seconds. The node accepts a table only while it is unlocked, and only if the table is sealed with the key and with the
challenge that this start has drawn (object 2024h); any node may send a sealed table.

`sdo_server` handles lost, late and doubled frames: a table arrives complete and checked, or not at all. A table that
cannot be used is refused with SDO abort code 0609 0030h, and the reason is logged. Without a key, the sender of a table
decides which installed code this node will run. So a PE waits for a table only if it was started with `--node`; without
a key this option is meant for a bus whose nodes are all trusted. A PE that has its table accepts no other table. After
a restart the PE waits again.
"""

import os
import select
import sys
import time
from collections.abc import Callable, Collection, Iterable
from functools import partial
from typing import Any

from heronry_agent.core.authority import Authenticity, ExclusiveFrames, FollowedManager, OutputAuthorization, Secret
from heronry_agent.core.canopen import CanopenNode, GivenTable, Parts, ReceivedParts
from heronry_agent.core.configuration import ActiveConfiguration
from heronry_agent.core.forwarding import Gateway
from heronry_agent.core.modules import RunningModules
from heronry_agent.core.reports import Facts
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import Action, Note
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import MANAGER_NODES, Command, management_id
from heronry_wire.management import Control, Lease, Operation, SliceBody, SliceHead, decode_command
from heronry_wire.part_transfer import Received as PartsReceived
from heronry_wire.pe_table import PeTable, Port
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS, USUAL_MISSES
from heronry_wire.protocol_version import PROTOCOL
from heronry_wire.replicated_link import AnyLink
from heronry_wire.sansio import NEVER_NS, Received, Send, Tick

_WAITING = Facts()
_NS_PER_S = 1_000_000_000
_LONGEST_WAIT_S = 0.1  # so that the loop soon notices a signal


class WaitingCore:
    """The core of a node that waits for its table; `table` is None until it has come."""

    def __init__(self, node: int, bitrate: int, now_ns: int, secret: Secret | None = None, *, offer: str = "") -> None:
        """Begin to wait for the table; `now_ns` is the time in ns of the first deadline.

        node: node-ID of this PE, 92..125; raises TableError for another one.
        bitrate: bit rate of the bus in bit/s.
        secret: the key of the fleet; with a key the node accepts only a sealed table, and only while it is unlocked.
        offer: what this node offers, for whoever asks (object 2025h).
        """
        self._node = node
        turn, index = Turn(now_ns), TableIndex(_empty_table(node, bitrate))
        active_configuration, followed_manager = ActiveConfiguration(index), FollowedManager(index.lease_ns)
        gateway = Gateway(index)
        exclusive_frames = ExclusiveFrames(turn, index, gateway)
        output_authorization = OutputAuthorization(index.lease_ns, revoked=exclusive_frames.withdraw)
        modules = RunningModules(turn, index, active_configuration, output_authorization)
        authenticity = None
        if secret is not None:
            authenticity = Authenticity(
                turn, index, followed_manager, gateway, facts=lambda: _WAITING, pending=list, secret=secret
            )
        self._authenticity = authenticity
        given = self._given = GivenTable(turn, node)
        self._table_parts = ReceivedParts()
        parts = Parts(
            turn,
            index,
            0,
            followed_manager,
            active_configuration,
            modules,
            lambda: _WAITING,
            given.take,
            authenticity,
            table_parts=self._table_parts,
            offer=offer,
        )
        self._turn, self._followed_manager, self._canopen = turn, followed_manager, CanopenNode(parts)
        self._handlers = dict(self._canopen.handlers())
        if authenticity is not None:
            commands = [(manager, command) for manager in MANAGER_NODES for command in Command]
            self._handlers |= authenticity.guarded(
                (management_id(manager, command), partial(self._accept, manager, command))
                for manager, command in commands
                if command is not Command.TAG
            )

    @property
    def table(self) -> PeTable | None:
        """The table that has come; None: the node still waits."""
        return self._given.table

    @property
    def received(self) -> PartsReceived:
        """How far the transfer of a table in parts has come."""
        return self._table_parts.received

    @property
    def identifiers(self) -> Collection[int]:
        """CAN identifiers of the frames that a waiting node takes."""
        return self._handlers

    def step(self, now_ns: int, event: Received | Tick) -> list[Action]:
        """Process one event, and return the actions to execute."""
        self._turn.begin(now_ns)
        if isinstance(event, Tick):
            self._canopen.tick()
            return self._turn.end()
        frame = event.frame
        handler = self._handlers.get(frame.can_id)
        if handler is not None and not (frame.extended or frame.remote or frame.error):
            handler(event)
        return self._turn.end()

    def next_deadline_ns(self) -> int:
        """Time in ns at which to call `step` with a Tick, if no event comes before."""
        return self._canopen.next_ns

    def _accept(self, manager: int, command: Command, event: Received) -> None:
        """Execute a verified LEASE or UNLOCK; ignore other commands. A LEASE shows which manager is active."""
        message = decode_command(command, event.frame.data)
        if isinstance(message, Malformed | SliceHead | SliceBody) or not self._followed_manager.admits(
            manager, message.term
        ):
            return
        if isinstance(message, Lease):
            self._followed_manager.leased(self._turn.arrived_ns)
        elif isinstance(message, Control) and (message.node, message.operation) == (self._node, Operation.UNLOCK):
            assert self._authenticity is not None
            self._authenticity.accept(message)


def _empty_table(node: int, bitrate: int) -> PeTable:
    """Return a table without modules, for a PE with this node-ID."""
    port = Port("uplink", bitrate, USUAL_HEARTBEAT_NS, USUAL_MISSES, wireless=False, channels=1, nodes=())
    table = PeTable(
        protocol=PROTOCOL,
        spec="",
        spec_digest="0" * 64,
        name=f"node_{node}",
        node_id=node,
        cpu_millis=0,
        without_manager="keep",
        uplink=0,
        ports=(port,),
        modules=(),
        sources=(),
        variables={},
        devices=(),
        module_names=(),
    )
    return PeTable.from_json(table.to_json())  # checked like any other table


class Waiting:
    """Runs a WaitingCore on one bus."""

    def __init__(self, core: WaitingCore, link: AnyLink, tell: Callable[[Note], None]) -> None:
        """Prepare to run `core` on the bus `link`, from which only the frames that the core needs are received.

        tell: is called with each note for the log.
        """
        self._core, self._link, self._tell = core, link, tell
        link.accept(core.identifiers)
        self._stopping = False

    def stop(self) -> None:
        """End the loop soon; may be called in a signal handler."""
        self._stopping = True

    def run(self, *, until_eof: bool) -> PeTable | None:
        """Wait until a table has come, and the answer to its sender is on the bus; returns the table.

        Returns None if `stop` is called before; with `until_eof`, also if standard input ends before.
        """
        core, link = self._core, self._link
        while not self._stopping:
            readers: list[Any] = [*link.readers, *([sys.stdin] if until_eof else [])]
            ready, _, _ = select.select(readers, [], [], self._wait_s())
            if sys.stdin in ready and not os.read(sys.stdin.fileno(), 4096):
                break
            now_ns = time.monotonic_ns()
            for arrival in link.receive(now_ns):
                self._carry_out(core.step(now_ns, Received(0, arrival.frame)), now_ns)
            if now_ns >= core.next_deadline_ns():
                self._carry_out(core.step(now_ns, Tick()), now_ns)
            link.pump(now_ns)
            for sentence in link.take_link_events():
                self._tell(Note("bus", sentence))
            if core.table is not None and link.all_left:
                return core.table
        return None

    def _wait_s(self) -> float:
        deadlines = [self._core.next_deadline_ns(), self._link.next_deadline_ns() or NEVER_NS]
        left_ns = min(deadlines) - time.monotonic_ns()
        return min(max(0, left_ns) / _NS_PER_S, _LONGEST_WAIT_S)

    def _carry_out(self, actions: Iterable[Action], now_ns: int) -> None:
        for action in actions:
            if isinstance(action, Send):
                self._link.send(action.frame, now_ns)
            elif isinstance(action, Note):
                self._tell(action)
