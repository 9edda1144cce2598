"""Another table comes beside the one that flies, and an epoch of it lets the two change places."""

from dataclasses import replace
from itertools import pairwise

import pytest

from agent.one_pe import (
    ALARM_ID,
    BEAT_NS,
    CONTROL,
    DEMAND,
    DEMAND_ID,
    FAR,
    FLYING,
    GATEWAY_TABLE,
    GYRO,
    LEASE_NS,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_MONITOR,
    SERVO_1,
    TABLE,
    Message,
    OnePe,
    emergencies,
    mode,
    rate_frame,
    sent,
    slice_messages,
    started,
    stopped,
)
from agent.test_given_table import begin, is_refused, write
from heronry_agent.core.vocabulary import (
    Action,
    AtRest,
    ImagesArrived,
    ImagesMissing,
    Note,
    SaveState,
    StateSaved,
    StepFailed,
    StepModule,
    SwitchTable,
)
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.identifiers import emergency_event_id
from heronry_wire.management import Activate, Alive, Control, ElementKind, FaultCode, Lease, Operation, Step
from heronry_wire.pe_table import CheckpointEntry, ModuleEntry, PeTable, PhaseEntry, Port, SourceEntry, VariableEntry
from heronry_wire.sansio import Withdraw
from heronry_wire.state_frames import PeFlags, PeState, Reason

# The other spec has a new module before all others, so that every index is one higher, and the monitor is faster.
EXTRA, TEMPERATURE, TEMPERATURE_ID = 0, 0, 1538
extra = ModuleEntry(
    EXTRA, "extra", "extra", None, demux=False, movable=False, modes=(mode("only", temperature=1, rate_mhz=10_000),)
)


def moved(entry: ModuleEntry) -> ModuleEntry:
    faster = tuple(replace(one, rate_mhz=50_000) for one in entry.modes)
    return replace(entry, index=entry.index + 1, modes=faster if entry.index == MONITOR else entry.modes)


OTHER = replace(
    TABLE,
    spec="other",
    spec_digest="11" * 32,
    modules=(extra, *map(moved, TABLE.modules)),
    sources=(SourceEntry("extra", "temperature", TEMPERATURE_ID, 100 * MS), *TABLE.sources),
    variables={"temperature": VariableEntry("FLOAT", None), **TABLE.variables},
    module_names=("extra", *TABLE.module_names),
)
RUN_CONTROL, RUN_SERVO_1 = ModuleSlice(CONTROL + 1, 0, (RATE + 1,)), ModuleSlice(SERVO_1 + 1, 0, (DEMAND + 1,))
SAME = Slice((RUN_CONTROL, RUN_SERVO_1), remote={RATE + 1: NEIGHBOUR}, publish={DEMAND + 1: 1})
LONGER = Slice(
    (ModuleSlice(EXTRA, 0, ()), RUN_CONTROL, RUN_SERVO_1),
    remote={RATE + 1: NEIGHBOUR},
    publish={DEMAND + 1: 1, TEMPERATURE: 1},
)


def slice_of(wanted: Slice, epoch: int, table: PeTable = OTHER) -> list[Message]:
    return slice_messages(wanted, epoch, 1000 + epoch, table=table)


def bring(pe: OnePe, table: PeTable = OTHER) -> list[Action]:
    text, before = table.to_json().encode(), len(pe.done)
    assert not is_refused(begin(pe, text))
    write(pe, text)
    return [action for _, action in pe.done[before:]]


def flying(wanted: Slice = FLYING, table: PeTable = TABLE, *, slow: frozenset[int] = frozenset()) -> OnePe:
    pe = OnePe(table, takes_tables=True, slow_to_rest=slow)
    pe.configure(wanted, 5)
    pe.fly(5 * BEAT_NS, epoch=5, digest=1005)
    return pe


def switched(pe: OnePe, wanted: Slice, epoch: int = 6, table: PeTable = OTHER) -> list[Action]:
    actions = pe.command(*slice_of(wanted, epoch, table), Activate(1, epoch, Step.BREAK, 1000 + epoch))
    return actions + pe.command(Activate(1, epoch, Step.GO_ALL, 1000 + epoch))


