"""`heronry campaign`: the functions that survive, requirements for CI, and a page that needs no other file."""

import io
import json
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, elements
from heronry_manager.planner.exact import plan
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase, Scope
from heronry_tools.analysis.campaign.minimal import minimal
from heronry_tools.analysis.campaign.outlook import outlook
from heronry_tools.analysis.campaign.outlook_picture import falls_below
from heronry_tools.analysis.campaign.report import text_report
from heronry_tools.analysis.campaign.requirements import Offence, offences, read_requirement
from heronry_tools.analysis.campaign.survey import survey
from heronry_tools.analysis.campaign.sweeping import sweep
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Progress

CHUTE = load(shipped_spec_path("elevator_and_chute"))
BIG_BLUE = load(shipped_spec_path("big_blue"))
ALONE = ("--jobs", "1")


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = main(["campaign", *arguments, *ALONE])
    out, err = capsys.readouterr()
    assert err == ""
    return code, out


def test_single_points_of_failure_are_those_that_planning_finds(capsys: pytest.CaptureFixture[str]) -> None:
    code, out = run(capsys, "elevator_and_chute", "--faults", "1", "--json")
    assert code == 0
    (phase,) = json.loads(out)["phases"]
    healthy = plan(CHUTE, Situation())
    running = {name: (one.mode, one.pe) for name, one in healthy.configuration.modules.items()}
    after = {element: plan(CHUTE, Situation(frozenset({element})), running) for element in elements(CHUTE)}
    for name, report in phase["functions"].items():
        culprits = [element for element, found in after.items() if not found.functions[name].served]
        assert report["single_points"] == culprits
        assert report["lost"] == [0, len(culprits)]
    utilities = [found.objective.utility for found in after.values()]
    of_one = phase["by_faults"][1]
    assert of_one["utility"] == {
        "best": max(utilities),
        "mean": sum(utilities) / len(utilities),
        "worst": min(utilities),
    }


def test_a_table_shows_how_it_degrades(capsys: pytest.CaptureFixture[str]) -> None:
    code, out = run(capsys, "elevator_and_chute", "--kinds", "device")
    assert code == 0
    assert "elevator_and_chute: up to 2 faults of 7 elements, 29 fault sets in each phase" in out
    assert re.search(r"^0 +1 +20000 +20000\.0 +20000 +3 +3\.0 +3$", out, re.MULTILINE)
    assert re.search(r"^parachute +B +0 +1 +6 +- +device:chute_solenoid$", out, re.MULTILINE)


