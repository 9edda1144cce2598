"""A standby manager: when it takes over, and what it knows then."""

from dataclasses import replace
from pathlib import Path

import pytest

from heronry_dg.loader import load, loads
from heronry_dg.situation import Situation
from heronry_manager import events
from heronry_manager.contingency.configuration_code import ConfigurationCode
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.mastership.overheard import Overheard
from heronry_manager.core.memory import NOTHING, Memory, Runs
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.core.tables.contingency_numbers import ContingencyNumbers, on_board
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import EnterPhase, FailElement, OperatorSaid
from heronry_manager.planner.exact import plan
from heronry_tools.sim.world.planning import plan_ahead
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.configuration_slice import ModuleSlice, Slice, slice_digest
from heronry_wire.frame import Frame
from heronry_wire.management import (
    FORWARD_ONLY,
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    is_newer,
)
from heronry_wire.protocol_times import START_UP_WINDOW_NS
from heronry_wire.sansio import Tick
from heronry_wire.state_frames import PeFlags, PeState, StatePage0
from lab.peers import PlayedManager, command_frame
from manager.one_manager import BEAT_NS, MS, SPEC_TEXT, OneManager

PHASES = loads(SPEC_TEXT + "phases: {climb: {}, glide: {}, land: {}}\n", "phases.dg.yaml")
LEASE_NS = 5 * BEAT_NS
FAULT = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 57)


