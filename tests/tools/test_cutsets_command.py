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
from heronry_tools.analysis.campaign.crew import crew
from heronry_tools.analysis.campaign.given_up import given_up
from heronry_tools.analysis.campaign.sweeping import partial_of, sweep
from heronry_tools.analysis.reliability import cut_sets as cut_sets_module
from heronry_tools.analysis.reliability import truncating
from heronry_tools.analysis.reliability.cut_sets import CutSets, cut_sets
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.formula import TooLargeError
from heronry_tools.analysis.reliability.mission import Reliability
from heronry_tools.analysis.reliability.resource_sets import Servable
from heronry_tools.analysis.servable import Answer, Planning, without_deadlines
from heronry_tools.cli import main
from heronry_tools.commands import cutsets as cutsets_command
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
    left_out = given_up(monitoring, cuts.resources, None, outcomes)
    assert left_out == [frozenset({"pe:sensor_pe"})]
    assert not any(cut <= down for cut in cuts.resources for down in left_out)


def test_the_lists_are_shown(capsys: pytest.CaptureFixture[str]) -> None:
    out = run(capsys, "elevator_and_chute", "parachute", "--kinds", "pe,device", "--given-up", "--jobs", "1")
    assert out == (
        "parachute of elevator_and_chute: sets of up to 2 faults\n\n"
        "logical: 2 sets in all (2 of 1)\n  pe:control_pe\n  device:chute_solenoid\n\n"
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
    ("resources", "says"),
    [
        (["bus:can0"], "resource-aware: the same sets\n"),
        (["pe:nav"], "resource-aware: 1 more set\n  pe:nav\nlost with real resources within 1 h: at least 0.0002"),
        ([""], "resource-aware: with nothing down at all\n  nothing down\n"),
    ],
)
def test_a_set_that_is_logical_is_listed_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, resources: list[str], says: str
) -> None:
    found = tuple(frozenset(filter(None, [one])) for one in resources)

    def search(_: Spec, function: str, scope: Scope, logic: Reliability, **__: object) -> CutSets:
        return CutSets(function, scope.faults, logic, found)

    monkeypatch.setattr(cutsets_command, "cut_sets", search)
    out = run(capsys, "big_blue", "elevator", "--order", "1")
    assert out.count("  bus:can0\n") == 1
    assert says in out


def test_every_order_is_counted_and_some_sets_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    document = json.loads(run(capsys, "big_blue", "telemetry", "--logical", "--list", "9", "--json"))
    logical = document["logical"]
    assert logical["count"] == sum(logical["by_order"].values()) == 22695
    assert logical["by_order"]["10"] == 8192
    assert list(map(len, logical["sets"])) == [1] * 7 + [6] * 2
    assert "resources" not in document
    likeliest = run(capsys, "big_blue", "telemetry", "--logical", "--by", "likelihood", "--list", "2")
    assert "  3.93e-01  bus:radio\n  1.00e-03  pe:ground\n  ... 22693 more" in likeliest


def test_probabilities_say_what_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    """Either of two parts of one chain loses the function: 0.3 of 1000 hours each is no matter of first order."""
    out = run(capsys, "big_blue", "flight_log", "--kinds", "pe", "--order", "1", "--mission", "1000", "--jobs", "1")
    assert "lost by logic within 1000 h: 0.1813 (exact)\n" in out
    assert "(lower) to" in out
    assert "(upper), to order 1" in out
    assert "mean time to loss: 4137 h (exact; without repair)\n" in out
    title, *rows, axis, _ = out[out.index("R(t) by logic") :].split("most important")[0].splitlines()
    assert title == "R(t) by logic (exact):"
    assert [row.partition("|")[0].strip() for row in rows] == ["1", "0.955", "0.909", "0.864", "0.819"]
    assert (rows[0].partition("|")[2][0], rows[-1][-1], set(axis.strip())) == ("*", "*", {"+", "-"})


def test_a_place_may_fail(capsys: pytest.CaptureFixture[str]) -> None:
    document = json.loads(run(capsys, "elevator_and_chute", "parachute", "--kinds", "place", "--logical", "--json"))
    assert document["logical"]["by_order"] == {"3": 1}
    assert all(place.startswith("module:chute_logic@") for place in document["logical"]["sets"][0])


