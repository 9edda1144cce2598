"""The oracle of scripts: one is announced only where it may be held, and then only level 1 counts."""

from pathlib import Path

import pytest

from heronry_tools.console.errors import UserError
from heronry_tools.sim.oracles.scripts import ANNOUNCED_WITHIN_NS, ON_ITS_WAY_NS, ScriptCheck
from heronry_tools.sim.scenario.in_simulator import fly
from heronry_tools.sim.scenario.script import read_script
from heronry_wire.management import Control, ElementKind, Operation

HEAD = "# A scenario of a test, which has a reason of its own.\nspec elevator_and_chute\n"
HELD = Control(3, 0, Operation.HOLDS, ElementKind.SCRIPT, 0)


def test_a_script_is_held_where_it_was_ordered_until_it_is_released() -> None:
    check = ScriptCheck()
    assert not check.is_held(0)
    check.script_ordered(0, 3)
    check.commanded(10, "manager", HELD)
    check.commanded(11, "manager", Control(3, 0, Operation.HOLDS, ElementKind.PHASE, 0))
    assert check.is_held(10 + ANNOUNCED_WITHIN_NS - 1)
    assert not check.is_held(10 + ANNOUNCED_WITHIN_NS)
    check.script_ordered(20, None)
    check.commanded(20 + ON_ITS_WAY_NS - 1, "manager", HELD)  # it was queued before the release
    assert not check.is_held(11)
    assert check.violations == []


def test_an_announcement_long_after_the_release_is_a_violation() -> None:
    check = ScriptCheck()
    check.script_ordered(0, 3)
    check.script_ordered(20, None)
    check.commanded(20 + ON_ITS_WAY_NS, "manager", HELD)
    assert len(check.violations) == 1


@pytest.mark.parametrize("term", [None, 2])
def test_an_announcement_without_an_order_in_its_term_is_a_violation(term: int | None) -> None:
    check = ScriptCheck()
    check.script_ordered(0, term)
    check.commanded(10, "manager", HELD)
    assert [one.story for one in check.violations] == ["manager announces a script in term 3, which holds none"]


def test_while_it_is_held_it_may_cost_inputs_but_no_critical_function(tmp_path: Path) -> None:
    """Without `release_command` the parachute is served, and the worth of its inputs is less than the best plan's."""
    (tmp_path / "deaf.pcs.script").write_text(
        "G.DeleteComponent ( release_driver );\nG.PruneEdges ();\n", encoding="utf-8"
    )
    file = tmp_path / "deaf.scenario"
    file.write_text(f"{HEAD}at 1s script deaf.pcs.script\nexpect epoch new within 600ms\nend 3s\n")
    held = fly(read_script(file))
    assert held.holds
    assert "the script is taken: it is legal, and serves as much at level 1 as the best plan" in held.trace


def test_a_script_that_cannot_be_read_is_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "none.scenario"
    file.write_text(f"{HEAD}at 1s script none.pcs.script\nend 3s\n")
    with pytest.raises(UserError, match=r"none.pcs.script: No such file or directory; name a \*.pcs.script file"):
        read_script(file)
    (tmp_path / "none.pcs.script").write_bytes(b"\xff")
    with pytest.raises(UserError, match="it is not text in UTF-8"):
        read_script(file)