class Pair:
    """An active manager, a standby manager, and the three PEs that both hear."""

    def __init__(self, memory: Memory = NOTHING) -> None:
        self.primary = OneManager(PHASES)
        self.standby = standing_by(memory=memory)
        self.primary.start()
        self._told = 0
        self.share()
        for pe, page in self.primary.running.items():
            self.standby.running[pe] = page
        self.fly(10 * BEAT_NS)

    def share(self) -> None:
        """Let the standby manager hear what the active one has sent."""
        for frame in self.primary.frames[self._told :]:
            self.standby.hear(frame)
        self._told = len(self.primary.frames)

    def fly(self, duration_ns: int) -> None:
        """Let time pass for both, a millisecond at a time."""
        for _ in range(duration_ns // MS):
            self.primary.pass_time(MS)
            self.share()
            self.standby.pass_time(MS)

    def orphan(self, *pes: str) -> None:
        """The active manager is dead: time passes for the standby, and these PEs report that they hear no LEASE."""
        self.standby.pass_time(LEASE_NS + MS)
        for pe in pes:
            self.say(pe, PeFlags(0))

    def say(self, pe: str, flags: PeFlags) -> None:
        page = self.standby.running[pe]
        told = StatePage0(page.state, flags, page.incarnation, page.epoch, 0, page.digest)
        self.standby.running[pe] = told
        self.standby.beat(pe)


def standing_by(node: int = 127, memory: Memory = NOTHING) -> OneManager:
    manager = OneManager(PHASES, node=node)
    manager.core = ManagerCore(PHASES, node, memory, manager.now_ns, standby=True)
    manager.memory = memory
    manager.flags = PeFlags(0)  # while it stands by it sends no lease
    return manager


@pytest.fixture
def pair() -> Pair:
    flying = Pair()
    for pe in PHASES.pes:
        flying.say(pe, PeFlags.HEARS_LEASE)
    return flying


def state(manager: OneManager) -> str:
    return str(manager.core.status()["manager"]["state"])


def test_a_pe_that_only_the_standby_did_not_hear_is_not_held_down_when_the_manager_dies(pair: Pair) -> None:
    """The standby missed `left` for a while; the manager named it to the last, and it runs what it was given."""
    page = pair.standby.running["left"]
    pair.standby.die("left")
    pair.fly(6 * BEAT_NS)
    pair.standby.running["left"] = page
    pair.say("left", PeFlags.HEARS_LEASE)
    assert pair.standby.core.status()["pes"]["left"]["state"] == "returning"
    pair.orphan("left", "middle")
    pair.standby.pass_time(MS)
    assert pair.standby.said(Alive)[0].nodes == {92, 93, 94}
    assert pair.standby.last(events.Adopted)
    assert pair.standby.requests[-1].in_background


def test_what_runs_is_not_adopted_where_a_pe_shows_a_newer_epoch(pair: Pair) -> None:
    """`left` was lost, and runs a newer epoch than all others when the manager dies; it is held down."""
    page = pair.standby.running["left"]
    for manager in (pair.primary, pair.standby):
        manager.die("left")
    pair.fly(6 * BEAT_NS)
    newer = page.epoch + 5
    pair.standby.running["left"] = replace(page, incarnation=page.incarnation + 1, epoch=newer)
    pair.say("left", PeFlags.HEARS_LEASE)
    pair.orphan("left", "middle", "right")
    pair.standby.pass_time(MS)
    assert pair.standby.said(Alive)[0].nodes == {93, 94}
    assert pair.standby.of(events.Adopted) == []
    pair.standby.answer()
    assert pair.standby.of(events.Adopted) == []
    assert is_newer(pair.standby.said(Prepare)[-1].epoch, newer)


def test_a_pe_that_was_restarted_since_is_held_down_also_by_the_next_manager(pair: Pair) -> None:
    page = pair.standby.running["left"]
    pair.standby.die("left")
    pair.fly(6 * BEAT_NS)
    pair.standby.running["left"] = StatePage0(PeState.UNCONFIGURED, PeFlags(0), page.incarnation + 1, 0, 0, 0)
    pair.say("left", PeFlags.HEARS_LEASE)
    pair.orphan("left", "middle", "right")
    pair.standby.pass_time(MS)
    assert pair.standby.said(Alive)[0].nodes == {93, 94}
    assert pair.standby.requests[-1].now.down == {"pe:left"}


def test_a_pe_that_died_with_the_manager_is_a_fault_of_what_was_adopted(pair: Pair) -> None:
    pair.standby.die("left")
    pair.standby.pass_time(LEASE_NS + MS)
    for pe in ("right", "middle"):
        pair.say(pe, PeFlags(0))
    assert pair.standby.last(events.Adopted)
    assert pair.standby.requests[-1].now.down == {"pe:left"}
    assert pair.standby.requests[-1].running is not None
    assert not pair.standby.requests[-1].in_background


def test_a_pe_that_restarted_in_between_is_given_what_runs(pair: Pair) -> None:
    pair.standby.pass_time(LEASE_NS + MS)
    pair.standby.reboot("right")
    pair.standby.pass_time(250 * MS)
    for pe in ("left", "middle"):
        pair.say(pe, PeFlags(0))
    assert pair.standby.last(events.Adopted)
    pair.standby.answer()
    pair.standby.pass_time(2 * BEAT_NS)
    assert pair.standby.said(Prepare)[-1].epoch == pair.standby.last(events.Adopted).epoch


def test_the_standby_finds_out_by_planning_what_it_has_not_heard() -> None:
    pair = Pair()
    pair.standby = standing_by()
    pair.share()
    for pe in PHASES.pes:
        pair.standby.running[pe] = pair.primary.running[pe]
        pair.standby.beat(pe)
    pair.fly(2 * BEAT_NS)
    assert pair.standby.memory.runs is None
    pair.orphan("left", "middle")
    assert pair.standby.of(events.Adopted) == []
    pair.standby.answer()
    assert pair.standby.last(events.Adopted)
    assert pair.standby.said(Prepare) == []


def test_phase_and_faults_are_announced_by_the_manager_and_go_on_after_it(pair: Pair) -> None:
    pair.primary.give(OperatorSaid(1, EnterPhase("glide")))
    pair.primary.report("left", FAULT)
    pair.primary.give(OperatorSaid(2, FailElement("pe:right")))
    pair.fly(10 * BEAT_NS)
    assert pair.standby.core.status()["phase"] == "glide"
    assert pair.standby.memory.latched.keys() == {"device:servo_left", "pe:right"}
    cleared = Control(1, 0, Operation.CLEAR, ElementKind.DEVICE, 0)
    pair.standby.hear(command_frame(cleared))
    assert pair.standby.memory.latched.keys() == {"pe:right"}
    pair.orphan("left", "middle")
    assert pair.standby.requests[-1].now.phase == "glide"
    assert pair.standby.requests[-1].now.down >= {"pe:right"}


def test_what_names_nothing_in_the_spec_is_ignored(pair: Pair) -> None:
    before = pair.standby.memory
    for kind, index in ((ElementKind.PHASE, 9), (ElementKind.DEVICE, 9), (99, 0)):
        told = Control(1, 0, Operation.HOLDS, kind, index)
        pair.standby.hear(command_frame(told))
    assert pair.standby.memory == before


def test_a_fault_that_a_pe_reports_is_left_to_the_active_manager(pair: Pair) -> None:
    pair.standby.report("left", FAULT)
    assert pair.standby.frames == []
    assert pair.standby.memory.latched == {}


def test_the_frames_of_a_deposed_manager_are_not_followed(pair: Pair) -> None:
    lease = Lease(4, 0, Step.PREPARED, 0)
    pair.standby.hear(command_frame(Lease(3, 0, Step.PREPARED, 0)))
    pair.standby.hear(command_frame(lease, 127))
    before = pair.standby.memory
    pair.share()
    stale = Control(3, 0, Operation.HOLDS, ElementKind.PHASE, 2)
    pair.standby.hear(command_frame(Lease(3, 0, Step.PREPARED, 0)))
    pair.standby.hear(command_frame(stale))
    assert pair.standby.memory == before


def test_in_flight_127_waits_for_126_no_longer_than_three_leases() -> None:
    manager = standing_by(127)
    for pe in PHASES.pes:
        manager.live(pe)
    manager.running["left"] = StatePage0(PeState.ACTIVE, PeFlags(0), 1, 7, 0, 1007)
    manager.beat("left")
    manager.pass_time(3 * LEASE_NS - MS)
    assert manager.frames == []
    manager.pass_time(BEAT_NS + 2 * MS)
    assert manager.said(Lease)[0].term == 2


def test_states_that_say_nothing_new_lead_to_no_take_over(pair: Pair) -> None:
    for pe in PHASES.pes:
        pair.say(pe, PeFlags(0))  # they have missed the LEASE; the standby has not
    assert state(pair.standby) == "standby"
    assert pair.standby.running["left"].state is PeState.ACTIVE


def test_a_manager_that_has_not_heard_all_pes_yet_waits_with_its_plan() -> None:
    standby = standing_by()
    standby.hear(command_frame(Lease(1, 0, Step.PREPARED, 0)))
    for pe in ("left", "middle"):
        standby.live(pe)
    standby.pass_time(LEASE_NS + MS)
    for pe in ("left", "middle"):
        standby.live(pe)
    assert standby.last(events.TakenOver).term == 2
    assert standby.requests == []
    standby.pass_time(START_UP_WINDOW_NS)
    assert standby.requests[-1].now.down == {"pe:right"}


def test_with_a_key_the_commands_of_a_manager_that_is_not_followed_are_ignored(pair: Pair) -> None:
    standby = standing_by()
    standby.core = ManagerCore(PHASES, 127, NOTHING, standby.now_ns, standby=True, key=Key(bytes(KEY_BYTES)))
    for frame in pair.primary.frames:
        standby.hear(frame)
    assert standby.of(events.StandingBy) == []
    assert standby.frames == []


class LateWithAKey:
    """A standby with a key, started when the PEs had long proven themselves to the manager: it can believe none."""

    def __init__(self) -> None:
        self.one = standing_by()
        self.one.core = ManagerCore(PHASES, 127, NOTHING, self.one.now_ns, standby=True, key=Key(bytes(KEY_BYTES)))
        self.manager = PlayedManager(126, 1, Key(bytes(KEY_BYTES)))

    def tell(self, message: Lease | Alive) -> None:
        self.one.hear(*self.manager.frames(message))

    def hear_all(self, flags: PeFlags) -> None:
        """Let every PE report what it runs, with a tag that the standby cannot check."""
        for pe in PHASES.pes:
            self.one.hear(Frame(self.one.state_id(pe), StatePage0(PeState.ACTIVE, flags, 1, 5, 0, 0x123456).encode()))


@pytest.mark.parametrize("manager_was_heard", [True, False])
def test_with_a_key_the_pes_get_a_manager_even_where_none_of_them_can_be_believed(*, manager_was_heard: bool) -> None:
    late = LateWithAKey()
    if manager_was_heard:
        late.tell(Lease(1, 5, Step.GO_ALL, 9))
        late.tell(Alive(1, 0, frozenset((92, 93))))
    late.hear_all(PeFlags.HEARS_LEASE)
    late.one.pass_time(START_UP_WINDOW_NS + LEASE_NS)
    late.hear_all(PeFlags.HEARS_LEASE)
    assert state(late.one) == "standby"
    late.hear_all(PeFlags(0))
    assert state(late.one) == "starting"
    late.one.pass_time(MS)
    named = {92, 93} if manager_was_heard else {92, 93, 94}
    assert late.one.said(Alive)[0].nodes == named
    assert late.one.requests == []


def test_with_a_key_a_pe_that_sends_is_awaited_until_the_window_closes_and_one_that_falls_silent_is_not() -> None:
    late = LateWithAKey()
    late.hear_all(PeFlags.HEARS_LEASE)
    late.one.pass_time(START_UP_WINDOW_NS + LEASE_NS)
    late.hear_all(PeFlags(0))
    for _ in range(10):
        late.one.pass_time(BEAT_NS)
        late.hear_all(PeFlags(0))
    assert state(late.one) == "starting"
    assert late.one.of(events.PeAbsent)[len(PHASES.pes) :] == []
    late.one.pass_time(4 * BEAT_NS)
    absent = late.one.of(events.PeAbsent)[len(PHASES.pes) :]
    assert {told.cause for told in absent} == {"not heard any more, before it could be believed"}
    assert late.one.last(events.HearsNobody).term == late.one.said(Lease)[-1].term
    late.one.answer()  # its commands, on a wire that may be mended by now, would stop every PE
    assert state(late.one) == "listening"
    assert late.one.said(Prepare) == []


class TestOverheard:
    """A standby that has missed, or got, what cannot be put together knows nothing, and reports nothing."""

    SLICE = b"\0\0\0\0"

    def overheard(self) -> tuple[Overheard, Turn]:
        turn = Turn(127, 0, term=0, memory=NOTHING, silent=True)
        return Overheard(PHASES, turn, Compiler(PHASES)), turn

    def head(self, body: bytes, digest: int | None = None) -> SliceHead:
        identity = Compiler(PHASES).identities[92]
        return SliceHead(92, 7, len(body), slice_digest(identity, body) if digest is None else digest)

    def test_a_body_with_another_digest_is_none(self) -> None:
        overheard, turn = self.overheard()
        overheard.take(Prepare(1, 7, 5))
        overheard.take(self.head(self.SLICE, 1))
        overheard.take(SliceBody(92, 7, 1, self.SLICE))
        overheard.take(Activate(1, 7, Step.GO_ALL, 5))
        assert turn.memory.runs is None

    def test_a_slice_that_names_nothing_in_the_spec_is_none(self) -> None:
        overheard, turn = self.overheard()
        body = Slice((ModuleSlice(99, 0, ()),)).encode()
        overheard.take(Prepare(1, 7, 5))
        overheard.take(self.head(body))
        overheard.take(SliceBody(92, 7, 1, body))
        overheard.take(Activate(1, 7, Step.GO_ALL, 5))
        assert turn.memory.runs is None

    @pytest.mark.parametrize(("number", "is_known"), [(1, True), (2, False), (4095, False)])
    def test_a_contingency_that_is_called_by_its_number_is_looked_up_and_counts_with_its_digest(
        self, number: int, *, is_known: bool
    ) -> None:
        """Number 2 is another configuration than its digest tells, and there is no number 4095."""
        made = plan_ahead(PHASES, 0)
        turn = Turn(127, 0, term=0, memory=NOTHING)
        overheard = Overheard(PHASES, turn, Compiler(PHASES), ContingencyNumbers(PHASES, made, on_board(PHASES, made)))
        first = made.configuration(1)
        digest = Compiler(PHASES).configuration(first).digest
        overheard.take(Prepare(1, 7, digest, number))
        overheard.take(Activate(1, 7, Step.GO_ALL, digest))
        row = ConfigurationCode(PHASES).encode(first).hex()
        assert turn.memory.runs == (Runs(7, digest, row) if is_known else None)

    def test_of_many_slices_the_oldest_are_forgotten(self) -> None:
        overheard, turn = self.overheard()
        compiled = Compiler(PHASES).configuration(plan(PHASES, Situation(phase="climb"), None).configuration)
        overheard.take(Prepare(1, 7, compiled.digest))
        for node, body in compiled.slices.items():
            overheard.take(SliceHead(node, 7, len(body), compiled.slice_digests[node]))
            for index, start in enumerate(range(0, len(body), 5), start=1):
                overheard.take(SliceBody(node, 7, index, body[start : start + 5]))
        node, identity = next(iter(Compiler(PHASES).identities.items()))
        for number in range(600):
            body = number.to_bytes(4, "big")
            overheard.take(SliceHead(node, 7, 4, slice_digest(identity, body)))
            overheard.take(SliceBody(node, 7, 1, body))
        overheard.take(Activate(1, 7, Step.GO_ALL, compiled.digest))
        assert turn.memory.runs is None


def test_a_request_that_it_heard_acknowledged_was_executed_and_the_operators_order_since_stands(pair: Pair) -> None:
    wish = Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, 1, 1)
    pair.primary.report("left", wish)
    pair.primary.give(OperatorSaid(1, EnterPhase("climb")))
    pair.fly(10 * BEAT_NS)
    to_unknown = Control(1, 99, Operation.ACKNOWLEDGE, ElementKind.PHASE, 7)
    pair.standby.hear(command_frame(to_unknown))
    pair.orphan(*PHASES.pes)
    assert pair.standby.last(events.TakenOver).phase == "climb"
    pair.standby.report("left", Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, 1, FORWARD_ONLY | 1))
    assert pair.standby.core.status()["phase"] == "climb"
    pair.standby.report("left", Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, 2, 2))
    assert pair.standby.core.status()["phase"] == "land"


