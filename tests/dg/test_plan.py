"""Plan files: what is written, what is read back, and one clear sentence for whatever is malformed."""

import contextlib
import json
import random
from dataclasses import replace
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.plan import (
    Plan,
    PlanError,
    make_plan,
    read_configuration,
    read_plan,
    read_running,
    read_situation,
)
from heronry_dg.plan_report import LevelReport
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, Survivors, situation, survivors
from planner.enumerator import Enumerator
from planner.random_specs import random_case
from thoroughness import part_of

FIGURE_3 = load(shipped_spec_path("elevator_and_chute"))
CHUTE = Configuration(
    {
        "chute_driver": Running("control_pe", "only", {"": Wire("chute_logic", "chute_release", 1)}),
        "chute_logic": Running("control_pe", "only", {"1": Wire("release_driver", "release_command", 1)}),
        "release_driver": Running("control_pe", "only"),
        "pressure_driver": Running("sensor_pe", "only"),
        "low_quality_altitude": Running("tail_pe", "only", {"": Wire("pressure_driver", "absolute_pressure", 1)}),
    }
)


def chute_plan() -> Plan:
    down, limits = ["device:gps", "pe:tail_pe"], ["bus:can0=40%", "pe:sensor_pe=12.5%"]
    now = situation(FIGURE_3, down, limits, priorities=["elevator=7"])
    return make_plan(FIGURE_3, now, CHUTE, score(FIGURE_3, now, CHUTE, {}), optimal=False, reasons={"elevator": "why."})


def test_the_file_has_exactly_this_shape() -> None:
    document = json.loads(chute_plan().to_json())
    assert list(document.pop("modules")) == [
        "pressure_driver",
        "low_quality_altitude",
        "release_driver",
        "chute_logic",
        "chute_driver",
    ]
    assert document == {
        "spec": FIGURE_3.digest,
        "phase": None,
        "down": ["device:gps", "pe:tail_pe"],
        "limits": {"bus:can0": "40%", "pe:sensor_pe": "12.5%"},
        "priorities": {"elevator": 7},
        "objective": {
            "critical": {"A": 0, "B": 80, "C": 0, "D": 0},
            "utility": 8000,
            "inputs": 1,
            "changes": 5,
            "branches": 0,
            "bus_bits_per_s": 0,
            "cpu_millis": 100,
        },
        "optimal": False,
        "levels": [
            {"level": "critical A", "value": 0, "bound": None, "proven": False},
            {"level": "critical B", "value": 80, "bound": None, "proven": False},
            {"level": "critical C", "value": 0, "bound": None, "proven": False},
            {"level": "critical D", "value": 0, "bound": None, "proven": False},
            {"level": "utility", "value": 8000, "bound": None, "proven": False},
            {"level": "inputs", "value": 1, "bound": None, "proven": False},
            {"level": "changes", "value": 5, "bound": None, "proven": False},
            {"level": "branches", "value": 0, "bound": None, "proven": False},
            {"level": "bus_bits_per_s", "value": 0, "bound": None, "proven": False},
            {"level": "cpu_millis", "value": 100, "bound": None, "proven": False},
        ],
        "functions": {
            "elevator": {"served": False, "mode": None, "value": 0, "why_not": "why."},
            "parachute": {"served": True, "mode": "only", "value": 100, "why_not": None},
            "servo_monitoring": {
                "served": False,
                "mode": None,
                "value": 0,
                "why_not": "servo_monitor needs elevator_angle from angle_driver, which needs device "
                "elevator_angle_sensor on tail_pe, which is down",
            },
        },
        "pes": {
            "sensor_pe": {"cpu_millis": 20, "ram": 1024, "flash": 2048},
            "control_pe": {"cpu_millis": 40, "ram": 3072, "flash": 3072 + 1024},
            "tail_pe": {"cpu_millis": 40, "ram": 2048, "flash": 3072},
        },
        "buses": {"can0": {"bits_per_s": 0, "load": 0.0}},
    }