def notes(actions: list[Action]) -> str:
    return "\n".join(action.text for action in actions if isinstance(action, Note))


def test_the_tables_change_places_and_what_is_the_same_misses_no_step() -> None:
    pe = flying()
    bring(pe)
    pe.outputs = {CONTROL: {"demand": 1.0}}
    pe.fly(5 * BEAT_NS, epoch=5, digest=1005)
    before, since_ns = len(pe.done), pe.now_ns - 50 * MS
    pe.command(*slice_of(LONGER, 6), Activate(1, 6, Step.BREAK, 1006))
    assert pe.ask()[0].state is PeState.BROKEN
    pe.outputs = {CONTROL + 1: {"demand": 2.0}, EXTRA: {"temperature": 3.0}}
    pe.fly(1 * BEAT_NS, epoch=6, digest=1006, step=Step.BREAK)
    pe.command(Activate(1, 6, Step.GO_ALL, 1006))
    assert pe.ask()[0].state is PeState.ACTIVE
    pe.fly(10 * BEAT_NS, epoch=6, digest=1006)
    actions = [action for _, action in pe.done[before:]]
    assert stopped(actions) == []
    assert started(actions) == [EXTRA]
    assert sent(actions, TEMPERATURE_ID)
    assert sent(actions, DEMAND_ID)[-1].data[4:] == bytes.fromhex("40000000")
    for module in (CONTROL + 1, SERVO_1 + 1):
        assert {after - one for one, after in pairwise(pe.steps[module]) if one > since_ns} == {25 * MS}
    assert pe.seen[CONTROL + 1] == {"": 1.0}
    codes = [frame.data[3] for _, action in pe.done for frame in sent([action], DEMAND_ID)]
    assert codes == list(range(len(codes)))  # receivers see no gap
    assert not emergencies(actions)


def test_an_answer_to_a_step_that_began_before_counts_after_the_switch() -> None:
    pe = flying()
    bring(pe)
    pe.fly(5 * BEAT_NS, epoch=5, digest=1005)
    answer, pe.answer = pe.answer, lambda _module, _release: []  # type: ignore[method-assign]
    before = len(pe.done)
    pe.pass_time(30 * MS)
    steps = [action for _, action in pe.done[before:] if isinstance(action, StepModule) and action.module == CONTROL]
    pe.answer = answer  # type: ignore[method-assign]
    switched(pe, SAME)
    pe.command(Alive(1, 1, frozenset({NEIGHBOUR, NODE})))
    pe.outputs = {CONTROL + 1: {"demand": 2.0}}
    assert sent(pe.answer(CONTROL + 1, steps[-1].release), DEMAND_ID)


def test_a_changed_module_is_built_anew_and_one_that_the_other_spec_lacks_stops() -> None:
    pe = flying(Slice((*FLYING.modules, RUN_MONITOR), remote=FLYING.remote, publish={**FLYING.publish, 2: 1}))
    bring(pe)
    wanted = Slice(
        (*SAME.modules, ModuleSlice(MONITOR + 1, 0, (RATE + 1, DEMAND + 2))),
        remote=SAME.remote,
        publish={**SAME.publish, DEMAND + 2: 1},
    )
    actions = switched(pe, wanted)
    assert stopped(actions) == [MONITOR]
    assert started(actions) == [MONITOR + 1]
    order = [type(action) for action in actions]
    assert order.index(SwitchTable) > [getattr(action, "module", None) for action in actions].index(MONITOR)
    back = switched(pe, FLYING, 7, TABLE)  # the old table is beside now
    assert stopped(back) == [MONITOR + 1]
    assert started(back) == []
    assert pe.core.active_configuration.live == {CONTROL: 0, SERVO_1: 0}