def test_a_pe_on_a_slow_bus_is_believed_for_five_of_its_own_periods() -> None:
    spec = load(Path(__file__).parent.parent / "scenarios" / "slow_far_bus.dg.yaml")
    manager = OneManager(spec, node=127)
    manager.core = ManagerCore(spec, 127, NOTHING, manager.now_ns, standby=True)
    manager.hear(command_frame(Lease(1, 1, Step.GO_ALL, 7)))
    nodes = frozenset(pe.node_id for pe in spec.pes.values())
    manager.hear(command_frame(Alive(1, 0, nodes)))
    for pe in ("f1", "f2", "f3"):
        manager.hear(Frame(manager.state_id(pe), StatePage0(PeState.ACTIVE, PeFlags(0), 1, 1, 0, 7).encode()))
    manager.now_ns += 2_000 * MS
    manager.give(Tick())
    assert manager.last(events.TakenOver).before == 1


def test_without_a_term_left_it_stops_and_says_so() -> None:
    manager = standing_by()
    manager.hear(command_frame(Lease(4095, 0, Step.PREPARED, 0)))
    manager.pass_time(LEASE_NS + MS)
    for pe in PHASES.pes:
        manager.live(pe)
    assert manager.of(events.TakenOver) == []
    (reason,) = manager.stops
    assert "there is no term after 4095" in reason
    assert manager.core.next_deadline_ns() is None


