"""Modules at work: when they run, their inputs and outputs, and what happens when they fail."""

import math
from dataclasses import replace

import pytest

from agent.one_pe import (
    ALARM,
    CONTROL,
    DEMAND_ID,
    FAR,
    FLYING,
    MONITOR,
    MS,
    NEIGHBOUR,
    RATE,
    RUN_CONTROL,
    RUN_MONITOR,
    RUN_SERVO_1,
    SERVO_1,
    TABLE,
    OnePe,
    emergencies,
    neighbour_state,
    rate_frame,
    sent,
)
from heronry_agent.core.unknown_names import misspelt_output
from heronry_agent.core.vocabulary import Note, StepModule, Stepped
from heronry_agent.module import Value
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import (
    FaultCode,
)
from heronry_wire.sansio import Received, Tick

CONTROLLING = Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR})
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


def test_nothing_else_runs_while_a_module_computes() -> None:
    pe = flying()
    core = pe.core
    (step,) = (a for a in core.step(pe.now_ns, Tick()) if isinstance(a, StepModule))
    pe.now_ns += 10 * MS
    assert not [a for a in core.step(pe.now_ns, Tick()) if isinstance(a, StepModule)]
    answer = core.step(pe.now_ns, Stepped(step.module, step.release, {"demand": 1.0}))
    assert [a.module for a in answer if isinstance(a, StepModule)] == [SERVO_1]


# Their inputs


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


# Their outputs


def test_an_output_that_the_slice_does_not_publish_stays_here() -> None:
    pe = OnePe()
    pe.outputs[CONTROL] = {"demand": 0.1}
    pe.configure(Slice((RUN_CONTROL, RUN_SERVO_1), remote={RATE: NEIGHBOUR}), 7)
    actions = pe.fly(100 * MS, epoch=7, digest=1007)
    assert sent(actions, DEMAND_ID) == []
    assert pe.seen[SERVO_1] != {}


# When they fail


@pytest.mark.parametrize("value", [300, -1, 1.5, "a", (1, 2), None, math.nan])
def test_a_value_that_its_type_cannot_carry_is_a_fault_of_the_module(value: Value) -> None:
    pe = OnePe()
    pe.outputs[MONITOR] = {"alarm": value}
    pe.configure(WATCHING, 7)
    (told,) = emergencies(pe.pass_time(0))
    assert (told.code, told.index) == (FaultCode.MODULE_EXCEPTION, MONITOR)
    assert MONITOR not in pe.running


def test_a_misspelt_output_is_told_and_the_module_goes_on() -> None:
    pe = OnePe()
    pe.outputs[CONTROL] = {"demnad": 0.1}
    pe.configure(CONTROLLING, 7)
    (told,) = emergencies(pe.pass_time(0))
    assert (told.code, told.index) == (FaultCode.UNKNOWN_OUTPUT, CONTROL)
    assert CONTROL in pe.running
    (text,) = (a.text for _, a in pe.done if isinstance(a, Note) and "demnad" in a.text)
    assert text == "module control gives 'demnad'; did you mean 'demand'?"


def test_an_output_that_only_another_mode_has_is_left_out() -> None:
    control, *others = TABLE.modules
    changed = replace(control, modes=(replace(control.modes[0], gives={}), control.modes[1]))
    pe = OnePe(replace(TABLE, modules=(changed, *others)))
    pe.outputs[CONTROL] = {"demand": 0.1}
    pe.configure(CONTROLLING, 7)
    actions = pe.pass_time(0)
    assert (emergencies(actions), sent(actions, DEMAND_ID)) == ([], [])
    assert CONTROL in pe.running


def test_code_may_give_more_than_the_spec_takes() -> None:
    pe = OnePe()
    pe.outputs[CONTROL] = {"demand": 0.1, "trend": 0.2}
    pe.configure(CONTROLLING, 7)
    assert emergencies(pe.pass_time(0)) == []
    assert CONTROL in pe.running


@pytest.mark.parametrize(
    ("missing", "given", "found"),
    [
        (("demand",), ("demnad",), ("demnad", "demand")),
        ((), ("demand", "demnad"), None),
        (("demand",), ("trend",), None),
        ((), ("angle",), None),
    ],
)
def test_only_a_name_like_an_output_that_is_lacking_is_misspelt(
    missing: tuple[str, ...], given: tuple[str, ...], found: tuple[str, str] | None
) -> None:
    assert misspelt_output(TABLE.modules[0], missing, given) == found


def test_an_old_datum_taken_after_a_pause_is_as_old_as_it_is() -> None:
    pe = OnePe()
    pe.configure(WATCHING, 7)
    pe.give(Received(0, rate_frame(1.5), age_ns=70 * MS))
    pe.pass_time(0)
    assert pe.seen[MONITOR]["0"] == 1.5
    pe.pass_time(34 * MS)
    assert "0" not in pe.seen[MONITOR]
