"""Every command that a PE accepts was authentic and fresh: what PEs report that they did, against what was proven.

Verified in flights with a key, from frames alone: commands on the managers' bus, where `proven_commands` works every
tag out again, and what a PE itself sends on its uplink. Beyond a gateway any node may send in its name, and what a
gateway hands on proves nothing. A PE shows what it has accepted:

    it hears a LEASE          page 0, HEARS_LEASE        a LEASE, and it was accepted not long ago
    it has staged an epoch    page 1, staged epoch       a PREPARE of that epoch
    it has taken a step       page 0, epoch and state    an ACTIVATE or LEASE of that epoch with that step
    it withdraws a fault      EMCY RESET                 a CLEAR of that element, and not long ago

Behind each there must be a proven pair that the PE could accept when it was sent. *Fresh* is what lies beyond the last
command that the PE certainly had accepted before. That place is known from below: the earliest one that explains what
the PE has reported so far. A LEASE that was sent once explains one acceptance, so a manager that is replayed is found
out as soon as there are more acceptances than there were LEASEs. A PE that has started anew has only heard what was
sent since. It shows that in its first page 0, a heartbeat period later at most; it may have been welcomed and sent a
PREPARE before that. Where page 0 was stuck in its controller, the page 2 with which it asked for that welcome went
before. Where a manager may use the numbers of a term again (`may_count_again`), a command with a lower number than was
ever sent may be new to such a PE.

"Not long ago" is what the PE may go on by (T_lease of the slowest bus on the way to it), and how long its report may
be on its way: in its own queue, and in that of a gateway. A PE that reports LEASEs which nothing explains must go on
reporting them for as long.
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
    """What one PE could accept so far, and what it certainly has."""

    name: str
    bus: str  # on which it reports
    lease_ns: int
    incarnation: int | None = None
    asks_ns: int | None = None  # when it first asked for a welcome since its last page 0
    least: dict[int, Place] = field(default_factory=dict)  # by manager: it is here, or further
    leases: dict[_Accepted, int] = field(default_factory=dict)  # that it could accept, and when last
    clears: dict[tuple[int, int], int] = field(default_factory=dict)  # by element
    prepares: dict[int, int] = field(default_factory=dict)  # by epoch: when last
    steps: dict[int, tuple[Step, int]] = field(default_factory=dict)  # by epoch: the furthest, and when that was last
    unexplained_ns: int | None = None  # since when it reports that it hears a LEASE, and none explains it
    told: set[tuple[object, ...]] = field(default_factory=set)  # violations that were found already


class AuthenticityCheck(Oracle):
    """Follows what is commanded, and what PEs report that they did."""

    def __init__(self, spec: Spec, key: Key) -> None:
        super().__init__()
        self._bus = spec.manager.bus
        self._proven = ProvenCommands(key)
        self._pes: dict[int, _Pe] = {}  # by identifier of their states
        self._emcys: dict[int, _Pe] = {}
        self._may_count_again = False
        for pe in spec.pes.values():
            bus = uplink_bus(spec, pe.name)
            known = _Pe(pe.name, bus, LEASE_PERIODS * command_period_ns(spec, pe.name))
            self._pes[state_id(pe.node_id)] = self._emcys[emcy_id(pe.node_id)] = known

    def may_count_again(self) -> None:
        """From now on a manager may use numbers that were used in its term already."""
        self._may_count_again = True

    def manager_copied(self, _station: str, _twin: str) -> None:
        """Two managers number their commands by themselves from now on."""
        self._may_count_again = True

    def seen(self, sent: Sent) -> None:
        """Take a frame of any bus and any sender."""
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
            self._tell(pe, t_ns, ("hears",), "reports that it hears a LEASE, and none was authentic and fresh")

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
    """Keep what a PE would do upon a command that was sent and that it could accept."""
    message = proven.message
    if isinstance(message, Lease):
        pe.leases[proven.manager, proven.place] = t_ns
    if isinstance(message, Lease | Activate):
        if message.step >= pe.steps.get(message.epoch, (message.step, 0))[0]:
            pe.steps[message.epoch] = message.step, t_ns
    elif isinstance(message, Prepare):
        pe.prepares[message.epoch] = t_ns
    elif isinstance(message, Control) and message.operation is Operation.CLEAR:
        pe.clears[message.a, message.b] = t_ns