def test_a_module_and_its_wires_in_the_file() -> None:
    modules = json.loads(chute_plan().to_json())["modules"]
    assert modules["chute_driver"] == {
        "pe": "control_pe",
        "mode": "only",
        "inputs": {"": {"producer": "chute_logic", "variable": "chute_release", "version": 1}},
    }


def bounded_plan() -> Plan:
    now = situation(FIGURE_3)
    objective = replace(score(FIGURE_3, now, CHUTE, {}), bus_mbit_per_s=10_800_999)
    bounds = (*objective.key()[:5], 4, None, 0, -10_800_001, -objective.cpu_millis)
    return make_plan(FIGURE_3, now, CHUTE, objective, optimal=False, bounds=bounds)


def test_a_level_says_how_good_it_could_be() -> None:
    reports = {one.level: one for one in bounded_plan().levels}
    assert reports["utility"] == LevelReport("utility", 8000, 8000, proven=True)
    assert reports["inputs"] == LevelReport("inputs", 1, 4, proven=False)
    assert reports["changes"] == LevelReport("changes", 5, None, proven=False)
    assert reports["cpu_millis"] == LevelReport("cpu_millis", 100, 100, proven=True)
    # Both are reported as 10 800 bit/s, rounded down, and are not the same.
    assert reports["bus_bits_per_s"] == LevelReport("bus_bits_per_s", 10_800, 10_800, proven=False)


def test_what_is_proven_of_the_levels_is_read_back() -> None:
    now = situation(FIGURE_3)
    objective = score(FIGURE_3, now, CHUTE, {})
    bounds = (*objective.key()[:5], 4, *objective.key()[6:])
    plan = make_plan(FIGURE_3, now, CHUTE, objective, optimal=False, bounds=bounds)
    assert read_plan(plan.to_json(), FIGURE_3) == plan


def test_a_plan_of_before_levels_is_read_as_far_as_it_says() -> None:
    document = json.loads(chute_plan().to_json())
    del document["levels"]
    assert read_plan(json.dumps(document), FIGURE_3) == chute_plan()


@pytest.mark.parametrize(
    ("levels", "sentence"),
    [
        ([7], "levels.0 is 7 and must be an object"),
        ([{"level": "critical A"}], "levels.0 has no 'value'"),
        ([], "the plan's 'levels' and 'objective' contradict each other: make a new plan"),
    ],
)
def test_levels_that_are_none(levels: list[object], sentence: str) -> None:
    document = json.loads(chute_plan().to_json()) | {"levels": levels}
    with pytest.raises(PlanError, match=sentence):
        read_plan(json.dumps(document), FIGURE_3)


def test_a_plan_is_optimal_when_all_its_levels_are() -> None:
    document = json.loads(chute_plan().to_json()) | {"optimal": True}
    sentence = "the plan's field 'optimal' does not agree with its field 'levels': make a new plan"
    with pytest.raises(PlanError, match=sentence):
        read_plan(json.dumps(document), FIGURE_3)


def test_bus_load_is_the_share_of_the_bit_rate() -> None:
    now = situation(FIGURE_3)
    plan = make_plan(FIGURE_3, now, CHUTE, score(FIGURE_3, now, CHUTE, None), optimal=True)
    assert plan.buses["can0"].bits_per_s == 135 * 80
    assert plan.buses["can0"].load == 135 * 80 / 1_000_000


@given(st.randoms(use_true_random=False))
@settings(deadline=None, max_examples=part_of(50))
def test_a_plan_is_read_back_as_it_was(rng: random.Random) -> None:
    case = random_case(rng, modules=4)
    _, best = Enumerator(case.spec, case.now).best(case.running)
    plan = make_plan(
        case.spec, case.now, best, score(case.spec, case.now, best, case.running), optimal=rng.random() < 0.5
    )
    text = plan.to_json()
    assert read_plan(text, case.spec) == plan
    assert read_plan(text, case.spec).to_json() == text
    assert read_situation(text, case.spec) == case.now
    assert read_configuration(text) == plan.configuration
    assert read_running(text, case.spec) == {name: (r.mode, r.pe) for name, r in best.modules.items()}


