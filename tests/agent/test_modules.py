"""Modules at work: when they run, what they see, what they say, and what happens when they fail."""

import math

import pytest

from agent.one_pe import (
    ALARM,
    ALARM_ID,
    BEAT_NS,
    CONTROL,
    DEMAND,
    DEMAND_ID,
    FAR,
    FLYING,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RATE_ID,
    RUN_CONTROL,
    RUN_MONITOR,
    RUN_SERVO_1,
    SERVO_1,
    TABLE,
    OnePe,
    neighbour_state,
    rate_frame,
    sent,
    slice_messages,
    stopped,
)
from heronry_agent.core.agent import AgentCore
from heronry_agent.core.vocabulary import Heard, StepFailed, StepModule, Stepped
from heronry_agent.module import Value
from heronry_wire.canaerospace import DataType, Datum, Status, Validity, decode_data, encode_data, pack_status
from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import actuator_echo_id, emcy_id
from heronry_wire.management import (
    Activate,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Operation,
    Step,
    decode_emergency,
)
from heronry_wire.sansio import Received, Tick
from heronry_wire.state_frames import PeFlags

WATCHING = Slice((RUN_MONITOR,), remote={RATE: NEIGHBOUR}, publish={ALARM: 1})


def flying() -> OnePe:
    pe = OnePe()
    pe.outputs[CONTROL] = {"demand": 0.1}
    pe.configure(FLYING, 7)
    pe.hear(neighbour_state(7))
    return pe


# When they run


