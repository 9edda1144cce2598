"""`heronry why`: reasons of which each is needed, and smallest repairs."""

import json
import random
from collections.abc import Iterable
from dataclasses import replace
from itertools import combinations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, elements, situation
from heronry_manager.planner.exact import plan
from heronry_manager.planner.explain import explained as with_reasons
from heronry_tools.analysis.servable import Answer, Planning
from heronry_tools.analysis.why.assumptions import (
    MENDABLE,
    Assumption,
    Question,
    assumptions,
    capacity,
    in_words,
    relaxed,
    with_capacity,
)
from heronry_tools.analysis.why.reasons import Explanation, explain
from heronry_tools.cli import main
from heronry_tools.commands import why as why_command
from heronry_tools.console.errors import UserError
from planner.random_specs import random_spec
from thoroughness import part_of

CHUTE = load(shipped_spec_path("elevator_and_chute"))
TIGHT = replace(CHUTE, pes={name: replace(pe, cpu_millis=150) for name, pe in CHUTE.pes.items()})

SPREAD = replace(CHUTE, pes={**CHUTE.pes, "tail_pe": replace(CHUTE.pes["tail_pe"], cpu_millis=80)})
"""The elevator's controller does not fit beside its servos: the bus is needed."""


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    code = main(["why", *arguments])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return out


def explained(spec: Spec, function: str, *down: str) -> Explanation:
    return explain(spec, situation(spec, down), spec.functions[function])


def test_it_gives_the_reason_that_a_plan_gives() -> None:
    small = replace(CHUTE, pes={name: replace(pe, cpu_millis=60) for name, pe in CHUTE.pes.items()})
    said = explained(small, "elevator").report.why_not
    assert said == with_reasons(small, plan(small, Situation())).functions["elevator"].why_not
    assert said == "the PEs and buses that are up cannot fit it, even alone"


def mended(spec: Spec, found: Explanation) -> list[tuple[Spec, Situation]]:
    """The spec and the situation after each repair."""
    after = []
    for repair in found.repairs:
        repaired = spec
        for one, amount in repair.capacities:
            repaired = with_capacity(repaired, one, amount)
        limits = {name: share for name, share in found.now.limits.items() if name not in repair.whole}
        after.append((repaired, replace(found.now, down=found.now.down - set(repair.restore), limits=limits)))
    return after


# As a user meets it


def test_a_fault_is_the_reason_and_its_end_the_repair(capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, "elevator_and_chute", "elevator", "--down", "pe:tail_pe", "--down", "device:gps")
    assert out.startswith("elevator is not served: servo_driver_1 needs device elevator_servo_1 on tail_pe, which is")
    assert out.endswith("because, all at once:\n  pe:tail_pe is down\nrepaired by:\n  pe:tail_pe comes back\n")


def test_two_faults_that_each_suffice_to_lose_it_must_both_be_repaired(capsys: pytest.CaptureFixture[str]) -> None:
    down = ("--down", "device:chute_solenoid", "--down", "module:chute_logic")
    out = run(capsys, "elevator_and_chute", "parachute", *down)
    assert "\nbecause, all at once:\n  module:chute_logic is down\nrepaired by:\n" in out, "either of them is enough"
    assert out.endswith("repaired by:\n  device:chute_solenoid comes back, and module:chute_logic comes back\n")


def test_a_worse_mode_has_reasons_too(capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, "big_blue", "guidance", "--down", "device:gps", "--phase", "glide")
    assert out.startswith(
        "guidance is served in glide, but only in mode level: value 30 instead of 100\n"
        "because, all at once:\n  device:gps is down\nrepaired by:\n  device:gps comes back\n"
        "less than the best, in it and upstream of it:\n  guidance runs in mode level, not route\n"
    )


def test_what_is_less_upstream_of_a_best_mode_is_named_with_its_module(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "elevator_and_chute", "parachute", "--down", "device:barometer") == (
        "parachute is served, in its best mode: only, but not with the best upstream\n"
        "less than the best, in it and upstream of it:\n"
        "  chute_logic reads altitude@2\n"
        "  high_quality_altitude runs in mode gps_only, not fused\n"
    )


