"""One beat of an active manager, and the frames that cannot wait for the next beat.

In each heartbeat period the manager sends one beat:

- LEASE, ALIVE with all available PEs, and a PING to each suspect PE (`beacon`);
- one fact for a standby manager, if a fact is due (`announcing`).

Some frames do not wait for the next beat:

- When a PE is no longer available, an ALIVE without this PE. T_lease of the PE begins with this ALIVE.
- When a PE has just become suspect, a PING to this PE.
- Before the manager answers a request for a phase or a priority, the fact with this phase or priority.

Each term begins with a new series of beats. No frame of a beat is acknowledged: if a beat is lost, the next one has the
same effect.
"""

from collections.abc import Iterable

from heronry_manager.core.heartbeat.announcing import Announcer
from heronry_manager.core.heartbeat.beacon import Beacon
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.membership import Standing
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command
from heronry_wire.management import (
    PRIORITY_REQUEST_NUMBERS,
    Alive,
    Control,
    ElementKind,
    Operation,
    decode_command,
)

_ALL_NODES = 0


class Beat:
    """Sends the beats of an active manager, and the frames that cannot wait for a beat: ALIVE, PING and facts."""

    def __init__(self, settings: ManagerSettings, turn: Turn, known: Knowledge) -> None:
        self._settings, self._turn, self._pes = settings, turn, settings.spec.pes
        self._health, self._exclusion, self._situation = known.health, known.exclusion, known.situation
        self._deployment, self._script, self._silences = known.deployment, known.script, known.silences
        self.begin()

    def begin(self) -> None:
        """Begin to send beats in a new term: the first one is due now."""
        settings = self._settings
        self._beacon = Beacon(settings.node, settings.bus.heartbeat_ns, self._turn.now_ns)
        self._announcer = Announcer(settings.spec, self._turn, self._situation, self._script)
        self._has_to_leave_out = False  # the last ALIVE named a PE that is no longer available

    @property
    def next_ns(self) -> int:
        """Time (ns) at which the next beat is due."""
        return self._beacon.next_ns

    def is_due(self) -> bool:
        """Tell whether the next beat is due."""
        return self._turn.now_ns >= self._beacon.next_ns

    def beat(self) -> None:
        """Send a beat: LEASE, ALIVE, a PING to each suspect PE, and one fact to a standby manager, if a fact is due."""
        now_ns = self._turn.now_ns
        self._situation.beat()
        self._silences.beat()
        suspects = [pe for pe in self._health.available() if self._health.standing(pe) is Standing.SUSPECT]
        lease = self._deployment.lease()
        self._turn.do(*self._beacon.beat(now_ns, lease, self._named(), self._nodes(suspects)))
        fact = self._announcer.next()
        if fact is not None:
            self._tell(*fact)
            self._tell_accepted(fact[1])

    def ping(self, pe: str) -> None:
        """Send a PING to a PE; the PE answers with its state."""
        self._turn.do(self._beacon.ping(self._turn.term, self._pes[pe].node_id))

    def must_leave_out(self) -> None:
        """Note that a PE named in the last ALIVE is no longer available: `leave_out` will send another ALIVE."""
        self._has_to_leave_out = True

    def leave_out(self) -> None:
        """Send an ALIVE now if a PE that the last ALIVE named is no longer available.

        T_lease of this PE begins when the new ALIVE is on the bus.
        """
        if self._has_to_leave_out:
            self._turn.do(self._beacon.alive(self._turn.term, self._named()))

    def alive_left(self, frame: Frame) -> None:
        """Note that an ALIVE of this manager is on the bus.

        T_lease begins now for each PE that an earlier ALIVE may have named, and that this ALIVE is the first
        not to name.
        """
        exclusion, pes = self._exclusion, self._pes
        if not exclusion.waits:
            return
        alive = decode_command(Command.ALIVE, frame.data)
        if isinstance(alive, Alive) and alive.term == self._turn.term:
            exclusion.said({pe.name for pe in pes.values() if pe.node_id in alive.nodes}, self._turn.now_ns)

    def tell_phase(self) -> None:
        """Announce the present phase to a standby manager immediately."""
        for fact in self._announcer.phase():
            self._tell(*fact)

    def tell_priority(self, index: int) -> None:
        """Announce the priority of the function with this index to a standby manager immediately."""
        self._tell(*self._situation.priority_fact_at(index))

    def look(self) -> None:
        """Check which facts hold now, so that a fact that ends and holds again is announced as a new fact."""
        self._announcer.look()

    def _named(self) -> frozenset[int]:
        named = [*self._health.available(), *self._health.awaited_again()]
        self._exclusion.named(named, self._turn.now_ns)
        self._has_to_leave_out = False
        return self._nodes(named)

    def _tell(self, operation: Operation, a: int, b: int) -> None:
        self._turn.send(Command.CONTROL, Control(self._turn.term, _ALL_NODES, operation, a, b))

    def _tell_accepted(self, told: int) -> None:
        """Tell a standby manager which requests were executed for the phase or priority that was just announced.

        A standby manager may have missed the answers to these requests.

        told: what was announced: the kind of element in bits 0 to 7, its index in the bits above.
        """
        kind, index = told & 0xFF, told >> 8
        if kind == ElementKind.PHASE:
            for pe, request in self._turn.memory.phase_requests.items():
                self._tell_one_accepted(pe, request.incarnation, ElementKind.PHASE, request.number)
        elif kind == ElementKind.PRIORITY:
            for wanted in self._situation.accepted_requests(index):
                number = index * PRIORITY_REQUEST_NUMBERS + wanted.number
                self._tell_one_accepted(wanted.pe, wanted.incarnation, ElementKind.PRIORITY, number)

    def _tell_one_accepted(self, pe: str, incarnation: int, kind: ElementKind, number: int) -> None:
        if self._health.said_incarnation(pe, self._turn.now_ns) == incarnation:
            node = self._pes[pe].node_id
            accepted = Control(self._turn.term, node, Operation.ACKNOWLEDGE, kind, number)
            self._turn.send(Command.CONTROL, accepted)

    def _nodes(self, pes: Iterable[str]) -> frozenset[int]:
        return frozenset(self._pes[pe].node_id for pe in pes)
