"""The driver of a simulated node without a table: its core, its controllers, and its timer on the virtual clock.

The core is the code of a real agent that was started with nothing but a node-ID (`table_waiting`). When a table has
come, and the node's answer has left, `took` is called with it; then this node has ended, and the simulator starts the
PE in its place.
"""

from collections.abc import Callable, Mapping, Sequence

from heronry_agent.core.authority import Secret
from heronry_agent.core.vocabulary import Action
from heronry_agent.shell.table_waiting import WaitingCore
from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.node import Node
from heronry_tools.sim.world.replicated_port import Copy
from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_response_id
from heronry_wire.part_transfer import Received as PartsReceived
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Received, Send, Tick

_FRAME_LIVES_NS = 1_000_000_000  # a client waits no longer for an answer


class SimulatedBlank(Node):
    """One node from its start until it has a table, or dies."""

    def __init__(
        self,
        clock: Clock,
        time: LocalClock,
        own: PeTable,
        buses: Mapping[str, Sequence[SimulatedBus]],
        *,
        secret: Secret | None,
        witness: Callable[[Copy], None],
        came: Callable[[PartsReceived], None],
        took: Callable[[PeTable], None],
    ) -> None:
        """Join the uplink, and begin to wait.

        own: the table that this node should get; only its name, its node-ID and its uplink are used.
        buses: the channels of each bus, by the name of the bus
        witness: is called with every copy of a frame on a replicated bus
        came: is called with how far the transfer of the table has come, at the start and whenever that changes
        took: is called once, with the table that has come
        """
        super().__init__(clock, time)
        self.name, self._came, self._took = own.name, came, took
        uplink = own.ports[own.uplink]
        self._answer_id = sdo_response_id(own.node_id)
        self.core = WaitingCore(own.node_id, uplink.bitrate, time.now_ns(), secret)
        self._received = self.core.received
        came(self._received)
        self._join(own.name, buses[uplink.bus], uplink, witness, frozenset(self.core.identifiers))
        self._ears[0].left = self._left
        self._arm(self.core.next_deadline_ns())

    def _take(self, event: Received) -> None:
        self._step(event)

    def _wake(self) -> None:
        if not self.is_awake:
            return
        if self.core.next_deadline_ns() <= self.time.now_ns():
            self._step(Tick())
        else:
            self._arm(self.core.next_deadline_ns())

    def _channels_lost(self, port: int, lost: frozenset[int]) -> None:
        """Do nothing: a node without a table reports no channels."""

    def _step(self, event: Received | Tick) -> None:
        if self.running:
            self._carry_out(self.core.step(self.time.now_ns(), event))
            if self.core.received != self._received:
                self._received = self.core.received
                self._came(self._received)
            self._arm(self.core.next_deadline_ns())

    def _carry_out(self, actions: Sequence[Action]) -> None:
        for action in actions:
            if isinstance(action, Send):
                self._offers[0](action.frame, self._clock.now_ns + _FRAME_LIVES_NS)

    def _left(self, frame: Frame) -> None:
        """Hand the table over when the answer to its sender is on the bus."""
        table = self.core.table
        if frame.can_id == self._answer_id and table is not None and self.running:
            self.stop()
            self._took(table)
