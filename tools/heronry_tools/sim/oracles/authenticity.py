"""Every command that a PE accepts is authentic and fresh: the PEs' reports are compared with the proven commands.

The oracle works in flights with a key, and from frames alone. It reads two kinds of frames:

- the commands on the managers' bus, whose tags `proven_commands` computes again;
- the frames that each PE itself sends on its uplink. (Beyond a gateway any node may send in the name of a PE, so a
  forwarded frame proves nothing.)

A report of a PE shows which command it has accepted:

    report of the PE          frame                      accepted command
    it hears a LEASE          page 0, HEARS_LEASE        a LEASE, a short time ago
    it has staged an epoch    page 1, staged epoch       a PREPARE of that epoch
    it has taken a step       page 0, epoch and state    an ACTIVATE or LEASE of that epoch with that step
    it withdraws a fault      EMCY RESET                 a CLEAR of that element, a short time ago

Each report must be explained by a proven command that was fresh for the PE when the command was sent. A command is
*fresh* if its number is higher than the number of every command that the PE has certainly accepted. The commands that a
PE has certainly accepted are the earliest ones that explain its reports so far. One LEASE explains one acceptance, so a
replay is detected as soon as a PE has accepted more LEASEs than were sent.

*Restart.* A PE that has restarted can only have heard commands sent since its start. Its first page 0 shows the
restart, but comes up to a heartbeat period after the start. The PE may have received a WELCOME and a PREPARE by then.
If this page 0 has waited in the controller, the page 2 that requested the WELCOME shows when the PE started. After some
faults a manager may reuse numbers of its term (`may_count_again`); then a lower number may be new to a restarted PE.

*A short time* is 1.5 times T_lease for a LEASE, and three times T_lease for a CLEAR, since a report may wait in the
queues of the PE and of a gateway. T_lease is that of the slowest bus on the way to the PE.

If a PE reports a LEASE that nothing explains, this is a violation only after the PE has repeated the report for more
than twice T_lease.
"""

from dataclasses import dataclass, field

from heronry_dg.model import Spec
from heronry_manager.core.topology import command_period_ns, uplink_bus
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.proven_commands import Proven, ProvenCommands
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.authentication import Key, Place
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import MANAGER_NODES, emcy_id, state_id
from heronry_wire.management import (
    NO_EPOCH,
    Activate,
    Control,
    FaultCode,
    Lease,
    Operation,
    Prepare,
    Step,
    decode_emergency,
)
from heronry_wire.state_frames import PeFlags, PeState, StatePage0, StatePage1, StatePage2, decode_state

_LEAST_STEP = {PeState.BROKEN: Step.BREAK, PeState.PARTIAL: Step.GO, PeState.ACTIVE: Step.GO}
_ON_ITS_WAY_LEASES = 2  # times T_lease: in the queue of the PE, and of a gateway
_Accepted = tuple[int, Place]  # manager, place


@dataclass(slots=True)
class _Pe:
    """What the oracle knows of one PE.

    This is: which commands the PE may have accepted, and which it has certainly accepted (`least`).
    """

    name: str
    node: int
    bus: str  # on which it reports
    lease_ns: int
    incarnation: int | None = None
    asks_ns: int | None = None  # when it first requested a WELCOME (page 2) after its last page 0
    least: dict[int, Place] = field(default_factory=dict)  # by manager: the PE has accepted this place or a later one
    leases: dict[_Accepted, int] = field(default_factory=dict)  # LEASEs that it could accept: when each was sent last
    clears: dict[tuple[int, int], int] = field(default_factory=dict)  # by element: when a CLEAR was sent last
    prepares: dict[int, int] = field(default_factory=dict)  # by epoch: when a PREPARE was sent last
    steps: dict[int, tuple[Step, int]] = field(default_factory=dict)  # by epoch: the furthest step, and when sent last
    unexplained_ns: int | None = None  # since when it reports a LEASE that no proven LEASE explains
    told: set[tuple[object, ...]] = field(default_factory=set)  # violations that are reported already


