"""A diagnostic client that inspects one PE by CANopen and CANaerospace, in flight or on a desk, and makes mistakes.

No message of the client may disturb the flight, and the PE must answer each message as the standards say. The client
knows the standards (CiA 301, CANaerospace V1.7, docs/canopen.md) and the PE's table, listens to the PE's state frames,
and has no access to a core. The first wrong answer is reported (`wrong`) and ends the inspection.

    in flight   the PE is configured: everything can be read, NMT commands and tables are refused
    on a desk   the PE runs nothing and hears no manager: NMT commands work, and the PE's own table may be written again

The epoch in the PE's state frames decides which of the two cases is inspected. An inspection takes some seconds; the
client sets everything that it has changed back to the old value.
"""

from collections.abc import Callable, Mapping

from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.inspection.nmt import Nmt
from heronry_tools.sim.world.inspection.node_services import ANSWERS, NodeServices
from heronry_tools.sim.world.inspection.objects import Objects
from heronry_tools.sim.world.inspection.topic import OPERATIONAL, PRE_OPERATIONAL, Heard, demand
from heronry_tools.sim.world.inspection.transfers import Transfers
from heronry_tools.sim.world.sdo_talk import Talk, WrongAnswerError
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import MANAGER_NODES, Command, heartbeat_id, management_id, sdo_response_id, state_id
from heronry_wire.management import NO_EPOCH, Lease, decode_command
from heronry_wire.nmt import decode_heartbeat
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Received
from heronry_wire.state_frames import StatePage0, StatePage1, decode_state


class DiagnosticClient:
    """Inspects one PE. The inspection begins when the client is created, and ends with the last topic or `leave`."""

    def __init__(
        self,
        clock: Clock,
        bus: SimulatedBus,
        table: PeTable,
        running: Callable[[], Mapping[str, str]],
        wrong: Callable[[str], None],
    ) -> None:
        """Begin the inspection of the PE with this table.

        running: returns the modules planned on the PE, with their modes
        wrong: is called with a sentence when the PE has given a wrong answer
        """
        self._clock, self._bus, self._table, self._wrong = clock, bus, table, wrong
        self._node = table.node_id
        self._heard = Heard()
        self._awaited, self._requests = -1, 0
        self._lease_ids = {management_id(node, Command.LEASE): node for node in MANAGER_NODES}
        wants = {
            sdo_response_id(self._node),
            ANSWERS,
            heartbeat_id(self._node),
            state_id(self._node),
            *self._lease_ids,
        }
        self._station = bus.join(f"{STRANGER}diagnostic client", 0, self._hear, frozenset(wants))
        self._talk: Talk[None] | None = _inspection(clock, table, self._heard, running)
        self._go(None)

    @property
    def is_done(self) -> bool:
        """Tell whether the inspection has ended: after the last topic, a wrong answer, or `leave`."""
        return self._talk is None

    def leave(self) -> None:
        """End the inspection, and leave the bus."""
        self._talk = None
        if self._station.present:
            self._bus.leave(self._station)

    # The inspection continues with an answer, or when the time for an answer is over

    def _go(self, answer: bytes | None) -> None:
        talk = self._talk
        if talk is None:
            return
        try:
            frame, self._awaited, patience_ns = talk.send(answer)
        except StopIteration:
            self._talk = None
            return
        except (WrongAnswerError, ValueError) as error:
            self._talk = None
            self._wrong(f"{self._table.name}: {error}")
            return
        if frame is not None:
            self._bus.offer(self._station, frame)
        self._requests += 1
        request = self._requests
        self._clock.at(self._clock.now_ns + patience_ns, lambda: self._go(None) if request == self._requests else None)

    def _hear(self, event: Received) -> None:
        frame, now_ns = event.frame, self._clock.now_ns
        if frame.can_id == heartbeat_id(self._node):
            self._heard.heartbeats.append((now_ns, decode_heartbeat(frame.data)))
        elif frame.can_id == state_id(self._node):
            page = decode_state(frame.data)
            if isinstance(page, StatePage0):
                self._heard.pages_0.append((now_ns, page))
            elif isinstance(page, StatePage1):
                self._heard.pages_1.append((now_ns, page))
        elif frame.can_id in self._lease_ids:
            lease = decode_command(Command.LEASE, frame.data)
            if not isinstance(lease, Malformed):
                assert isinstance(lease, Lease)
                self._heard.lease = self._lease_ids[frame.can_id], lease
        if frame.can_id == self._awaited:
            self._go(frame.data)


def _inspection(clock: Clock, table: PeTable, heard: Heard, running: Callable[[], Mapping[str, str]]) -> Talk[None]:
    """Inspect every topic, one after the other; a generator of requests like those of `SdoTalk`."""
    objects, transfers = Objects(clock, table, heard, running), Transfers(clock, table, heard)
    services, nmt = NodeServices(clock, table, heard), Nmt(clock, table, heard)
    yield from objects.wait(1_100)  # a heartbeat, and all pages of the state
    demand(bool(heard.heartbeats), "the heartbeat is not heard")
    is_flying = heard.pages_0[-1][1].epoch != NO_EPOCH
    reported = heard.heartbeats[-1][1]
    demand(reported == (OPERATIONAL if is_flying else PRE_OPERATIONAL), f"the heartbeat reports state {reported}")
    yield from objects.constants()
    yield from objects.present_state(is_flying=is_flying)
    yield from objects.long_texts()
    yield from objects.refusals(is_flying=is_flying)
    yield from transfers.mistakes()
    yield from nmt.heartbeat_time()
    yield from services.node_services()
    if is_flying:
        yield from nmt.in_flight()
    else:
        yield from objects.own_table()
        yield from nmt.on_a_desk()
    yield from objects.present_state(is_flying=is_flying)
