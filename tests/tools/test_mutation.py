"""The tool that asks whether the tests would notice, tried on a program of four lines."""

import subprocess
from pathlib import Path, PurePath

import pytest

from heronry_tools.mutation.__main__ import all_mutants, draw
from heronry_tools.mutation.mutants import mutants_of
from heronry_tools.mutation.trial import Tree

ROOT = Path(__file__).parents[2]
SOURCE = b'''"""Nothing here counts."""

def may(age: int = 0) -> bool:
    """Nor here."""
    if not age < 5 and True:
        raise ValueError("too old")
    return age + 1 == 3
'''


def test_every_small_defect_is_found_once_and_texts_are_left_alone() -> None:
    found = [mutant.describe(SOURCE).removeprefix("x.py:") for mutant in mutants_of(PurePath("x.py"), SOURCE)]
    assert found == [
        "3: constant: 0 -> 1",
        "5: comparison: not age < 5 -> age < 5",
        "5: statement: not age < 5 and True -> (not (not age < 5 and True))",
        "5: comparison: < -> <=",
        "5: constant: 5 -> 6",
        "5: comparison: and -> or",
        "5: constant: True -> False",
        "7: deletion: return age + 1 == 3 -> pass",
        "7: statement: return age + 1 == 3 -> return None",
        "7: statement: + -> -",
        "7: constant: 1 -> 2",
        "7: comparison: == -> !=",
        "7: constant: 3 -> 4",
    ]


def test_the_same_seed_draws_the_same_from_the_cores() -> None:
    mutants = all_mutants(ROOT)
    assert draw(mutants, 7, 50) == draw(mutants, 7, 50) != draw(mutants, 8, 50)
    assert {mutant.kind for mutant in mutants} == {"comparison", "constant", "deletion", "statement"}


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    """A checkout with one module, and one test that looks at one of its values."""
    checkout = tmp_path / "checkout"
    (checkout / "manager").mkdir(parents=True)
    (checkout / "manager" / "may.py").write_bytes(SOURCE)
    (checkout / "test_may.py").write_text("from may import may\n\ndef test_two():\n    assert may(2)\n")
    (checkout / "pytest.ini").write_text("[pytest]\n")
    subprocess.run(["git", "init", "-q", checkout], check=True)
    subprocess.run(["git", "-C", checkout, "add", "."], check=True)
    return Tree(checkout, tmp_path / "copy")


def test_what_a_test_notices_is_killed_and_what_none_looks_at_survives(tree: Tree) -> None:
    assert tree.fails([("test_may.py",)], 60.0) is None
    by_name = {m.describe(SOURCE): m for m in mutants_of(PurePath("manager/may.py"), SOURCE)}
    killed = by_name["manager/may.py:7: constant: 3 -> 4"]
    survivor = by_name["manager/may.py:5: constant: 5 -> 6"]
    assert tree.judge(killed, [("test_may.py",)], 60.0).killed_by == "test_may.py::test_two"
    assert tree.judge(survivor, [("test_may.py",)], 60.0).killed_by is None
    assert tree.fails([("test_may.py",)], 60.0) is None