def test_a_module_runs_on_an_exact_grid_from_its_start() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    start_ns = pe.now_ns
    pe.pass_time(1_000 * MS)
    assert [at_ns - start_ns for at_ns in pe.steps[MONITOR]] == [k * 1_000_000_000 // 30 for k in range(31)]


def test_a_late_release_is_made_up_once_and_the_others_are_skipped_and_counted() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    start_ns = pe.now_ns
    pe.pass_time(1 * MS)
    pe.now_ns = start_ns + 120 * MS
    pe.give(Tick())
    pe.pass_time(20 * MS)
    assert [at_ns - start_ns for at_ns in pe.steps[MONITOR]] == [0, 120 * MS, 4 * 1_000_000_000 // 30]
    assert pe.core.modules.schedule.overruns[MONITOR] == 2


def test_modules_due_at_once_run_in_the_order_of_the_spec_and_hand_on_within_the_instant() -> None:
    pe = flying()
    pe.pass_time(0)
    assert pe.steps == {CONTROL: [pe.now_ns], SERVO_1: [pe.now_ns]}
    assert pe.seen[SERVO_1] == {"": pytest.approx(0.1, abs=1e-7)}


def test_nothing_else_runs_while_a_module_computes() -> None:
    pe = flying()
    core = pe.core
    (step,) = (a for a in core.step(pe.now_ns, Tick()) if isinstance(a, StepModule))
    pe.now_ns += 10 * MS
    assert not [a for a in core.step(pe.now_ns, Tick()) if isinstance(a, StepModule)]
    answer = core.step(pe.now_ns, Stepped(step.module, step.release, {"demand": 1.0}))
    assert [a.module for a in answer if isinstance(a, StepModule)] == [SERVO_1]


def test_the_answer_of_a_module_that_was_stopped_since_is_dropped() -> None:
    pe = flying()
    (step,) = (a for a in pe.core.step(pe.now_ns, Tick()) if isinstance(a, StepModule))
    blind = Slice((ModuleSlice(CONTROL, 1, ()),), publish={DEMAND: 1})
    pe.command(*slice_messages(blind, 8, 1008), Activate(1, 8, Step.GO_ALL, 1008))
    assert sent(pe.core.step(pe.now_ns, Stepped(step.module, step.release, {"demand": 1.0})), DEMAND_ID) == []
    pe.give(StepFailed(step.module, step.release, "too late"))
    assert pe.running == {CONTROL: 1}
    pe.core.validate()


# What they see


def test_a_datum_is_seen_while_it_is_fresh() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    pe.hear(rate_frame(1.5))
    pe.pass_time(70 * MS)
    assert pe.seen[MONITOR]["0"] == 1.5
    pe.pass_time(30 * MS)
    assert "0" not in pe.seen[MONITOR]
    pe.hear(rate_frame(2.5))
    pe.pass_time(34 * MS)
    assert pe.seen[MONITOR]["0"] == 2.5


@pytest.mark.parametrize(
    "frame",
    [
        rate_frame(1.5, node=FAR),  # another node than the slice names
        rate_frame(1.5, node=NODE),
        rate_frame(1.5, status=pack_status(Status(3, Validity.VALID))),  # a version that the leaf does not accept
        rate_frame(1.5, status=0x10),  # no version
        rate_frame(1.5, status=0x91),  # a validity that is not defined
        encode_data(RATE_ID, Datum(NEIGHBOUR, DataType.LONG, 0x11, 0, 3)),  # another type
        Frame(RATE_ID, rate_frame(1.5).data[:7]),
        Frame(RATE_ID, b""),
    ],
)
def test_a_datum_that_is_not_what_was_wired_is_not_seen(frame: Frame) -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    pe.hear(frame)
    pe.pass_time(10 * MS)
    assert "0" not in pe.seen[MONITOR]


def test_a_producer_that_does_not_trust_its_datum_says_so() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    pe.hear(rate_frame(1.5, status=pack_status(Status(2, Validity.INVALID))))
    (step,) = (a for a in pe.core.step(pe.now_ns, Tick()) if isinstance(a, StepModule))
    variable, datum = step.inputs["0"]
    assert (variable, datum.version, datum.valid) == ("rate", 2, False)


def test_an_initial_value_fills_a_feedback_until_the_first_datum_and_not_after_the_last() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    pe.pass_time(0)
    assert pe.seen[MONITOR] == {"1": 7}
    pe.outputs[MONITOR] = {"alarm": 3}
    pe.pass_time(100 * MS)
    assert pe.seen[MONITOR] == {"1": 3}
    pe.outputs[MONITOR] = {}
    pe.pass_time(200 * MS)
    assert pe.seen[MONITOR] == {}


def test_a_rewired_leaf_forgets_the_old_producer_and_keeps_an_unmoved_one() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    pe.hear(rate_frame(1.5))
    pe.configure(WATCHING, 8)
    pe.pass_time(0)
    assert pe.seen[MONITOR]["0"] == 1.5
    pe.configure(Slice((RUN_MONITOR,), remote={RATE: FAR}), 9)
    pe.pass_time(40 * MS)
    assert "0" not in pe.seen[MONITOR]


# What they say


def test_an_output_goes_to_the_bus_with_node_version_and_counting_message_code() -> None:
    pe = flying()
    frames = sent(pe.fly(200 * MS, epoch=7, digest=1007), DEMAND_ID)
    data = [decode_data(frame) for frame in frames]
    assert all(isinstance(datum, Datum) for datum in data)
    assert [frame.data[3] for frame in frames] == list(range(len(frames)))
    assert {frame.data[:3] for frame in frames} == {bytes((NODE, DataType.FLOAT, 0x11))}


def test_an_output_that_the_slice_does_not_publish_stays_here() -> None:
    pe = OnePe()
    pe.outputs[CONTROL] = {"demand": 0.1}
    pe.configure(Slice((RUN_CONTROL, RUN_SERVO_1), remote={RATE: NEIGHBOUR}), 7)
    actions = pe.fly(100 * MS, epoch=7, digest=1007)
    assert sent(actions, DEMAND_ID) == []
    assert pe.seen[SERVO_1] != {}


def test_a_value_left_out_is_not_published_and_one_not_in_the_mode_is_ignored() -> None:
    pe = OnePe()
    pe.outputs[MONITOR] = {"rate": 1.0, "nonsense": 2}
    pe.configure(WATCHING, 7)
    actions = pe.pass_time(100 * MS)
    assert sent(actions, ALARM_ID) == []
    assert MONITOR in pe.running


def test_what_an_actuator_was_told_is_echoed_below_all_data() -> None:
    pe = flying()
    frames = sent(pe.fly(100 * MS, epoch=7, digest=1007), actuator_echo_id(NODE))
    data = [decode_data(frame) for frame in frames]
    assert data[:2] == [Datum(NODE, DataType.FLOAT, 1, code, 1.5) for code in (0, 1)]


def test_the_echo_of_another_pe_is_heard() -> None:
    pe = OnePe()
    echo = encode_data(actuator_echo_id(FAR), Datum(FAR, DataType.FLOAT, 3, 0, -4.0))
    assert pe.hear(echo) == [Heard("rudder", -4.0)]
    for wrong in (
        Datum(FAR, DataType.FLOAT, 1, 0, -4.0),  # a device of this PE
        Datum(NEIGHBOUR, DataType.FLOAT, 0, 0, -4.0),
        Datum(FAR, DataType.FLOAT, 200, 0, -4.0),
        Datum(FAR, DataType.LONG, 3, 0, 4),
    ):
        assert pe.hear(encode_data(actuator_echo_id(FAR), wrong)) == []


def test_a_world_that_follows_no_actuator_of_a_pe_does_not_hear_its_echoes() -> None:
    rudders, nothing = (AgentCore(TABLE, 5, 0, followed=names) for names in (("rudder",), ("left",)))
    assert actuator_echo_id(FAR) in rudders.identifiers
    assert actuator_echo_id(NEIGHBOUR) not in rudders.identifiers
    assert actuator_echo_id(FAR) not in nothing.identifiers


# When they fail


def emergencies(actions: list) -> list[Emergency]:
    found = [decode_emergency(frame.data) for frame in sent(actions, emcy_id(NODE))]
    return [emergency for emergency in found if isinstance(emergency, Emergency)]


def test_a_module_that_raises_is_stopped_and_told_until_it_is_acknowledged() -> None:
    pe = flying()
    (step,) = (a for a in pe.core.step(pe.now_ns, Tick()) if isinstance(a, StepModule))
    actions = pe.give(StepFailed(CONTROL, step.release, "division by zero"))
    assert stopped(actions) == [CONTROL]
    (told,) = emergencies(actions)
    assert (told.code, told.kind, told.index) == (FaultCode.MODULE_EXCEPTION, ElementKind.MODULE, CONTROL)
    assert len(emergencies(pe.pass_time(5 * BEAT_NS))) == 5
    assert PeFlags.FAULT_PENDING in pe.ask()[0].flags

    pe.command(Control(1, NODE, Operation.ACKNOWLEDGE, ElementKind.MODULE, CONTROL))
    assert emergencies(pe.pass_time(5 * BEAT_NS)) == []
    assert PeFlags.FAULT_PENDING not in pe.ask()[0].flags
    assert pe.running == {SERVO_1: 0}


@pytest.mark.parametrize("node", [NEIGHBOUR, FAR])
def test_an_acknowledgement_for_others_or_of_another_element_settles_nothing(node: int) -> None:
    pe = flying()
    (step,) = (a for a in pe.core.step(pe.now_ns, Tick()) if isinstance(a, StepModule))
    pe.give(StepFailed(CONTROL, step.release, "oops"))
    pe.command(Control(1, node, Operation.ACKNOWLEDGE, ElementKind.MODULE, CONTROL))
    pe.command(Control(1, 0, Operation.ACKNOWLEDGE, ElementKind.DEVICE, CONTROL))
    assert emergencies(pe.pass_time(BEAT_NS)) != []
    pe.command(Control(1, 0, Operation.ACKNOWLEDGE, ElementKind.MODULE, CONTROL))
    assert emergencies(pe.pass_time(BEAT_NS)) == []


@pytest.mark.parametrize("value", [300, -1, 1.5, "a", (1, 2), None, math.nan])
def test_a_value_that_its_type_cannot_carry_is_a_fault_of_the_module(value: Value) -> None:
    pe = OnePe()
    pe.outputs[MONITOR] = {"alarm": value}
    pe.configure(WATCHING, 7)
    (told,) = emergencies(pe.pass_time(0))
    assert (told.code, told.index) == (FaultCode.MODULE_EXCEPTION, MONITOR)
    assert MONITOR not in pe.running


def report(pe: OnePe, *reports: tuple[str, int]) -> list[Emergency]:
    pe.now_ns = pe.core.modules.schedule.next_ns
    (step,) = (a for a in pe.core.step(pe.now_ns, Tick()) if isinstance(a, StepModule))
    return emergencies(pe.give(Stepped(step.module, step.release, {}, (), reports)))


def test_a_reported_element_is_told_once_while_it_is_pending_and_again_after_a_second() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    assert report(pe, ("device:left", 3), ("module:gyro", -1)) == [
        Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 1, 3),
        Emergency(FaultCode.REPORTED, 0x81, ElementKind.MODULE, 0, 0),
    ]
    assert report(pe, ("device:left", 3)) == []
    pe.command(Control(1, NODE, Operation.ACKNOWLEDGE, ElementKind.DEVICE, 1))
    assert report(pe, ("device:left", 3)) == [], "the manager has just heard it"
    pe.pass_time(1_000 * MS)
    assert len(report(pe, ("device:left", 3))) == 1, "it may have been healed since"


def test_a_report_of_an_element_that_is_not_in_the_spec_is_counted() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    assert report(pe, ("device:nonsense", 0), ("nonsense", 0)) == []
    assert pe.core.counts["report of an unknown element", MONITOR] == 2


def test_an_old_datum_taken_after_a_pause_is_as_old_as_it_is() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    pe.give(Received(0, rate_frame(1.5), age_ns=70 * MS))
    pe.pass_time(0)
    assert pe.seen[MONITOR]["0"] == 1.5
    pe.pass_time(34 * MS)
    assert "0" not in pe.seen[MONITOR]