def test_a_report_is_worked_out_when_it_is_read_and_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Situation] = []

    def survivors_noted(spec: Spec, now: Situation) -> Survivors:
        asked.append(now)
        return survivors(spec, now)

    monkeypatch.setattr("heronry_dg.plan_report.survivors", survivors_noted)
    monkeypatch.setattr("heronry_dg.why_not.survivors", survivors_noted)
    now = Situation(frozenset({"pe:tail_pe"}))
    plan = make_plan(FIGURE_3, now, CHUTE, score(FIGURE_3, now, CHUTE, None), optimal=False)
    assert asked == []
    plan.report.work_out()
    assert plan.document() == plan.document()
    assert asked.count(now) == 1
    assert plan.report.with_reasons({"elevator": "why."}).functions["elevator"].why_not == "why."


def test_a_foreign_plan_needs_modules_alone() -> None:
    text = '{"made_by": 3, "modules": {"a": {"pe": "p", "mode": "m", "inputs": {}, "colour": "red"}}, "pes": []}'
    assert read_configuration(text) == Configuration({"a": Running("p", "m")})
    assert read_situation(text, FIGURE_3) == Situation()


def test_a_running_plan_needs_places_and_modes_alone() -> None:
    text = '{"modules": {"gps_driver": {"pe": "sensor_pe", "mode": "only", "inputs": 7}}}'
    assert read_running(text, FIGURE_3) == {"gps_driver": ("only", "sensor_pe")}
    for wrong, sentence in (("gps_driver", "no module"), ("only", "no mode"), ("sensor_pe", "no PE")):
        with pytest.raises(PlanError, match=sentence):
            read_running(text.replace(wrong, "another"), FIGURE_3)


WIRED = '{"modules": {"a": {"pe": "p", "mode": "m", "inputs": {"0.1": %s}}}}'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "line 1, column 1: this is not JSON (Expecting value)"),
        ('{\n "modules": {,}}', "line 2, column 14: this is not JSON"),
        ("[]", "the plan is [] and must be an object"),
        ("NaN", "the file holds NaN, which is no JSON number"),
        ("1" * 5000, "the file holds a number too long for a plan"),
        ("[" * 100_000, "the file is nested too deeply to be a plan"),
        ("{}", "the plan has no 'modules'"),
        ('{"modules": []}', "the plan: 'modules' is [] and must be an object"),
        ('{"modules": {"a": 1}}', "modules: 'a' is 1 and must be an object"),
        ('{"modules": {"a": {"mode": "m", "inputs": {}}}}', "modules.a has no 'pe'"),
        ('{"modules": {"a": {"pe": null, "mode": "m", "inputs": {}}}}', "modules.a: 'pe' is null and must be a string"),
        ('{"modules": {"a": {"pe": "p", "mode": "m"}}}', "modules.a has no 'inputs'"),
        (WIRED % '{"producer": "b", "variable": "v"}', "modules.a.inputs[\"0.1\"] has no 'version'"),
        (
            WIRED % '{"producer": "b", "variable": "v", "version": true}',
            "modules.a.inputs[\"0.1\"]: 'version' is true and must be an integer",
        ),
        ('{"modules": {}, "modules": {}}', '"modules" is given twice in one JSON object'),
        ('{"modules": {"a\\nb": {}}}', 'the key "a\\nb" or its value {} has characters that cannot be printed'),
        ('{"modules": {"\\ud800": {}}}', 'the key "\\ud800" or its value {} has characters that cannot be printed'),
    ],
)  # fmt: skip
def test_what_is_malformed_is_named(text: str, sentence: str) -> None:
    with pytest.raises(PlanError) as refused:
        read_configuration(text)
    assert str(refused.value).startswith(sentence)


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (("spec",), "0" * 64, "the plan was made for another spec, or another version of spec elevator_and_chute"),
        (("phase",), "glide", "no phase is named 'glide'"),
        (("phase",), 3, "the plan's 'phase' is 3 and must be a string or null"),
        (("down",), ["pe:tail"], "no PE is named 'tail'; did you mean 'tail_pe'?"),
        (("down",), [1], "the plan's 'down' is [1] and must be a list of strings"),
        (("limits", "bus:can0"), 0.4, "limits: 'bus:can0' is 0.4 and must be a string"),
        (("limits", "bus:can0"), "much", "'bus:can0=much' is not a limit"),
        (("priorities", "elevator"), "7", "priorities: 'elevator' is \"7\" and must be an integer"),
        (("priorities", "elevator"), -7, "'elevator=-7' is not a priority; write FUNCTION=N with N from 0 to 32767"),
        (("optimal",), "yes", "the plan: 'optimal' is \"yes\" and must be true or false"),
        (("objective", "utility"), 9000, "the plan's objective does not fit its configuration"),
        (("modules", "chute_logic", "mode"), "fast", "modules.chute_logic.mode: the module has no mode 'fast'"),
        (("modules", "chute_logic", "pe"), "nose", "modules.chute_logic.pe: the spec has no PE 'nose'"),
        (
            ("modules", "chute_logic", "inputs", "1", "variable"),
            "altitude",
            'modules.chute_logic.inputs["1"]: mode only has no such input, or the input does not accept altitude',
        ),
    ],
)
def test_one_of_our_own_plans_that_was_tampered_with(path: tuple[str, ...], value: object, sentence: str) -> None:
    document = json.loads(chute_plan().to_json())
    inner: dict[str, Any] = document
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    with pytest.raises(PlanError) as refused:
        read_plan(json.dumps(document), FIGURE_3)
    assert str(refused.value).startswith(sentence)