def test_a_slice_is_of_the_table_that_its_digest_names() -> None:
    pe = flying()
    pe.command(*slice_of(SAME, 6))
    assert pe.ask()[1].reason is Reason.DIGEST
    bring(pe)
    pe.command(*slice_of(SAME, 7))
    assert pe.ask()[1].staged_epoch == 7
    pe.command(*slice_of(SAME, 8, replace(OTHER, spec_digest="22" * 32)))
    assert pe.ask()[1].reason is Reason.DIGEST
    pe.command(*slice_messages(FLYING, 9, 1009), Activate(1, 9, Step.GO_ALL, 1009))
    assert pe.core.active_configuration.running.epoch == 9
    assert pe.core.active_configuration.running.table is None


def test_an_empty_slice_of_the_other_table_switches_too() -> None:
    pe = flying()
    bring(pe)
    assert sorted(stopped(switched(pe, Slice()))) == [CONTROL, SERVO_1]
    pe.command(*slice_of(SAME, 7), Activate(1, 7, Step.GO_ALL, 1007))
    assert pe.core.active_configuration.live == {CONTROL + 1: 0, SERVO_1 + 1: 0}


def test_a_pe_that_missed_the_switch_takes_it_from_lease() -> None:
    pe = flying()
    bring(pe)
    pe.command(*slice_of(LONGER, 6))
    actions = pe.command(Lease(1, 6, Step.GO_ALL, 1006))
    assert started(actions) == [EXTRA]
    assert not any(isinstance(one, SwitchTable) for one in pe.command(Activate(1, 6, Step.GO_ALL, 1006)))


def test_a_table_that_cannot_be_flown_without_a_restart_is_refused() -> None:
    (port,) = OTHER.ports
    slow = replace(OTHER, ports=(replace(port, heartbeat_ns=40 * MS),))
    more = replace(OTHER, ports=(port, Port("radio", 19_200, 100 * MS, 3, wireless=True, channels=1, nodes=(FAR,))))
    for table, reason in (
        (slow, "bus can0 is another one in it"),
        (more, "other buses"),
        (replace(OTHER, node_id=FAR), "it is for node 94"),
        (replace(OTHER, uplink=3), "uplink 3 names no port"),
    ):
        pe = flying()
        assert reason in notes(bring(pe, table))
        pe.command(*slice_of(SAME, 6, table))
        assert pe.ask()[1].reason is Reason.DIGEST


def test_a_driver_that_cannot_prepare_gives_a_table_up() -> None:
    pe = flying()
    pe.problem = "device pump cannot be opened"
    assert "a table is refused: device pump cannot be opened" in notes(bring(pe))
    pe.command(*slice_of(SAME, 6))
    assert pe.ask()[1].reason is Reason.DIGEST


def test_what_is_staged_of_a_table_is_forgotten_when_another_one_comes_beside() -> None:
    pe = flying()
    bring(pe)
    pe.command(*slice_of(SAME, 6))
    bring(pe, replace(OTHER, spec_digest="22" * 32))
    pe.command(Activate(1, 6, Step.GO_ALL, 1006))
    assert pe.core.active_configuration.running.epoch == 5


def test_code_that_the_new_table_lacks_is_told_and_its_slice_refused() -> None:
    pe = flying()
    pe.missing = {"extra": "no such image"}
    bring(pe)
    pe.command(*slice_of(LONGER, 6))
    assert pe.ask()[1].reason is Reason.IMAGE
    told = emergencies(switched(pe, SAME, 7), FaultCode.MODULE_MISSING)
    assert [(one.kind, one.index) for one in told] == [(ElementKind.MODULE, EXTRA)]
    pe.give(ImagesMissing({"monitor": "gone"}))
    back = switched(pe, FLYING, 8, TABLE)
    assert not emergencies(back, FaultCode.MODULE_MISSING)
    again = switched(pe, SAME, 9)
    assert [one.index for one in emergencies(again, FaultCode.MODULE_MISSING)] == [EXTRA]


