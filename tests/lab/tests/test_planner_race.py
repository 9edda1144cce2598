"""The planner race: aircraft from a seed, a fair race, and a clear message for what cannot be measured."""

import json
import math
from itertools import islice

import pytest

from heronry_dg.gates import And, Expression, Or, Xor
from heronry_dg.model import Spec
from heronry_dg.objective import score
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation, situation
from heronry_dg.verify import verify
from heronry_manager.planner.exact import Planner
from heronry_tools.console.errors import exit_code
from lab.planner_race.__main__ import main
from lab.planner_race.generator import fault_cases, generate
from lab.planner_race.race import FULL, Entry, Race, Size, percentile, work_after
from lab.planner_race.rivals import Highs, answered, cp_sat

WORK = ("up to 1.05", "beyond 1.05")


def gates(needs: Expression | None) -> set[type]:
    if not isinstance(needs, And | Or | Xor):
        return set()
    return {type(needs)}.union(*(gates(one) for one in needs.inputs))


@pytest.mark.parametrize(("modules", "pes"), [(30, 8), (60, 12), (200, 20)])
def test_an_aircraft_has_everything_that_aircraft_have(modules: int, pes: int) -> None:
    spec = generate(1, modules, pes)
    every_mode = [mode for module in spec.modules.values() for mode in module.modes.values()]
    assert (len(spec.modules), len(spec.pes)) == (modules, pes)
    assert set().union(*(gates(mode.needs) for mode in every_mode)) == {And, Or, Xor}
    assert len(spec.buses) == len(spec.phases) == 2
    assert sum(len(pe.buses) > 1 for pe in spec.pes.values()) == 1
    assert spec.demuxes
    assert spec.separate
    assert any(variable.initial is not None for variable in spec.variables.values())


@pytest.mark.parametrize("work", [0.8, 1.05, 1.5])
def test_work_is_the_share_of_the_cpu_that_the_best_modes_take(work: float) -> None:
    def taken(spec: Spec) -> float:
        return sum(next(iter(module.modes.values())).cpu_millis for module in spec.modules.values())

    spec = generate(3, 60, 12, work)
    assert taken(spec) / sum(pe.cpu_millis for pe in spec.pes.values()) == pytest.approx(work, abs=0.01)


def test_the_same_seed_gives_the_same_aircraft_and_faults() -> None:
    spec = generate(4, 30, 8)
    assert spec == generate(4, 30, 8)
    assert spec.digest != generate(5, 30, 8).digest
    cases = fault_cases(spec, 4, 2)
    assert cases == fault_cases(spec, 4, 2)
    assert all(1 <= len(case.now.down) <= 2 and case.running for case in cases)
    assert all(spec.manager.bus not in element for case in cases for element in case.now.down)


def test_planner_cp_sat_and_highs_prove_the_same_of_the_same_problem() -> None:
    with Highs() as highs:
        for seed, work in ((2, 1.05), (3, 1.4)):
            spec = generate(seed, 30, 8, work)
            times, planner = ResponseTimes(spec), Planner(spec)
            for element in ("pe:pe01", "device:loop0_sensor_a_device"):
                now = situation(spec, [element])
                served = planner.serve(now)
                best = served.objective.key()[:5]
                assert served.proven
                for solver in (cp_sat, highs):
                    answer = answered(solver, times, now)
                    assert answer.proven
                    assert score(spec, now, answer.configuration, None).key()[:5] == best
                    assert {one.rule for one in verify(spec, now, answer.configuration)} <= {"5.idle"}


def test_a_race_counts_results_that_contradict_a_proof_and_losses_of_the_greedy_planner() -> None:
    race = Race(Size(30, 8, 1.05))
    race.serving = {
        "greedy": Entry("greedy", [1.0, 1.0], [(1, 0, 0, 0, 50), (1, 0, 0, 0, 100)], [False, False]),
        "planner": Entry("planner", [2.0, 2.0], [(2, 0, 0, 0, 100), (1, 0, 0, 0, 100)], [True, True]),
    }
    assert (race.disagreements(), race.greedy_losses(), race.greedy_utility()) == (0, 1, 0.75)
    race.serving["planner"].served[0] = (1, 0, 0, 0, 40)
    assert race.disagreements() == 1


def test_the_loss_of_a_pe_overloads_an_aircraft() -> None:
    spec = generate(2, 30, 8, work=1.0)
    assert work_after(spec, Situation()) == pytest.approx(1.0, abs=0.01)
    assert work_after(spec, Situation(frozenset({"pe:pe02"}))) > FULL
    assert work_after(spec, Situation(frozenset({f"bus:{spec.manager.bus}"}))) == math.inf


def test_percentiles() -> None:
    assert [percentile(range(1, 101), percent) for percent in (50, 90, 99)] == [50, 90, 99]
    assert percentile([7], 50) == 7


def test_the_command_reports_and_writes_json(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--cases", "2", "--seed", "2", "--effort", "0.01"]
    assert main([*arguments, "--rivals", "none"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "30 x 8, work 1.05: 2 faults; CPU time in ms"
    rows = [line.split("  ")[0] for line in islice(lines, 2, 7)]
    assert rows == ["greedy", "planner", "all levels, by the work there is for the CPU that a fault leaves", *WORK]
    assert main([*arguments, "--rivals", "cp-sat", "--json"]) == 0
    (size,) = json.loads(capsys.readouterr().out)
    assert size["levels_1_and_2"].keys() == {"greedy", "planner", "cp-sat"}
    assert sum(size["all_levels"][work]["cases"] for work in WORK) == 2
    assert size["proofs_that_disagree"] == size["illegal"] == 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--sizes", "30"], "'30' is not a size; write MODULESxPES, 30x6 to 220x34"),
        (["--sizes", "30x40"], "'30x40' is not a size"),
        (["--cases", "0"], "--cases 0: measure at least one case"),
        (["--work", "-1"], "--work -1: write a share of the CPU, above 0"),
        (["--work", "nan"], "--work nan: write a share of the CPU, above 0"),
        (["--effort", "-1"], "--effort -1 is not a limit"),
        (["--rivals", "scip"], "'scip' is not one of cp-sat, highs; for no other solver write none"),
    ],
)
def test_what_cannot_be_measured_is_one_sentence(
    capsys: pytest.CaptureFixture[str], arguments: list[str], sentence: str
) -> None:
    assert exit_code(lambda: main(arguments), "planner race") == 2
    assert sentence in capsys.readouterr().err
