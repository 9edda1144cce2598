"""Which commands of a manager a PE accepts, and which part of the agent executes each.

A PE accepts a command if two conditions hold:

- The command comes on the uplink of the PE. So a node beyond a gateway cannot command the PE.
- The command comes from the active manager: the manager with the highest term that the PE has heard. A SLICE carries no
  term; it is accepted if the active manager has sent it.

The agent executes an accepted command. A gateway also forwards the command to its far buses. A refused command is
counted. If its term is too old, the PE reports STALE_TERM once, in page 1 of its state.

LEASE comes every heartbeat period, mostly with the same content. So a repeated LEASE is recognized by its bytes, and is
not decoded again.

    lost command              LEASE, or another attempt of the manager, repeats it
    late or doubled command   changes nothing: its activation step (BREAK, GO, GO_ALL) is already taken, its epoch is
                              old, or its slice is already staged
    forged command            is refused by `authenticity` if there is a key; without a key the PE executes it
    pause of the process      afterwards commands are handled in the order in which they arrived, each with its time of
                              arrival
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

from heronry_agent.core.authority import NO_TERM, Authenticity, ExclusiveFrames, FollowedManager, OutputAuthorization
from heronry_agent.core.configuration import ActiveConfiguration, Staging
from heronry_agent.core.forwarding import Gateway
from heronry_agent.core.modules import RunningModules, WithoutManager
from heronry_agent.core.table_change import TableSwitch
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import MANAGER_NODES, Command, management_id
from heronry_wire.management import (
    NO_EPOCH,
    Activate,
    Control,
    ElementKind,
    Lease,
    ManagementMessage,
    Operation,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    decode_command,
    read_alive,
    without_sequence,
)
from heronry_wire.sansio import Received, StandBack
from heronry_wire.state_frames import Reason

_BROADCAST = 0


@dataclass
class CommandAcceptance:
    """Decides which commands of managers are accepted, and calls the parts of the agent that execute them."""

    turn: Turn
    index: TableIndex
    followed_manager: FollowedManager
    output_authorization: OutputAuthorization
    staging: Staging
    active_configuration: ActiveConfiguration
    modules: RunningModules
    gateway: Gateway
    exclusive_frames: ExclusiveFrames
    without_manager: WithoutManager
    authenticity: Authenticity | None
    table_switch: TableSwitch
    _settled_lease: bytes | None = None  # last LEASE of the active manager, if the PE has done all that it commands
    _sends: Slice = field(default_factory=Slice)  # what is sent and forwarded now: at BREAK only a part of the slice

    def handlers(self) -> Iterator[tuple[int, Callable[[Received], None]]]:
        """Return the CAN identifiers of all manager commands, each with its handler."""
        for manager in MANAGER_NODES:
            yield management_id(manager, Command.LEASE), partial(self._lease, manager)
            yield management_id(manager, Command.ALIVE), partial(self._alive, manager)
            for command in (Command.PREPARE, Command.SLICE, Command.ACTIVATE, Command.PING, Command.CONTROL):
                yield management_id(manager, command), partial(self._command, manager, command)

    def _counts(self, manager: int, term: int, event: Received) -> bool:
        """Tell whether to accept a command: it must come over the uplink, and its term must not be stale.

        Notes a new term, and counts a command that is refused.
        """
        if event.port != self.index.uplink:
            self.turn.count("command from beyond", event.frame.can_id)
            return False
        before = self.followed_manager.term
        if self.followed_manager.admits(manager, term):
            if term != before:
                self._settled_lease = None
                self.turn.note("term", f"manager {manager} is active with term {term}")
                if before != NO_TERM:
                    self.modules.new_mastership()
            return True
        self.turn.count("stale term", event.frame.can_id)
        had_mastership = before != NO_TERM and not self.staging.collecting()
        if had_mastership and self.staging.reason is not Reason.STALE_TERM:
            self.turn.wants_page_1 = self.staging.refuse(Reason.STALE_TERM)
        return False

    def _lease(self, manager: int, event: Received) -> None:
        """Handle LEASE: note that the manager is active, and take the activation step that LEASE names."""
        data = event.frame.data
        settled = data == self._settled_lease and not self.active_configuration.resting
        if settled and manager == self.followed_manager.manager and event.port == self.index.uplink:
            self.output_authorization.confirmed()
            self._leased(event)
            return
        message = decode_command(Command.LEASE, data)
        if not isinstance(message, Lease):
            self.turn.count("malformed command", event.frame.can_id)
        elif self._counts(manager, message.term, event):
            self._leased(event)
            self._take(message)
            if self.active_configuration.is_at(message.epoch, message.digest):
                self._settled_lease = data if message.step is Step.GO_ALL else None
                self.without_manager.named()

    def _leased(self, event: Received) -> None:
        self.followed_manager.leased(self.turn.arrived_ns)
        self.output_authorization.heard(self.turn.arrived_ns)
        self.turn.do(*self.gateway.down(Command.LEASE, event.frame.data, event.frame, self.turn.now_ns))

    def _alive(self, manager: int, event: Received) -> None:
        """Handle ALIVE, which names the PEs that the manager considers available (protocol rule 6)."""
        frame = event.frame
        read = read_alive(frame.data, self.index.node)
        if read is None:
            self.turn.count("malformed command", frame.can_id)
        elif self._counts(manager, read[0], event):
            self.output_authorization.named(
                read[1], self.turn.arrived_ns, has_activated=self.followed_manager.has_activated
            )
            self.modules.checkpoints.named(frame.data)
            meaning = without_sequence(frame.data)
            self.turn.do(*self.gateway.down(Command.ALIVE, meaning, frame, self.turn.now_ns))

    def _command(self, manager: int, command: Command, event: Received) -> None:
        message = decode_command(command, event.frame.data)
        if isinstance(message, Malformed):
            self.turn.count("malformed command", event.frame.can_id)
            return
        term = self.followed_manager.term if isinstance(message, SliceHead | SliceBody) else message.term
        if not self._counts(manager, term, event):
            return
        if isinstance(message, Control) and not message.operation.is_known:
            self.turn.count("operation of another version", event.frame.can_id)
        else:
            self._accept(message)
        if not (isinstance(message, Control) and message.operation is Operation.WELCOME):  # a WELCOME is not for all
            self.turn.do(*self.gateway.down(command, event.frame.data, event.frame, self.turn.now_ns))

    def _accept(self, message: ManagementMessage) -> None:
        turn, running = self.turn, self.active_configuration.running
        match message:
            case Prepare():
                self._prepare(message)
            case SliceHead() if message.node == self.index.node:
                turn.wants_page_1 = self.staging.head(message, running, turn.now_ns)
            case SliceBody() if message.node == self.index.node:
                turn.wants_page_1 = self.staging.body(message, turn.now_ns)
            case Activate():
                self._take(message)
            case Ping() if message.node in (_BROADCAST, self.index.node):
                if message.node == self.index.node:
                    self.output_authorization.pinged(turn.arrived_ns)
                turn.wants_page_0 = turn.wants_page_1 = True
            case Control(operation=Operation.ACKNOWLEDGE) if message.node in (_BROADCAST, self.index.node):
                self.modules.faults.acknowledge(message.a, message.b, turn.now_ns)
            case Control(operation=Operation.HOLDS, a=ElementKind.PHASE):
                self.modules.entered(message.b)
            case Control(operation=Operation.CLEAR) if message.node in (_BROADCAST, self.index.node):
                self.modules.cleared(message.a, message.b)
            case Control(operation=Operation.RENEW | Operation.UNLOCK) if message.node == self.index.node:
                if self.authenticity is not None:
                    self.authenticity.accept(message)
            case _:
                pass  # for another node, or without effect on a PE

    def _prepare(self, command: Prepare) -> None:
        """Begin to collect the slice of a new epoch.

        A slice that is on board is staged at once. In this case data frames are held back for a moment, so that the
        answers of all PEs, and ACTIVATE, pass the bus quickly.
        """
        before = self.staging.staged
        self.turn.wants_page_1 = self.staging.prepare(command, self.active_configuration.running)
        if self.staging.staged is not before and self.staging.staged.epoch == command.epoch:
            self.turn.do(StandBack(self.index.uplink, self.turn.now_ns + self.index.stand_back_ns))

    def _take(self, order: Lease | Activate) -> None:
        """Take the activation step of a LEASE or ACTIVATE, if this PE runs or has staged the epoch in the command.

        If this PE neither runs nor has staged this epoch, another PE may drive its exclusive outputs. Then
        `OutputAuthorization` decides whether this PE is overtaken. If the command names the epoch of this PE with
        another digest, this PE is overtaken.
        """
        if order.epoch == NO_EPOCH or order.step is Step.PREPARED:
            return None
        self.followed_manager.has_activated |= order.step is Step.GO_ALL
        running, staged = self.active_configuration.running, self.staging.staged
        if self.active_configuration.is_at(order.epoch, order.digest):
            target = running
        elif (order.epoch, order.digest) == (staged.epoch, staged.digest):
            target = staged
        elif order.epoch == running.epoch:
            return self.output_authorization.contradicted()
        else:
            return self.output_authorization.saw_epoch(order.epoch, running.epoch)
        if order.step is Step.GO_ALL:
            self.output_authorization.confirmed()
        before = self._sends
        if target.table is not None:
            target, before = self.table_switch.carry_out(target, before)
        moves = self.active_configuration.advance(target, order.step)
        if moves is None:
            return None
        self._settled_lease = None
        self._sends = target.slice if order.step >= Step.GO else target.slice.restricted_to(before)
        self.modules.carry_out(moves, self._sends)
        self.exclusive_frames.published(self._sends.publish)
        self.gateway.rewire(self._sends.forward)
        self.turn.rewired = True
        self._withdraw(before, self._sends)
        self.turn.wants_page_0 = True
        self.turn.note("step", f"epoch {order.epoch} at {order.step.name}: {self.active_configuration.state.name}")
        return None

    def look_at_exclusive(self) -> None:
        """Note which of the frames that are sent are exclusive, since another table is beside."""
        self.exclusive_frames.published(self._sends.publish)
        self.gateway.rewire(self._sends.forward)
        self.modules.take_stock()

    def _withdraw(self, before: Slice, after: Slice) -> None:
        """Withdraw the unsent data frames of each source that this PE no longer sends, or now has from another node."""
        made_by, wanted_of = _producers(before), _producers(after)
        gone = [source for source, node in made_by.items() if source not in wanted_of or wanted_of[source] != node]
        self.turn.withdraw(self.index.identifiers(gone))


def _producers(sends: Slice) -> dict[int, int | None]:
    """Return, for each source that a PE sends or forwards, the node that produces it; None: the PE itself."""
    return dict.fromkeys(sends.publish) | {source: node for source, (node, _) in sends.forward.items()}
