"""Which part of the agent takes a frame, by one look-up of its identifier.

There are two kinds of handlers:

    fixed    for states, output echoes and checkpoints of other PEs; for commands (with a key, `authenticity` verifies
             them first); for requests to the CANopen and node services; for reports from beyond a gateway
    data     for the data that this PE reads or forwards in its present configuration. These handlers are made anew with
             each activation step (`rewire`)

This node receives a frame under one of its own identifiers only if another node has the same node-ID. The handlers of
these identifiers override all others.

An identifier is *quiet* if its frames change no deadline and cause no state frame. Most frames have such identifiers.
Those of data that modules read, and of output echoes, are also *patient*: nothing is lost if they are taken just before
the next step of a module.
"""

from collections.abc import Callable, Collection, Iterable
from functools import partial

from heronry_agent.core.authority import Authenticity, OutputAuthorization
from heronry_agent.core.configuration import ActiveConfiguration
from heronry_agent.core.forwarding import Gateway
from heronry_agent.core.modules import ECHO_NODES, RunningModules
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import Heard
from heronry_wire.identifiers import PE_NODES, actuator_echo_id, emcy_id, emergency_event_id, heartbeat_id, state_id
from heronry_wire.pe_table import PeTable
from heronry_wire.protocol_times import slack_ns
from heronry_wire.sansio import Received
from heronry_wire.state_frames import STATE_BYTES, epoch_of, page_of

Handler = Callable[[Received], None]

_OWN = (emergency_event_id, state_id, emcy_id, heartbeat_id, actuator_echo_id)