def test_a_requirement_that_holds_and_one_that_does_not(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["elevator_and_chute", "--kinds", "device", "--faults", "0"]
    assert run(capsys, *arguments, "--require", "A after 1") == (0, _ends("required: A after 1: holds\n"))
    code, out = run(capsys, *arguments, "--require", "A after 1", "--require", "A after 2", "--require", "C after 2")
    assert code == 1
    assert "required: A after 2: BROKEN by 1 smallest fault sets\n" in out
    assert "  device:elevator_servo_1, device:elevator_servo_2: elevator\n" in out
    assert out.endswith("required: C after 2: holds\n")


class _ends(str):  # noqa: N801, SLOT000 - reads as a matcher
    """Equal to every text that ends so."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, str) and other.endswith(str(self))

    __hash__ = str.__hash__


def test_a_page_stands_by_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "degradation.html"
    required = ["--require", "servo_monitoring after 1", "--require", "A after 1"]
    assert run(capsys, "elevator_and_chute", "--kinds", "device", "-o", str(page), *required)[0] == 1
    text = page.read_text()
    body = ET.fromstring(re.sub("<!DOCTYPE html>|<meta [^>]*>", "", text))
    assert len(body.findall(".//svg")) == 2
    assert "prefers-color-scheme: dark" in text
    assert re.findall(r'(?:href|src)="|url\(|@import', text) == [], "nothing is loaded"
    broken, held = body.findall(".//ul/li/span")
    assert (broken.attrib["class"], held.attrib["class"]) == ("bad", "good")
    polygon = body.find(".//polygon")
    assert polygon is not None
    assert len(polygon.attrib["points"].split()) == 6, "three sizes, best and worst"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--require", "A"], "write WHAT after N"),
        (["--require", "lasers after 1"], "'lasers' is neither a class (A to E) nor a function"),
        (["--require", "A after 1 in glide"], "no phase is named 'glide'; the spec has none"),
        (["--require", "A after 20"], "sets of faults, and at most 10000000 are tried: choose fewer"),
        (["--scheduler", ""], "no Dask scheduler answers at"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_bad_input_is_one_sentence(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["campaign", "elevator_and_chute", *arguments, *ALONE]) == 2
    assert sentence in capsys.readouterr().err


def test_a_phase_that_is_not_looked_at_guarantees_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["campaign", "big_blue", "--phase", "glide", "--require", "A after 1 in landing", *ALONE]
    assert main(arguments) == 2
    assert "phase landing is not examined; add --phase landing" in capsys.readouterr().err


def test_a_requirement_covers_what_its_phase_wants() -> None:
    """On the ascent the elevator is of class C, and guidance is not wanted at all."""
    nothing = Outcome(Configuration(), plan(CHUTE, Situation(frozenset({"bus:can0"}))).objective, optimal=True)
    down = frozenset({"bus:can0"})
    outcomes: Mapping[tuple[Phase, FaultSet], Outcome] = {("ascent", down): nothing, ("glide", down): nothing}
    found = offences(BIG_BLUE, read_requirement(BIG_BLUE, "A after 1"), outcomes)
    assert found == [
        Offence("ascent", down, ("parachute", "balloon_release")),
        Offence("glide", down, ("parachute", "elevator")),
    ]
    assert offences(BIG_BLUE, read_requirement(BIG_BLUE, "guidance after 1 in ascent"), outcomes) == []
    assert offences(BIG_BLUE, read_requirement(BIG_BLUE, "guidance after 0"), outcomes) == []
    with pytest.raises(UserError, match="the spec has ascent"):
        read_requirement(BIG_BLUE, "A after 1 in orbit")


def test_only_the_smallest_sets_are_kept() -> None:
    a, b, ab, bc = (frozenset(letters) for letters in ("a", "b", "ab", "bc"))
    assert minimal([ab, a, bc, a]) == [a, bc]
    assert minimal([ab, b]) == [b]


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_losses_and_utility_are_bounded_whatever_the_order(order: int) -> None:
    """Of three PEs that may fail every set is planned for, and its probability added up."""
    rates = {"control_pe": 0.1, "sensor_pe": 0.1, "tail_pe": 0.05}
    pes = {
        name: replace(CHUTE.pes[name], rate_per_h=Fraction(str(rate)), cpu_millis=190) for name, rate in rates.items()
    }
    spec = replace(CHUTE, pes=pes)
    names = tuple(f"pe:{name}" for name in rates)
    swept = sweep(spec, Scope(names, 3, (None,)), None)

    def exactly_down(hours: float) -> dict[FaultSet, float]:
        chances = {f"pe:{name}": 1 - math.exp(-rate * hours) for name, rate in rates.items()}
        return {
            down: math.prod(chances[name] if name in down else 1 - chances[name] for name in names)
            for _, down in swept.outcomes
        }

    exactly = exactly_down(1.0)
    scope = Scope(names, order, (None,))
    found = outlook(spec, scope, None, swept.outcomes)
    assert found is not None
    for function in spec.functions.values():
        losing = [
            down
            for (_, down), one in swept.outcomes.items()
            if not any(output in one.configuration.modules for output in function.outputs)
        ]
        assert [time for time, _ in found.curves[function.name]] == [number / 20 for number in range(21)]
        for time, loss in found.curves[function.name]:
            at_that_time = exactly_down(time)
            lost = sum(at_that_time[down] for down in losing)
            assert loss.high is not None
            assert loss.low * (1 - 1e-12) <= lost <= loss.high * (1 + 1e-12)
            assert loss.exact or order < 3
        assert found.losses[function.name] == found.curves[function.name][-1][1]
    expected = sum(exactly[down] * one.objective.utility for (_, down), one in swept.outcomes.items())
    assert found.expected[0] * (1 - 1e-12) <= expected <= found.expected[1] * (1 + 1e-12)
    assert math.fsum([*(chance for _, chance in found.utilities), found.beyond]) == pytest.approx(1.0, abs=1e-12)
    below = falls_below(found)
    assert below[0][1] == found.beyond
    assert [chance for _, chance in below] == sorted(chance for _, chance in below)


def test_without_rates_there_is_no_outlook() -> None:
    scope = Scope(elements(CHUTE), 0, (None,))
    outcomes = sweep(CHUTE, scope, None).outcomes
    assert outlook(CHUTE, scope, None, outcomes) is None


def test_the_page_has_the_outlook(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.html"
    kinds = ("--kinds", "pe", "--faults", "1", "--phase", "glide")
    assert run(capsys, "big_blue", *kinds, "-o", str(page)) == (0, "")
    html = page.read_text()
    assert "Probability that the utility falls below a level within 1 h" in html
    assert "expected utility" in html
    body = ET.fromstring(re.sub("<!DOCTYPE html>|<meta [^>]*>", "", html))
    (curves,) = [one for one in body.findall(".//svg") if one.attrib["aria-label"].startswith("R(t)")]
    named = {text.text for text in curves.findall("text")}
    assert {"elevator", "parachute", "flight_log"} <= named
    assert len(curves.findall("polyline")) == len(curves.findall("polygon")) >= 3
    _, out = run(capsys, "big_blue", *kinds, "--json")
    (phase,) = json.loads(out)["phases"]
    log = phase["functions"]["flight_log"]
    assert log["loss_per_h"] <= 0.0002 <= log["loss_at_most_per_h"]
    assert log["loss_is_complete"]
    assert phase["outlook"]["expected_utility"]["at_least"] < 58000
    curve = log["reliability"]
    assert (curve[0]["hours"], curve[0]["at_least"], curve[0]["at_most"], curve[-1]["hours"]) == (0.0, 1.0, 1.0, 1.0)
    assert curve[-1]["at_least"] == 1.0 - log["loss"]["at_most"]
    for key in ("at_least", "at_most"):
        assert [one[key] for one in curve] == sorted((one[key] for one in curve), reverse=True)
    assert log["mean_time_to_loss_at_most_h"] > 1000.0
    assert phase["outlook"]["elements_without_rate"] == 0


def test_plans_made_ahead_give_the_same_campaign(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "chute.contingencies"
    kinds = ("--kinds", "pe,module", "--faults", "1")
    assert main(["contingencies", "elevator_and_chute", "-o", str(file), *kinds, *ALONE]) == 0
    assert "places in use" in capsys.readouterr().out
    planned = run(capsys, "elevator_and_chute", *kinds, "--json")
    assert run(capsys, "elevator_and_chute", "--contingencies", str(file), "--json") == planned
    code, out = run(capsys, "elevator_and_chute", "--contingencies", str(file), "--require", "parachute after 1")
    assert code == 1
    assert "required: parachute after 1: BROKEN" in out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--faults", "2"), "--faults: with --contingencies the file says what is examined; leave --faults out"),
        (("--kinds", "pe"), "leave --kinds out"),
        (("--require", "A after 2"), "has plans for up to 1 faults; make it anew"),
        (("--require", "A after 1 in landing"), "has no plans for phase landing; make it anew"),
    ],
)
def test_what_a_contingency_file_cannot_answer_is_one_sentence(
    arguments: tuple[str, str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "blue.contingencies"
    scope = ("--kinds", "bus", "--faults", "1", "--phase", "glide")
    assert main(["contingencies", "big_blue", "-o", str(file), *scope, *ALONE]) == 0
    capsys.readouterr()
    assert main(["campaign", "big_blue", "--contingencies", str(file), *arguments]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert sentence in err


def test_a_contingency_file_of_another_spec_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "x.contingencies"
    assert main(["campaign", "big_blue", "--contingencies", str(file)]) == 2
    assert main(["contingencies", "elevator_and_chute", "-o", str(file), "--faults", "0", *ALONE]) == 0
    assert main(["campaign", "big_blue", "--contingencies", str(file)]) == 2
    missing, other = capsys.readouterr().err.splitlines()
    assert "No such file" in missing
    assert "made for another spec" in other


def test_a_long_list_is_cut_short_and_missing_proofs_are_reported() -> None:
    scope = Scope(elements(CHUTE), 1, (None,))
    healthy = Outcome(plan(CHUTE, Situation()).configuration, plan(CHUTE, Situation()).objective, optimal=False)
    nothing = Outcome(Configuration(), plan(CHUTE, Situation(frozenset({"bus:can0"}))).objective, optimal=True)
    outcomes: dict[tuple[Phase, FaultSet], Outcome] = {
        (None, down): nothing if down else healthy for down in scope.fault_sets()
    }
    required = read_requirement(CHUTE, "A after 1")
    text = text_report(CHUTE, scope, survey(CHUTE, scope, outcomes), [(required, offences(CHUTE, required, outcomes))])
    assert "1 plans are legal, but not proven to be the best" in text
    assert text.endswith("  and 4 more (--json lists all)\n")


def test_progress_is_one_line_that_is_written_over(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with Progress() as progress:
        progress.begin("plans", 2)
        progress.step()
    shown = terminal.getvalue()
    assert shown.startswith("\r\x1b[Kplans: 0 of 2")
    assert shown.endswith("\r\x1b[K"), "nothing is left of it"
    assert "\n" not in shown