def test_without_a_term_left_a_manager_that_has_listened_begins_no_mastership() -> None:
    manager = OneManager(memory=Memory(term=4094))
    manager.start()
    manager.running.clear()
    manager.pass_time(200 * MS)  # every PE is silent, and so is the manager then
    for pe in manager.spec.pes:
        manager.live(pe)
    manager.pass_time(300 * MS)
    (reason,) = manager.stops
    assert "there is no term after 4095" in reason


def test_a_mastership_is_not_refused_for_reports_from_an_earlier_one(pair: Pair) -> None:
    pair.orphan(*PHASES.pes)
    manager = pair.standby
    manager.pass_time(3 * BEAT_NS)  # most report that they hear no LEASE, but not for long yet
    manager.hear(command_frame(Lease(3, 0, Step.PREPARED, 0)))
    assert state(manager) == "standby"
    manager.pass_time(LEASE_NS + 2 * BEAT_NS)
    assert [one.before for one in manager.of(events.TakenOver)] == [1, 3]
    assert manager.of(events.Refused) == []


def test_a_module_that_was_released_while_it_stood_by_is_started_by_no_standby(pair: Pair) -> None:
    failed = Emergency(FaultCode.MODULE_EXCEPTION, 0x81, ElementKind.MODULE, 1, 0)
    pair.primary.report("left", failed)
    pair.fly(10 * BEAT_NS)
    assert pair.standby.memory.latched.keys() == {"module:drive_left"}
    requests = len(pair.standby.requests)
    pair.standby.hear(command_frame(Control(1, 0, Operation.CLEAR, ElementKind.MODULE, 1)))
    assert pair.standby.memory.latched == {}
    assert len(pair.standby.requests) == requests