def test_a_situation_of_another_spec_and_a_spec_in_place_of_a_plan_are_told() -> None:
    document = json.loads(chute_plan().to_json()) | {"spec": "0" * 64, "phase": "glide"}
    with pytest.raises(PlanError, match=r"^the plan is of another spec than elevator_and_chute: no phase is named"):
        read_situation(json.dumps(document), FIGURE_3)
    remedy = "if this file is the spec, name it before the plan on the command line"
    with pytest.raises(PlanError, match=rf"this is not JSON .*; {remedy}$"):
        read_configuration("dg: 1\nname: x\n")


def test_a_module_that_the_spec_lacks_is_named() -> None:
    document = json.loads(chute_plan().to_json())
    document["modules"]["ghost"] = {"pe": "tail_pe", "mode": "only", "inputs": {}}
    with pytest.raises(PlanError, match=r"^modules\.ghost: the spec has no module 'ghost'$"):
        read_plan(json.dumps(document), FIGURE_3)


def test_an_illegal_plan_is_read_all_the_same() -> None:
    document = json.loads(chute_plan().to_json())
    del document["modules"]["pressure_driver"]
    document["objective"]["cpu_millis"] -= 20
    del document["levels"]
    assert read_plan(json.dumps(document), FIGURE_3).objective.inputs == 1


def test_limits_keep_their_exact_share() -> None:
    now = situation(FIGURE_3, limits=["bus:can0=33.3330001%", "pe:tail_pe=0%", "pe:sensor_pe=100%"])
    empty = Configuration()
    text = make_plan(FIGURE_3, now, empty, score(FIGURE_3, now, empty, None), optimal=True).to_json()
    assert read_situation(text, FIGURE_3).limits == {
        "bus:can0": Fraction("0.333330001"),
        "pe:tail_pe": 0,
        "pe:sensor_pe": 1,
    }


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@given(st.data())
@settings(max_examples=part_of(200))
def test_whatever_stands_anywhere_in_a_plan_it_is_read_or_refused(data: st.DataObject) -> None:
    document = json.loads(chute_plan().to_json())
    inner, key = document, data.draw(st.sampled_from(sorted(document)))
    while isinstance(inner[key], dict) and inner[key] and data.draw(st.booleans()):
        inner = inner[key]
        key = data.draw(st.sampled_from(sorted(inner)))
    inner[key] = data.draw(json_values)
    with contextlib.suppress(PlanError):
        assert read_plan(json.dumps(document), FIGURE_3).spec == FIGURE_3.digest