class AuthenticityCheck(Oracle):
    """Verifies that a proven command explains each report by which a PE shows that it accepted a command."""

    def __init__(self, spec: Spec, key: Key) -> None:
        super().__init__()
        self._bus = spec.manager.bus
        self._proven = ProvenCommands(key)
        self._pes: dict[int, _Pe] = {}  # by identifier of their states
        self._emcys: dict[int, _Pe] = {}
        self._may_count_again = False
        for pe in spec.pes.values():
            bus = uplink_bus(spec, pe.name)
            known = _Pe(pe.name, pe.node_id, bus, LEASE_PERIODS * command_period_ns(spec, pe.name))
            self._pes[state_id(pe.node_id)] = self._emcys[emcy_id(pe.node_id)] = known

    def may_count_again(self) -> None:
        """Allow a manager, from now on, to reuse command numbers of its present term."""
        self._may_count_again = True

    def manager_copied(self, _station: str, _twin: str) -> None:
        """Allow two managers, from now on, to number their commands independently."""
        self._may_count_again = True

    def seen(self, sent: Sent) -> None:
        """Verify a state or an EMCY that a PE sends on its uplink, and record a command that its TAG proves."""
        for pes, assess in ((self._pes, self._state), (self._emcys, self._emergency)):
            pe = pes.get(sent.frame.can_id)
            if pe is not None:
                if (sent.bus, sent.sender) == (pe.bus, pe.name):
                    assess(pe, sent)
                return
        proven = self._proven.take(sent) if sent.bus == self._bus else None
        if proven is not None:
            for pe in self._pes.values():
                if proven.place > pe.least.get(proven.manager, Place(0, -1)):
                    _could_accept(pe, sent.end_ns, proven)

    # What PEs report

    def _state(self, pe: _Pe, sent: Sent) -> None:
        data = sent.frame.data
        page = decode_state(data)
        match page:
            case StatePage0():
                if page.incarnation != pe.incarnation:
                    self._begins(pe, page.incarnation, sent.end_ns)
                pe.asks_ns = None
                if PeFlags.HEARS_LEASE in page.flags:
                    self._hears(pe, sent.end_ns)
                else:
                    pe.unexplained_ns = None
                if page.epoch != NO_EPOCH and page.state in _LEAST_STEP:
                    self._runs(pe, sent.end_ns, page)
            case StatePage1() if page.staged_epoch != NO_EPOCH:
                self._staged(pe, sent.end_ns, page)
            case StatePage2() if pe.asks_ns is None:
                pe.asks_ns = sent.end_ns
            case _:
                pass

    def _begins(self, pe: _Pe, incarnation: int, t_ns: int) -> None:
        pe.incarnation, pe.unexplained_ns = incarnation, None
        pe.least = {} if self._may_count_again else {one: self._proven.newest(one) for one in MANAGER_NODES}
        since_ns = (t_ns if pe.asks_ns is None else pe.asks_ns) - pe.lease_ns // LEASE_PERIODS * 5 // 4
        pe.leases = {one: at_ns for one, at_ns in pe.leases.items() if at_ns >= since_ns}
        pe.clears = {one: at_ns for one, at_ns in pe.clears.items() if at_ns >= since_ns}
        pe.prepares = {epoch: at_ns for epoch, at_ns in pe.prepares.items() if at_ns >= since_ns}
        pe.steps = {epoch: step for epoch, step in pe.steps.items() if step[1] >= since_ns}
        pe.told.clear()

    def _hears(self, pe: _Pe, t_ns: int) -> None:
        pe.leases = {one: at_ns for one, at_ns in pe.leases.items() if at_ns >= t_ns - pe.lease_ns * 3 // 2}
        managers = {manager for manager, _ in pe.leases}
        if len(managers) == 1:
            pe.least[managers.pop()] = min(place for _, place in pe.leases)
        if pe.leases:
            pe.unexplained_ns = None
        elif pe.unexplained_ns is None:
            pe.unexplained_ns = t_ns
        elif t_ns - pe.unexplained_ns > _ON_ITS_WAY_LEASES * pe.lease_ns:
            self._tell(pe, t_ns, ("hears",), "reports that it hears a LEASE, but no authentic and fresh one was sent")

    def _runs(self, pe: _Pe, t_ns: int, page: StatePage0) -> None:
        least = _LEAST_STEP[page.state]
        if pe.steps.get(page.epoch, (Step.PREPARED, 0))[0] < least:
            story = f"is {page.state.name} in epoch {page.epoch}, which no holder of the key has commanded"
            self._tell(pe, t_ns, (page.epoch, page.state), story)

    def _staged(self, pe: _Pe, t_ns: int, page: StatePage1) -> None:
        if page.staged_epoch not in pe.prepares:
            story = f"has staged epoch {page.staged_epoch}, which no holder of the key has prepared"
            self._tell(pe, t_ns, (page.staged_epoch,), story)

    def _emergency(self, pe: _Pe, sent: Sent) -> None:
        said = decode_emergency(sent.frame.data)
        if isinstance(said, Malformed) or said.code is not FaultCode.RESET:
            return
        cleared_ns = pe.clears.get((said.kind, said.index))
        if cleared_ns is None or sent.end_ns - cleared_ns > (1 + _ON_ITS_WAY_LEASES) * pe.lease_ns:
            element = f"{said.kind.name.lower()} {said.index}"
            story = f"withdraws its report of {element}, which no holder of the key has cleared"
            self._tell(pe, sent.end_ns, (said.kind, said.index), story)

    def _tell(self, pe: _Pe, t_ns: int, about: tuple[object, ...], story: str) -> None:
        if about not in pe.told:
            pe.told.add(about)
            self.violations.append(Violation(t_ns, "authentic", f"{pe.name} {story}"))


def _could_accept(pe: _Pe, t_ns: int, proven: Proven) -> None:
    """Record a proven command that a PE could accept: it may explain later reports of this PE."""
    message = proven.message
    if isinstance(message, Lease):
        pe.leases[proven.manager, proven.place] = t_ns
    if isinstance(message, Lease | Activate):
        if message.step >= pe.steps.get(message.epoch, (message.step, 0))[0]:
            pe.steps[message.epoch] = message.step, t_ns
    elif isinstance(message, Prepare):
        pe.prepares[message.epoch] = t_ns
    elif isinstance(message, Control) and message.operation is Operation.CLEAR:
        place = message.a >> 8  # node-ID of the PE on which alone a module is cleared; 0: everywhere
        if place in (0, pe.node):
            pe.clears[message.a & 0xFF, message.b] = t_ns