def test_what_is_well_and_what_is_not_wanted_need_no_reasons(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, "elevator_and_chute", "elevator") == "elevator is served, in its best mode: only\n"
    out = run(capsys, "big_blue", "experiment", "--phase", "landing")
    assert out == "experiment is not served in landing: it is not wanted in phase landing\n"


def test_json_says_the_same(capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, "elevator_and_chute", "elevator", "--down", "pe:tail_pe", "--json")
    document = json.loads(out)
    assert document["reasons"] == [{"kind": "down", "name": "pe:tail_pe", "text": "pe:tail_pe is down"}]
    assert document["repairs"] == [{"restore": ["pe:tail_pe"], "add": []}]
    assert (document["served"], document["value"], document["best_value"]) == (False, 0, 100)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["elevater"], "did you mean 'elevator'?"),
        (["elevator", "--down", "pe:tail"], "no PE is named 'tail'; did you mean 'tail_pe'?"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["why", "elevator_and_chute", *arguments]) == 2
    assert sentence in capsys.readouterr().err


# Resources


def test_for_a_function_without_room_the_answer_names_how_much_would_be_enough() -> None:
    """With a PE less the servo's monitor gives way; either a PE comes back or one of the others gets more CPU."""
    found = explained(TIGHT, "servo_monitoring", "pe:sensor_pe")
    assert {one.kind for one in found.reasons} <= {"down", "cpu", "function"}
    assert len(found.repairs) > 1
    assert found.repairs[0].restore == ("pe:sensor_pe",)
    text = why_command._text(TIGHT, found)
    assert "repaired by any one of these:\n  pe:sensor_pe comes back\n" in text
    assert "cores more on pe control_pe (" in text
    document = json.loads(why_command._json(TIGHT, found))
    assert any(one["add"] and one["add"][0]["kind"] == "cpu" for one in document["repairs"])


@pytest.mark.parametrize(
    ("spec", "function", "kind"),
    [
        (
            replace(CHUTE, pes={**CHUTE.pes, "control_pe": replace(CHUTE.pes["control_pe"], ram=900)}),
            "parachute",
            "ram",
        ),
        (
            replace(CHUTE, pes={**CHUTE.pes, "control_pe": replace(CHUTE.pes["control_pe"], flash=900)}),
            "parachute",
            "flash",
        ),
        (
            replace(SPREAD, buses={"can0": replace(CHUTE.buses["can0"], bitrate=20_000)}),
            "elevator",
            "bandwidth",
        ),
    ],
)
def test_every_capacity_can_be_the_reason(spec: Spec, function: str, kind: str) -> None:
    found = explained(spec, function)
    assert kind in {one.kind for one in found.reasons}
    (repair,) = [one for one in found.repairs if [part.kind for part, _ in one.capacities] == [kind]]
    ((one, amount),) = repair.capacities
    assert plan(with_capacity(spec, one, amount), Situation()).functions[function].served
    assert "more on" in why_command._text(spec, found)


def test_rules_and_deadlines_can_be_reasons_that_nothing_repairs() -> None:
    apart = replace(CHUTE, separate=(("chute_logic", "release_driver"), ("chute_logic", "chute_driver")))
    bound = replace(apart, together=(("chute_logic", "chute_driver"),))
    found = explained(bound, "parachute")
    assert {one.kind for one in found.reasons} == {"separate", "together"}
    assert found.repairs == ()
    text = why_command._text(bound, found)
    assert "chute_logic and chute_driver must not share a PE" in text
    assert "chute_logic and chute_driver must share a PE" in text
    assert text.endswith("no returning element and no added capacity repairs it\n")

    hurried = {name: replace(one, deadline_ns=1) for name, one in CHUTE.variables.items()}
    late = explained(replace(SPREAD, variables=hurried), "elevator")
    assert "deadlines" in {one.kind for one in late.reasons}
    assert in_words(CHUTE, Assumption("deadlines", "")) == "data must arrive in time"