def test_code_of_the_new_table_that_cannot_be_imported_is_lacking_before_the_switch() -> None:
    pe = flying()
    bring(pe)
    pe.give(ImagesMissing({"extra": "it cannot be imported"}))
    pe.command(*slice_of(LONGER, 6))
    assert pe.ask()[1].reason is Reason.IMAGE
    pe.give(ImagesArrived(frozenset({"extra"})))
    pe.command(*slice_of(LONGER, 7))
    assert pe.ask()[1].staged_epoch == 7


def test_slow_devices_are_waited_for_after_the_way_back_too() -> None:
    pe = flying(slow=frozenset({SERVO_1}))
    bring(pe)
    switched(pe, SAME)
    switched(pe, FLYING, 7, TABLE)
    pe.command(*slice_of(replace(FLYING, modules=FLYING.modules[:1]), 8, TABLE), Activate(1, 8, Step.BREAK, 1008))
    assert pe.ask()[0].epoch == 7
    pe.give(AtRest(SERVO_1))
    assert pe.ask()[0].epoch == 8


@pytest.mark.parametrize("names", [OTHER.module_names, tuple(n for n in OTHER.module_names if n != "servo_1")])
def test_the_slow_device_of_a_module_that_the_pe_does_not_have_any_more_is_waited_for(names: tuple[str, ...]) -> None:
    there = (one for one in OTHER.modules if one.name != "servo_1")
    other = replace(
        OTHER, modules=tuple(replace(one, index=names.index(one.name)) for one in there), module_names=names
    )
    pe = flying(slow=frozenset({SERVO_1}))
    bring(pe, other)
    pe.command(*slice_of(replace(SAME, modules=SAME.modules[:1]), 6, other), Activate(1, 6, Step.BREAK, 1006))
    page = pe.ask()[0]
    assert (page.state, page.epoch) == (PeState.ACTIVE, 5), "as if BREAK had not come"
    assert "does not come to rest" not in notes(pe.pass_time(LEASE_NS + MS))
    page = pe.ask()[0]
    assert (page.state, page.epoch) == (PeState.BROKEN, 6)


def test_what_is_flight_critical_follows_the_table() -> None:
    old = replace(TABLE, flight_critical=("module:control",))
    new = replace(OTHER, flight_critical=("module:control",))
    pe = flying(FLYING, old)
    bring(pe, new)
    switched(pe, SAME, 6, new)
    actions = pe.give(StepFailed(CONTROL + 1, pe.core.modules.schedule.begin(CONTROL + 1, pe.now_ns), "it broke", ""))
    assert len(sent(actions, emergency_event_id(NODE))) == 1


def test_an_identifier_that_passes_to_another_module_is_exclusive_while_both_tables_are_there() -> None:
    watched = Slice((RUN_MONITOR,), remote={RATE: NEIGHBOUR}, publish={2: 1})
    pe = flying(watched)
    pe.outputs = {MONITOR: {"alarm": 1}}
    swapped = replace(
        OTHER,
        sources=(
            SourceEntry("extra", "temperature", ALARM_ID, 100 * MS),
            *TABLE.sources[:2],
            replace(TABLE.sources[2], identifier=TEMPERATURE_ID),
        ),
    )

    def sends_alarms() -> bool:
        frames = sent(pe.pass_time(4 * BEAT_NS), ALARM_ID)
        return len(frames) > 1

    pe.command(Alive(1, 0, frozenset({NEIGHBOUR})))
    assert sends_alarms()
    pe.command(Alive(1, 0, frozenset({NEIGHBOUR, NODE})))
    bring(pe, swapped)
    pe.fly(2 * BEAT_NS, epoch=5, digest=1005)
    assert PeFlags.OUTPUT_HELD not in pe.ask()[0].flags
    pe.command(Alive(1, 0, frozenset({NEIGHBOUR})))
    assert not sends_alarms()
    assert PeFlags.OUTPUT_HELD in pe.ask()[0].flags
    pe.fly(2 * BEAT_NS, epoch=5, digest=1005)
    wanted = Slice((ModuleSlice(MONITOR + 1, 0, (RATE + 1, 3)),), remote={RATE + 1: NEIGHBOUR}, publish={3: 1})
    pe.command(*slice_of(wanted, 6, swapped))
    actions = pe.command(Activate(1, 6, Step.BREAK, 1006))
    assert any(isinstance(one, Withdraw) and ALARM_ID in one.identifiers for one in actions)
    pe.outputs = {MONITOR + 1: {"alarm": 1}}
    pe.command(Activate(1, 6, Step.GO_ALL, 1006))
    actions = pe.fly(4 * BEAT_NS, epoch=6, digest=1006)
    assert not sent(actions, ALARM_ID)
    assert sent(actions, TEMPERATURE_ID)


