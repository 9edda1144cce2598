"""`heronry cutsets`: the smallest sets that lose a function, against enumeration of every set."""

import json
import random
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from heronry_dg.loader import load
from heronry_dg.model import Function, Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, elements
from heronry_manager.planner.sweep import Scope
from heronry_tools.analysis.campaign import cut_sets as cut_sets_module
from heronry_tools.analysis.campaign.crew import crew
from heronry_tools.analysis.campaign.cut_sets import CutSets, cut_sets, given_up
from heronry_tools.analysis.campaign.sweeping import sweep
from heronry_tools.analysis.check.servable import Answer, Planning, without_deadlines
from heronry_tools.cli import main
from lab.cut_set_enumeration import main as compare_with_enumeration
from lab.cut_set_enumeration import shipped
from planner.comparison import crossing_case
from planner.enumerator import Enumerator, TooManyError
from planner.random_specs import random_spec
from thoroughness import mostly_soak, part_of

CHUTE = load(shipped_spec_path("elevator_and_chute"))


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    code = main(["cutsets", *arguments])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    return out


ENUMERABLE = [name for name in shipped() if name != "big_blue"]
ALWAYS = [name for name in ENUMERABLE if Path(name).stem in ("elevator_and_chute", "n_version.dg", "radio_link.dg")]


@pytest.mark.parametrize("spec", mostly_soak(ENUMERABLE, ALWAYS))
def test_cut_sets_of_shipped_specs_agree_with_enumeration(spec: str, capsys: pytest.CaptureFixture[str]) -> None:
    order = "2" if "examples" in spec else "1"
    assert compare_with_enumeration([spec, "--order", order, "--jobs", "1"]) == 0
    assert "no disagreements" in capsys.readouterr().out


@settings(max_examples=part_of(15))
@given(st.randoms(use_true_random=False), st.booleans())
def test_cut_sets_of_random_specs_agree_with_brute_force(rng: random.Random, crossing: bool) -> None:
    """Brute force allocates identifiers by what is wanted, which is less here: so nothing is due."""
    drawn = crossing_case(rng, modules=4).spec if crossing else random_spec(rng, modules=4)
    spec = without_deadlines(drawn)
    function = next(iter(spec.functions.values()))
    scope = Scope(tuple(one for one in elements(spec) if not one.startswith("module:")), 2, (None,))
    found = cut_sets(spec, function.name, scope)
    for down in scope.fault_sets():
        assert served_by_brute_force(spec, function, down) != any(cut <= down for cut in found.resources), down
    assert all(any(cut <= logical for cut in found.resources) for logical in found.logical)


def served_by_brute_force(spec: Spec, function: Function, down: frozenset[str]) -> bool:
    alone = replace(spec, functions={function.name: replace(function, priority={None: 1}, value=None)})
    enumerator = Enumerator(alone, Situation(down))
    try:
        _, found = enumerator.best(most=20_000)
    except TooManyError:
        assume(False)
        raise
    return any(output in found.modules for output in function.outputs)


def test_logic_and_resources_are_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    """Of two PEs that may run the controller one is too small beside what it must run."""
    document = json.loads(run(capsys, "elevator_and_chute", "elevator", "--order", "2", "--json"))
    assert document["logical"]["sets"] == document["resources"]["sets"], "Figure 3 has room"
    tight = replace(CHUTE, pes={name: replace(pe, cpu_millis=190) for name, pe in CHUTE.pes.items()})
    scope = Scope(elements(CHUTE), 2, (None,))
    whole, small = (cut_sets(spec, "elevator", scope) for spec in (CHUTE, tight))
    assert whole.logical == small.logical
    assert set(small.logical) < set(small.resources)
    assert frozenset({"pe:sensor_pe", "pe:control_pe"}) in small.resources


def test_what_is_given_up_is_not_lost() -> None:
    """With a PE less the servo's monitor has to go, so that what matters more can stay; alone it would fit."""
    tight = replace(CHUTE, pes={name: replace(pe, cpu_millis=150) for name, pe in CHUTE.pes.items()})
    scope = Scope(tuple(f"pe:{pe}" for pe in CHUTE.pes), 1, (None,))
    monitoring = CHUTE.functions["servo_monitoring"]
    cuts = cut_sets(tight, monitoring.name, scope)
    with crew(1) as nobody:
        outcomes = sweep(tight, scope, nobody).outcomes
    left_out = given_up(monitoring, cuts, None, outcomes)
    assert left_out == [frozenset({"pe:sensor_pe"})]
    assert not any(cut <= down for cut in cuts.resources for down in left_out)