class Inbound:
    """Finds the part of the agent that handles a received frame, by its CAN identifier."""

    def __init__(
        self,
        turn: Turn,
        index: TableIndex,
        *,
        output_authorization: OutputAuthorization,
        active_configuration: ActiveConfiguration,
        modules: RunningModules,
        gateway: Gateway,
        authenticity: Authenticity | None,
        commands: Iterable[tuple[int, Handler]],
        services: Iterable[tuple[int, Handler]],
        followed: Collection[str] | None,
    ) -> None:
        """Make the handlers that never change; the first `rewire` adds those of data frames.

        commands: the identifiers of manager commands, each with its handler.
        services: the identifiers of CANopen and of node services, each with its handler.
        followed: names of actuators on other PEs; the output echoes of these actuators go to the plant of this PE.
            None: those of all actuators.
        """
        self._turn, self._index = turn, index
        self._output_authorization, self._active_configuration, self._modules = (
            output_authorization,
            active_configuration,
            modules,
        )
        self._gateway, self._authenticity = gateway, authenticity
        self.late_ns = slack_ns(
            index.table.ports[index.uplink].heartbeat_ns
        )  # a frame older than this waited while the process did not run
        self._clash_is_noted = False
        self._commands, self._services, self._followed = dict(commands), dict(services), followed
        self._table, self._fixed = index.table, self._fixed_handlers()
        self.handlers = self._fixed  # by identifier; a new object whenever they have changed
        self.quiet = self._quiet_ids()
        self.patient = self._patient_ids()

    def rewire(self) -> None:
        """Make the handlers of data frames for the configuration that runs now; if another table flies now, all."""
        if self._index.table is not self._table:
            self._table, self._fixed = self._index.table, self._fixed_handlers()
        self.handlers = self._fixed | self._data_handlers()
        self.quiet = self._quiet_ids()
        self.patient = self._patient_ids()

    def _fixed_handlers(self) -> dict[int, Handler]:
        handlers: dict[int, Handler] = dict.fromkeys(self._gateway.rising_ids, self._from_beyond)
        handlers |= dict.fromkeys(self._gateway.asking_ids, self._asked)
        handlers |= dict.fromkeys(self._gateway.answering_ids, self._answered)
        handlers |= dict.fromkeys(map(state_id, PE_NODES), self._state)
        handlers |= dict.fromkeys(self._modules.checkpoints.identifiers, self._modules.checkpoints.heard)
        handlers |= dict.fromkeys(_echo_ids(self._index.table, self._followed), self._echo)
        commands = self._commands
        handlers |= commands if self._authenticity is None else self._authenticity.guarded(commands.items())
        handlers |= self._services
        return handlers | dict.fromkeys((identify(self._index.node) for identify in _OWN), self._own_identifier)

    def _data_handlers(self) -> dict[int, Handler]:
        sources = self._index.table.sources
        remote = self._active_configuration.running.slice.remote
        handlers: dict[int, Handler] = dict.fromkeys(self._gateway.data_ids, self._forward)
        for source in remote.keys() & self._modules.mailboxes.boxes.keys():
            handlers[sources[source].identifier] = partial(self._datum, source)
        return handlers

    def _quiet_ids(self) -> frozenset[int]:
        gateway = (self._from_beyond, self._forward, self._asked, self._answered)
        quiet = (self._state, self._echo, self._modules.checkpoints.heard, *gateway)
        often = (self._datum,) if self._authenticity is None else (self._datum, self._authenticity.hold)
        return frozenset(
            identifier
            for identifier, handler in self.handlers.items()
            if handler in quiet or (isinstance(handler, partial) and handler.func in often)
        )

    def _patient_ids(self) -> frozenset[int]:
        return frozenset(
            identifier
            for identifier, handler in self.handlers.items()
            if handler == self._echo or (isinstance(handler, partial) and handler.func == self._datum)
        )

    # Handlers

    def _datum(self, source: int, event: Received) -> None:
        if not self._modules.mailboxes.boxes[source].put(event.frame.data, self._turn.arrived_ns):
            self._turn.count("foreign or malformed datum", event.frame.can_id)
        self._forward(event)

    def _forward(self, event: Received) -> None:
        turn = self._turn
        turn.do(*self._gateway.data(event.port, event.frame, turn.now_ns, self._contested_until_ns))

    def _contested_until_ns(self, now_ns: int) -> int | None:
        """Time in ns until which the received exclusive frame may be forwarded to the uplink; None: it may not.

        A frame that arrived during a pause of this process may not be forwarded: a command that arrived later, and is
        still unread, may end the authorization.
        """
        turn = self._turn
        return (
            None if turn.arrived_ns <= turn.held_until_ns else self._output_authorization.identifiers_until_ns(now_ns)
        )

    def _from_beyond(self, event: Received) -> None:
        self._turn.do(*self._gateway.up(event.port, event.frame))

    def _asked(self, event: Received) -> None:
        self._turn.do(*self._gateway.asked(event.port, event.frame, self._turn.now_ns))

    def _answered(self, event: Received) -> None:
        self._turn.do(*self._gateway.answered(event.port, event.frame, self._turn.now_ns))

    def _state(self, event: Received) -> None:
        """Process a state of another PE.

        A page 0 on the uplink shows that another node is heard. The epoch in a page 0 is compared with the epoch of
        this PE, since this PE may be overtaken. A state from a far bus is forwarded.
        """
        data = event.frame.data
        if len(data) != STATE_BYTES:
            self._turn.count("malformed state", event.frame.can_id)
            return
        if page_of(data) == 0:
            if event.port == self._index.uplink:
                self._output_authorization.heard(self._turn.arrived_ns)
            epoch, running = epoch_of(data), self._active_configuration.running.epoch
            if epoch == running:
                self._modules.silences.heard_ns[event.frame.can_id] = self._turn.arrived_ns
            else:
                self._modules.silences.heard_ns[event.frame.can_id] = 0
                self._output_authorization.neighbour_runs(epoch, running)
        if event.port != self._index.uplink:
            self._from_beyond(event)

    def _echo(self, event: Received) -> None:
        """Hand the value in another PE's output echo to the plant of this PE; a gateway also forwards the echo."""
        heard = self._modules.publisher.heard(event.frame)
        if heard is not None:
            self._turn.do(Heard(*heard))
        self._from_beyond(event)

    def _own_identifier(self, event: Received) -> None:
        self._turn.count("node-ID clash", event.frame.can_id)
        if self._authenticity is None and event.frame.can_id == state_id(self._index.node):
            self._output_authorization.clashed(self._turn.arrived_ns)
        if not self._clash_is_noted:
            self._clash_is_noted = True
            self._turn.note(
                "clash", f"another node has node-ID {self._index.node}: it sent identifier {event.frame.can_id}"
            )


def _echo_ids(table: PeTable, followed: Collection[str] | None) -> Collection[int]:
    """CAN identifiers of the output echoes that show the `followed` actuators; None: of all output echoes."""
    if followed is None:
        return ECHO_NODES.keys()
    return {actuator_echo_id(device.node) for device in table.devices if device.name in followed}