def test_a_gateway_forwards_by_the_new_table_to_the_nodes_beyond() -> None:
    alone = replace(GATEWAY_TABLE, ports=(GATEWAY_TABLE.ports[0], replace(GATEWAY_TABLE.ports[1], nodes=())))
    other = replace(OTHER, ports=GATEWAY_TABLE.ports)
    pe = flying(Slice(forward={RATE: (NEIGHBOUR, 2)}), alone)
    before = pe.core.identifiers
    bring(pe, other)
    pe.hear(rate_frame(1.0))
    switched(pe, Slice(forward={RATE + 1: (NEIGHBOUR, 2)}), 6, other)
    assert set(pe.core.identifiers) > set(before)
    assert sent(pe.hear(rate_frame(2.0)), 300, 1)


@pytest.fixture
def failed() -> OnePe:
    """A PE with a failed module, and a table beside."""
    pe = flying()
    pe.give(StepFailed(CONTROL, pe.core.modules.schedule.begin(CONTROL, pe.now_ns), "it broke", "line 1"))
    bring(pe)
    return pe


def test_a_fault_stays_on_record_under_its_new_index(failed: OnePe) -> None:
    switched(failed, SAME)
    told = emergencies(failed.command(Control(1, NODE, Operation.CLEAR, ElementKind.MODULE, CONTROL + 1)))
    assert [(one.code, one.index) for one in told] == [(FaultCode.RESET, CONTROL + 1)]
    assert failed.core.modules.failures.last(CONTROL + 1).reason == "it broke"


def test_a_fault_of_an_element_that_the_other_spec_lacks_is_forgotten() -> None:
    names = TABLE.module_names
    fewer = replace(TABLE, spec="fewer", spec_digest="33" * 32, modules=TABLE.modules[:3], module_names=names[:4])
    pe = flying(Slice((*FLYING.modules, RUN_MONITOR), remote=FLYING.remote, publish=FLYING.publish))
    pe.give(StepFailed(MONITOR, pe.core.modules.schedule.begin(MONITOR, pe.now_ns), "it broke", ""))
    fewer = replace(fewer, sources=TABLE.sources[:2])
    bring(pe, fewer)
    switched(pe, FLYING, 6, fewer)
    assert not emergencies(pe.pass_time(2 * BEAT_NS))
    assert pe.core.modules.failures.last(MONITOR).reason == ""


def test_requests_of_modules_that_go_on_stand_and_are_not_made_again() -> None:
    phases = (PhaseEntry("climb"), PhaseEntry("cruise", "demand", above=5.0, origins=(0,)))
    old = replace(TABLE, phases=phases, adjustable={"steer": 0, "look": 1})
    turned = (PhaseEntry("park"), phases[0], replace(phases[1], origins=(1,)))
    new = replace(OTHER, phases=turned, adjustable={"look": 0})
    pe = flying(FLYING, old)
    pe.command(Control(1, 0, Operation.HOLDS, ElementKind.PHASE, 0))
    pe.phases, pe.priorities = {CONTROL: ("cruise",)}, {CONTROL: (("look", 3), ("steer", 4)), SERVO_1: (("look", 5),)}
    pe.fly(2 * BEAT_NS, epoch=5, digest=1005)
    bring(pe, new)
    pe.phases, pe.priorities = {CONTROL + 1: ("cruise",)}, {CONTROL + 1: (("look", 3),), SERVO_1 + 1: (("look", 5),)}
    switched(pe, SAME, 6, new)
    asked = emergencies(pe.fly(5 * BEAT_NS, epoch=6, digest=1006))
    kinds = {(one.code, one.index) for one in asked if one.kind in (ElementKind.PHASE, ElementKind.PRIORITY)}
    phase = {index for code, index in kinds if code is FaultCode.PHASE_REQUEST}
    assert phase == {2}
    (look,) = {index for code, index in kinds if code is FaultCode.PRIORITY_REQUEST}
    assert look < 256
    pe.outputs, pe.phases = {CONTROL + 1: {"demand": 9.0}}, {}
    pe.fly(2 * BEAT_NS, epoch=6, digest=1006)
    assert switched(pe, FLYING, 7, old)


