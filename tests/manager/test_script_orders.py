"""From the text of a script to the target that the core takes, and from there to what the caller is told."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from heronry_manager.core.vocabulary import AskStatus, FlyTarget, OperatorSaid
from heronry_manager.shell.control_protocol import Answer, FlyScript, Spoken
from heronry_manager.shell.script_orders import ScriptSaid, target_of
from heronry_tools.console.errors import UserError
from heronry_tools.reports.status import _script
from heronry_tools.runtime import live_script
from manager.one_manager import OneManager, two_tails
from manager.test_held_script import target

FLIES = {"spec": "two_tails", "spec_digest": two_tails().digest}
STATES = ("none", "asked", "held", "refused", "ended")
MOVED = """\
define control; define drive_right;
G.DeleteComponent ( control );
G.DeleteComponent ( drive_left );
G.PruneEdges ();
control = G.CreateComponent ( "state_estimator@middle" );
drive_right = G.CreateComponent ( "servo_driver_1" );
G.CreateEdge ( "control.demand", "drive_right.demand" );
"""


@pytest.fixture
def manager() -> OneManager:
    one = OneManager()
    one.start()
    return one


def test_a_script_becomes_the_target_of_an_order(manager: OneManager) -> None:
    said = ScriptSaid(7, FlyScript(MOVED)).target(manager.spec, manager.core)
    assert said == OperatorSaid(7, FlyTarget(target()))


def test_its_first_error_is_its_problem(manager: OneManager) -> None:
    problem = target_of("G.DeleteComponent ( wing );\n", manager.spec, manager.core).problem
    assert problem.startswith("line 1: PCS201: ")
    two = target_of("G.DeleteComponent ( wing );\nG.Fly ();\n", manager.spec, manager.core)
    assert (two.target, two.problem.endswith(", and 1 more")) == (None, True)


def test_an_edge_that_is_no_wire_is_its_problem(manager: OneManager) -> None:
    text = 'G.CreateEdge ( "drive_left.demand:", "control.demand" );\n'
    problem = target_of(text, manager.spec, manager.core).problem
    assert problem == (
        "drive_left.demand: -> control.demand does not lead from an output of a module "
        "to an unwired input for the same variable"
    )


def test_before_an_epoch_runs_there_is_nothing_to_change() -> None:
    manager = OneManager()
    assert target_of(MOVED, manager.spec, manager.core) == FlyTarget(None, "no epoch of this manager runs yet")


class Manager:
    """Answers a script, and then gives one status after the other."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, done: bool, *statuses: dict[str, Any]) -> None:
        self._done, self._statuses = done, iter([status("none"), *statuses])
        monkeypatch.setattr(live_script, "call", self._call)
        monkeypatch.setattr(live_script, "time", self)
        self._seconds: Iterator[int] = iter(range(0, 1000, 5))

    def _call(self, _: Path, order: Spoken) -> Answer:
        if isinstance(order, AskStatus):
            return Answer(True, "", next(self._statuses))
        return Answer(self._done, "understood" if self._done else "a reconfiguration is under way")

    def monotonic(self) -> int:
        return next(self._seconds)

    def sleep(self, _: float) -> None:
        """Time passes with each look at the clock."""


def status(state: str, why: str | None = None, *, stage: str = "done", coming: int | None = None) -> dict[str, Any]:
    return {"script": {"state": state, "why": why}, "stage": stage, "next": coming, "epoch": 4} | FLIES


def fly() -> Answer:
    return live_script.fly(Path("x"), MOVED, two_tails())


def test_it_is_followed_until_it_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    Manager(monkeypatch, True, status("asked"), status("held", coming=4), status("held"))
    sentence = "the script runs in epoch 4, and is held until 'heronry pcs release'"
    assert fly() == Answer(done=True, sentence=sentence)


def test_a_manager_of_another_spec_gets_none(monkeypatch: pytest.MonkeyPatch) -> None:
    Manager(monkeypatch, True, status("none"))
    edited = replace(two_tails(), digest="0" * 64)
    with pytest.raises(UserError, match="flies another version of two_tails: name that version as SPEC, or restart"):
        live_script.fly(Path("x"), MOVED, edited)
    with pytest.raises(UserError, match="flies another spec, two_tails: name the manager of one_tail with --of"):
        live_script.fly(Path("x"), MOVED, replace(edited, name="one_tail"))


def test_what_becomes_of_it_otherwise_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    Manager(monkeypatch, True, status("refused", "it is worse"))
    assert fly().sentence == "the script was refused, and nothing has changed: it is worse"
    Manager(monkeypatch, True, status("ended", "a PE is lost"))
    assert fly().sentence == "the script is held no longer: a PE is lost"
    Manager(monkeypatch, True, status("none"))
    assert fly().sentence.startswith("the manager knows no script: it was restarted")
    Manager(monkeypatch, False)
    assert fly() == Answer(done=False, sentence="a reconfiguration is under way")
    Manager(monkeypatch, True, *[status("asked")] * 9)
    late = fly()
    sentence = "the script has not been completed within 30 s; it may still be running: see 'heronry status'"
    assert (late.done, late.sentence) == (False, sentence)


def test_the_status_says_what_became_of_a_script() -> None:
    told = {
        state: list(_script({"state": state, "why": "so"})) for state in ("none", "asked", "held", "refused", "ended")
    }
    assert told == {
        "none": [],
        "asked": ["a script of the operator waits for the best plan, which is compared with it"],
        "held": ["a script of the operator is held: no better plan is sought; 'heronry pcs release' ends it"],
        "refused": ["the last script was refused, and changed nothing: so"],
        "ended": ["the last script is held no longer: so"],
    }
