"""The mutation tool: its defects, and its trials, on code of a few lines."""

import ast
import mmap
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path, PurePath

import pytest

from heronry_tools.console.errors import UserError
from lab.mutation.__main__ import draw, main
from lab.mutation.flight_code import CODEC, SHELL, WIRE, codec_files, core_files
from lab.mutation.flights import Flight
from lab.mutation.mutants import Mutant, compiles, mutants_of
from lab.mutation.trial import forked

ROOT = Path(__file__).parents[3]
SOURCE = b'''"""Nothing here counts."""

def may(age: int = 0) -> bool:
    """Nor here."""
    require(age >= 0, "nor here")
    if not age < 5 and True:
        raise ValueError("too old")
    turn.emit("nor what an event says", age=age + 1)
    return age + 1 == 3
'''
SHORT = Flight("conformance", Path("pe_stepping.it_takes_one_step_after_the_other"))
TRY = """
import pickle, sys
from pathlib import Path
from lab.mutation.flights import Flight
from lab.mutation.survivors import reason
from lab.mutation.trial import Trials

short = Flight("conformance", Path("pe_stepping.it_takes_one_step_after_the_other"))
trials = Trials(Path.cwd(), [short], 1)
print(*(baseline.landed.wrong for baseline in trials.baselines()))
verdicts = list(trials.verdicts(pickle.loads(bytes.fromhex(sys.argv[1]))))
for verdict in sorted(verdicts, key=lambda verdict: not verdict.killed_by):
    print(f"{verdict.mutant}: {verdict.killed_by or reason(verdict)}")
"""
OUTSIDE = {"asyncio", "can", "os", "pathlib", "random", "select", "signal", "socket", "subprocess", "threading", "time"}


def test_every_small_defect_is_found_once_and_texts_are_left_alone() -> None:
    found = [mutant.describe(SOURCE).removeprefix("x.py:") for mutant in mutants_of(PurePath("x.py"), SOURCE)]
    assert found == [
        "3: constant: 0 -> 1",
        "6: comparison: not age < 5 -> age < 5",
        "6: statement: not age < 5 and True -> (not (not age < 5 and True))",
        "6: comparison: < -> <=",
        "6: constant: 5 -> 6",
        "6: comparison: and -> or",
        "6: constant: True -> False",
        '8: deletion: turn.emit("nor what an event says", age=age + 1) -> pass',
        "9: deletion: return age + 1 == 3 -> pass",
        "9: statement: return age + 1 == 3 -> return None",
        "9: statement: + -> -",
        "9: constant: 1 -> 2",
        "9: comparison: == -> !=",
        "9: constant: 3 -> 4",
    ]


def test_what_would_change_nothing_is_left_alone() -> None:
    source = b"""def may(age) -> bool:
    if age > 5:
        return False
    return False

def who(age) -> int | None:
    if age > 5:
        return 0
    else:
        return None
"""
    found = [mutant.describe(source).removeprefix("x.py:") for mutant in mutants_of(PurePath("x.py"), source)]
    returns = [one for one in found if "return" in one]
    assert returns == [
        "3: deletion: return False -> pass",
        "8: deletion: return 0 -> pass",
        "8: statement: return 0 -> return None",
    ]


def test_a_mutant_knows_which_lines_run_it() -> None:
    default, *_, last = mutants_of(PurePath("x.py"), SOURCE)
    assert default.is_run_by(frozenset())  # the import of the file runs it
    assert last.function == "may"
    assert last.is_run_by({9})
    assert not last.is_run_by({6, 8})


def test_the_same_seed_draws_the_same_from_the_cores() -> None:
    drawn = draw(ROOT, 7, 50)
    assert drawn == draw(ROOT, 7, 50) != draw(ROOT, 8, 50)
    assert {mutant.kind for mutant in drawn} == {"comparison", "constant", "deletion", "statement"}
    assert all(compiles(mutant, (ROOT / mutant.file).read_bytes()) for mutant in drawn)


@pytest.mark.parametrize("option", ["--count", "--jobs"])
def test_a_number_that_would_measure_nothing_is_refused(option: str) -> None:
    with pytest.raises(UserError, match=f"{option} 0 measures nothing; write 1 or more"):
        main(["--seed", "1", option, "0"])


def test_unknown_killers_are_refused() -> None:
    with pytest.raises(UserError, match="--killers flights: name some of conformance, scenario, sim"):
        main(["--seed", "1", "--killers", "flights"])


def test_every_module_of_the_wire_is_codec_or_shell_and_cores_and_codec_import_no_shell() -> None:
    assert sorted(f"{CODEC} {SHELL}".split()) == sorted(file.stem for file in (ROOT / WIRE).glob("*.py"))
    for file in chain(core_files(ROOT), codec_files()):
        assert not OUTSIDE & set(imported(ROOT / file)), file


def mutant_of(file: str, function: str) -> Mutant:
    every = mutants_of(PurePath(file), (ROOT / file).read_bytes())
    return next(mutant for mutant in every if mutant.function == function)


def test_a_mutant_that_a_flight_notices_is_killed_and_one_that_no_flight_runs_survives() -> None:
    silenced = mutant_of("pe_agent/heronry_agent/core/reports/reporting.py", "Reporting._page_0")
    unrun = mutant_of("manager/heronry_manager/core/intake/operator_orders.py", "OperatorOrders._unlock")
    # As for a user, in a process that has imported the flight code alone before it forks.
    told = subprocess.run(
        [sys.executable, "-c", TRY, pickle.dumps([silenced, unrun]).hex()],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.stdout.splitlines() == ["None", f"{silenced}: {SHORT}", f"{unrun}: no flight runs it"], told.stderr


def test_a_process_with_much_reserved_memory_has_as_much_to_fly_with() -> None:
    """The threads of a solver reserve address space, and the fork inherits it."""
    with mmap.mmap(-1, 6 << 30, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=mmap.PROT_READ):
        ((_, report),) = forked(["one"], 1, lambda _task, tell: tell(len(bytearray(100 << 20))))
    assert (report.told, report.failed) == ([100 << 20], False)


def test_the_kernel_ends_a_process_that_hangs_and_one_that_dies_is_reported_as_such() -> None:
    def spin(_task: str, tell: Callable[[object], None]) -> None:
        tell("flying")
        signal.setitimer(signal.ITIMER_PROF, 0.05)
        while True:
            pass

    ((_, hung),) = forked(["one"], 1, spin)
    assert (hung.told, hung.signal) == (["flying"], signal.SIGPROF)
    ((_, dead),) = forked(["one"], 1, lambda _task, _tell: os._exit(3))
    assert (dead.told, dead.signal, dead.failed) == ([], 0, True)
    ((_, well),) = forked(["one"], 1, lambda _task, tell: tell("landed"))
    assert (well.told, well.failed) == (["landed"], False)


def imported(file: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module.partition(".")[0]