def test_states_of_modules_are_saved_by_the_new_table() -> None:
    def entry(number: int, module: int) -> CheckpointEntry:
        return CheckpointEntry(module, number, 40, 200 * MS, 5 * MS, 2000 * MS, 1 * MS, ((NEIGHBOUR,),), (5 * MS,))

    old = replace(TABLE, checkpoints=(entry(0, CONTROL), entry(1, MONITOR)))
    new = replace(OTHER, checkpoints=(entry(3, CONTROL + 1),))
    pe = flying(Slice((*FLYING.modules, RUN_MONITOR), remote=FLYING.remote, publish=FLYING.publish), old)
    bring(pe, new)
    switched(pe, SAME, 6, new)
    pe.fly(2 * BEAT_NS, epoch=6, digest=1006)
    pe.give(StateSaved(CONTROL + 1, 99, b"x", b"12345678", pe.now_ns))
    assert pe.core.counts["stale answer", CONTROL + 1] == 1
    before = len(pe.done)
    pe.fly(15 * BEAT_NS, epoch=6, digest=1006)
    asked = [action for _, action in pe.done[before:] if isinstance(action, SaveState)]
    assert {action.module for action in asked} == {CONTROL + 1}


def test_a_restart_that_is_due_and_silences_follow_the_table() -> None:
    restarting = replace(TABLE, modules=tuple(replace(one, restarts=3) for one in TABLE.modules))
    other = replace(OTHER, modules=tuple(replace(one, restarts=3) for one in OTHER.modules))
    pe = flying(FLYING, restarting)
    bring(pe, other)
    for _ in range(2):
        release = pe.core.modules.schedule.begin(CONTROL, pe.now_ns)
        pe.give(StepFailed(CONTROL, release, "it broke", ""))
        pe.pass_time(1 * MS)
    assert CONTROL in pe.core.modules.restarts.waiting
    actions = switched(pe, SAME, 6, other) + pe.fly(10 * BEAT_NS, epoch=6, digest=1006)
    assert CONTROL + 1 in started(actions)


def test_the_table_that_is_read_is_the_one_that_flies() -> None:
    pe = flying()
    bring(pe)
    switched(pe, SAME)
    assert pe.core.new_table is None
    index = pe.core.modules._index
    assert index.table.spec == "other"
    assert (index.modules.keys(), index.node) == ({0, 2, 3, 4, 5}, NODE)
    assert GYRO not in index.modules or index.lease_ns == LEASE_NS


def test_commands_of_an_earlier_switch_and_of_a_table_that_is_not_there_change_nothing() -> None:
    pe = flying()
    bring(pe)
    there = [*slice_of(SAME, 6), *(Activate(1, 6, step, 1006) for step in (Step.BREAK, Step.GO, Step.GO_ALL))]
    pe.command(*there)
    switched(pe, FLYING, 7, TABLE)
    before = len(pe.done)
    pe.command(*there)
    pe.command(Activate(1, 8, Step.GO_ALL, 1006))
    pe.command(*slice_of(SAME, 9, replace(OTHER, spec_digest="22" * 32)), Activate(1, 9, Step.BREAK, 1009))
    actions = [action for _, action in pe.done[before:]]
    assert not [one for one in actions if isinstance(one, SwitchTable)] + started(actions) + stopped(actions)
    running = pe.core.active_configuration.running
    assert (running.epoch, running.table) == (7, None)