def test_the_lists_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, "elevator_and_chute", "parachute", "--kinds", "pe,device", "--given-up", "--jobs", "1")
    assert out == (
        "parachute of elevator_and_chute: sets of up to 2 faults\n\n"
        "logical: 2 sets\n  pe:control_pe\n  device:chute_solenoid\n\n"
        "resource-aware: the same sets\n\n"
        "given up by the best plan: no sets\n"
    )
    document = json.loads(
        run(
            capsys,
            "big_blue",
            "flight_log",
            "--order",
            "1",
            "--kinds",
            "pe",
            "--given-up",
            "--phase",
            "glide",
            "--jobs",
            "1",
            "--json",
        )
    )
    resources = document["resources"]
    assert (resources["sets"], resources["complete"]) == ([["pe:payload"]], True)
    assert resources["per_h"] <= 0.0002 <= resources["at_most_per_h"] <= 0.00021
    unknown = {"sets": [], "per_h": None, "at_most_per_h": None, "complete": None}
    assert document["given_up"] == {"phase": "glide", **unknown}


@pytest.mark.parametrize(
    ("logical", "resources", "says"),
    [
        (["pe:nav"], ["pe:payload"], "1 more set, with the logical ones at least 2.0e-04 per hour\n  pe:payload\n"),
        (["bus:can0"], ["bus:can0", "module:elevator_control"], "1 more set\n  module:elevator_control\n"),
        ([], ["pe:nav", "pe:payload"], "2 sets, at least 4.0e-04 per hour\n  pe:nav\n  pe:payload\n"),
        (["pe:nav"], [""], "with nothing down at all\n  nothing down\n"),
        ([], [], "no sets\n"),
    ],
)
def test_a_set_that_is_logical_is_listed_once(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    logical: list[str],
    resources: list[str],
    says: str,
) -> None:
    cuts = [tuple(frozenset(filter(None, [one])) for one in ones) for ones in (logical, resources)]
    monkeypatch.setattr(cut_sets_module, "cut_sets", lambda *_: CutSets("elevator", 1, *cuts))
    assert run(capsys, "big_blue", "elevator").endswith(f"resource-aware: {says}")


def test_a_function_that_is_lost_anyway_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    nothing = (frozenset[str](),)
    monkeypatch.setattr(cut_sets_module, "cut_sets", lambda *_: CutSets("elevator", 1, nothing, nothing))
    assert "logical: with nothing down at all\n  nothing down\n" in run(capsys, "elevator_and_chute", "elevator")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["elevator_and_chute", "elevater"], "no function is named 'elevater'; did you mean 'elevator'?"),
        (["elevator_and_chute", "xyz"], "the spec has elevator, parachute, servo_monitoring"),
        (["elevator_and_chute", "elevator", "--order", "0"], "a set has at least one fault"),
        (["elevator_and_chute", "elevator", "--order", "24"], "there are 16777216 sets of faults"),
        (["elevator_and_chute", "elevator", "--jobs", "0"], "at least one process must plan"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cutsets", *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_enumeration_finds_cut_sets_that_are_wrong(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lab.cut_set_enumeration.cut_sets", lambda _, function, *__: CutSets(function, 1, (), ()))
    assert compare_with_enumeration(["elevator_and_chute", "--order", "1", "--jobs", "2"]) == 1
    out = capsys.readouterr().out
    assert "elevator_and_chute: elevator, logical: it is lost with pe:tail_pe\n" in out


def test_what_cannot_be_found_out_says_so(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Planning, "all_at_once", lambda *_: Answer(None, proven=False))
    assert main(["cutsets", "elevator_and_chute", "elevator"]) == 2
    sentence = (
        "the search reached its limit before it was known whether function elevator can be served with nothing down"
    )
    assert sentence in capsys.readouterr().err