def test_a_variable_without_a_giver_has_no_reason_that_could_be_relaxed() -> None:
    modules = {name: module for name, module in CHUTE.modules.items() if name != "elevator_control"}
    found = explained(replace(CHUTE, modules=modules), "elevator")
    assert (found.reasons, found.repairs) == ((), ())
    assert "which no module gives" in str(found.report.why_not)


def test_a_service_that_is_worth_nothing_has_nothing_in_its_way() -> None:
    worthless = replace(CHUTE.functions["servo_monitoring"], criticality={None: "E"}, value=(0,))
    spec = replace(CHUTE, functions={**CHUTE.functions, "servo_monitoring": worthless})
    found = explained(spec, "servo_monitoring")
    assert not found.report.served
    assert found.reasons == ()


def test_a_limit_is_a_reason_and_its_end_a_repair(capsys: pytest.CaptureFixture[str]) -> None:
    said = run(capsys, "elevator_and_chute", "elevator", "--limit", "pe:tail_pe=5%")
    assert "pe:tail_pe has less than its capacity" in said
    assert "repaired by any one of these:\n  pe:tail_pe has its whole capacity again\n" in said
    document = json.loads(run(capsys, "elevator_and_chute", "elevator", "--limit", "pe:tail_pe=5%", "--json"))
    assert document["limits"] == {"pe:tail_pe": "5%"}
    assert document["repairs"][0] == {"restore": [], "whole": ["pe:tail_pe"], "add": []}


def test_what_cannot_be_found_out_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Planning, "all_at_once", lambda *_: Answer(None, proven=False))
    with pytest.raises(UserError, match="did not decide in time"):
        explained(CHUTE, "elevator", "pe:tail_pe")


def test_only_capacities_have_an_amount() -> None:
    with pytest.raises(ValueError, match="down is no capacity"):
        capacity(CHUTE, Assumption("down", "pe:tail_pe"))


# What makes reasons irreducible, and repairs smallest


@settings(max_examples=part_of(15))
@given(st.randoms(use_true_random=False), st.data())
def test_each_reason_is_needed_and_each_repair_is_least(rng: random.Random, data: st.DataObject) -> None:
    spec = random_spec(rng, modules=5)
    down = frozenset(data.draw(st.sets(st.sampled_from(elements(spec)), max_size=2)))
    limited = data.draw(st.sets(st.sampled_from([f"pe:{pe}" for pe in spec.pes]), max_size=1))
    limits = [f"{element}={data.draw(st.integers(0, 99))}%" for element in limited]
    name = data.draw(st.sampled_from(list(spec.functions)))
    found = explain(spec, situation(spec, down, limits), spec.functions[name])
    if not found.reasons:
        return
    least = found.best_value if found.report.served else 0
    healthy = placement(plan(spec, situation(spec)).configuration)
    reports = plan(spec, found.now, healthy if down or limits else None).functions
    served = {other: report.value for other, report in reports.items() if report.served}
    question = Question(spec, down, found.now.limits, {**served, name: least})
    others = [one for one in assumptions(question, name) if one not in found.reasons]
    assert not possible(question, others), "the reasons suffice"
    for one in found.reasons:
        assert possible(question, [*others, one]), f"{one} is needed"
    for repair, (repaired, now) in zip(found.repairs, mended(spec, found), strict=True):
        report = plan(repaired, now).functions[name]
        assert report.served
        assert report.value >= least
        for one, amount in repair.capacities:
            less = Question(with_capacity(repaired, one, amount - 1), now.down, now.limits, question.least)
            assert not possible(less, []), "a little less is not enough"
        parts = len(repair.restore) + len(repair.whole) + len(repair.capacities)
        soft = [one for one in assumptions(question, name) if one.kind in MENDABLE]
        for fewer in combinations(soft, parts - 1):
            assert not possible(question, fewer) or parts == 1, "a smaller repair would do"


def possible(question: Question, without: Iterable[Assumption]) -> bool:
    asked = relaxed(question, tuple(without))
    return (
        Planning(asked.spec).all_at_once(tuple(asked.least), asked.down, asked.least, asked.limits).configuration
        is not None
    )