def test_a_search_that_was_stopped_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "cuts.json"
    command = ["cutsets", "big_blue", "elevator", "--order", "2", "--jobs", "1", "-o", str(file)]
    monkeypatch.setattr("heronry_tools.analysis.reliability.resource_sets._SETS_IN_A_PART", 64)
    asked: list[frozenset[str]] = []
    after = Servable.after

    def stopping(self: Servable, down: frozenset[str]) -> bool:
        asked.append(down)
        if len(asked) == 250:
            raise KeyboardInterrupt
        return after(self, down)

    monkeypatch.setattr(Servable, "after", stopping)
    assert main(command) == 130
    assert "the same command continues from" in capsys.readouterr().err
    with partial_of(file).open("ab") as journal:
        journal.write(b"half a li")
    first = len(asked)
    assert main(command) == 0
    again = len(asked) - first
    assert "continuing" in capsys.readouterr().err
    assert not partial_of(file).exists()
    whole = json.loads(run(capsys, *command[1:-2], "--json"))
    assert json.loads(file.read_text()) == whole
    searched = len(asked) - first - again
    assert first + again <= searched + 64, "only what was begun is done again"


def test_the_journal_of_another_search_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cuts.json"
    partial_of(file).write_text("something else")
    assert main(["cutsets", "big_blue", "elevator", "-o", str(file)]) == 2
    assert "is the journal of another search, or damaged" in capsys.readouterr().err
    assert partial_of(file).read_text() == "something else"


def test_processes_find_the_same(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heronry_tools.analysis.reliability.resource_sets._PROCESS_PAYS", 0.1)
    monkeypatch.setattr("heronry_tools.analysis.reliability.resource_sets._SETS_IN_A_PART", 100)
    alone, together = (run(capsys, "big_blue", "rudder", "--order", "2", "--jobs", jobs) for jobs in "12")
    assert alone == together


def test_a_formula_that_is_too_large_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def outgrown(*_: object) -> None:
        raise TooLargeError

    monkeypatch.setattr(cut_sets_module, "Reliability", outgrown)
    assert main(["cutsets", "big_blue", "elevator"]) == 2
    assert "the failure of elevator is too large to be written down" in capsys.readouterr().err


def test_a_diagram_that_is_too_large_is_truncated_and_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ("big_blue", "telemetry", "--logical", "--mission", "10")
    exact = json.loads(run(capsys, *command, "--json"))["logical"]
    assert exact["complete_to_order"] is None
    monkeypatch.setattr(Solution.__init__, "__defaults__", (4, None, 8.0))
    monkeypatch.setattr(truncating, "_SET_NODES", 12)
    monkeypatch.setattr(truncating, "_KEPT", (4, 1))
    text, cut = run(capsys, *command), json.loads(run(capsys, *command, "--json"))["logical"]
    order = cut["complete_to_order"]
    assert f"to order {order}; larger ones are not known" in text
    assert "too large, or took too long (more than 400000 nodes, or 8 s of CPU): numbers below are bounds" in text
    assert cut["by_order"] == {its: number for its, number in exact["by_order"].items() if int(its) <= order}
    low, high = cut["probability"]["at_least"], cut["probability"]["at_most"]
    assert low <= exact["probability"]["at_least"]
    assert high is None or high >= exact["probability"]["at_least"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["elevator_and_chute", "elevater"], "no function is named 'elevater'; did you mean 'elevator'?"),
        (["elevator_and_chute", "xyz"], "the spec has elevator, parachute, servo_monitoring"),
        (["elevator_and_chute", "elevator", "--order", "0"], "a set has at least one fault"),
        (["elevator_and_chute", "elevator", "--order", "24"], "there are 16777216 sets of faults"),
        (["elevator_and_chute", "elevator", "--jobs", "0"], "at least one process must plan"),
        (["elevator_and_chute", "elevator", "--mission", "0"], "write the hours of the mission, a number above 0"),
        (["elevator_and_chute", "elevator", "--list", "-1"], "write how many logical sets to list, 0 or more"),
        (
            ["elevator_and_chute", "elevator", "--kinds", "wing"],
            "the kinds are pe, device, module, bus, channel, place",
        ),
        (["elevator_and_chute", "elevator", "--logical", "--given-up"], "leave one of them out"),
    ],
)
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cutsets", *arguments]) == 2
    assert sentence in capsys.readouterr().err


def test_enumeration_finds_cut_sets_that_are_wrong(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong(spec: Spec, function: str, scope: Scope) -> CutSets:
        nothing = cut_sets(spec, function, Scope((), 1, scope.phases))
        return CutSets(function, 1, nothing.logic, ())

    monkeypatch.setattr("lab.cut_set_enumeration.cut_sets", wrong)
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
