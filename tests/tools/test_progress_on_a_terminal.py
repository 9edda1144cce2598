"""Long commands tell on a terminal that they work; into a pipe, and to a program that reads JSON, they tell nothing."""

import io
from contextlib import redirect_stderr
from pathlib import Path

import pytest

from heronry_tools.cli import main
from heronry_tools.console import progress
from heronry_tools.console.progress import Progress, Working, wish
from thoroughness import mostly_soak
from watch.flights import big_blue_log

ERASED = "\r\x1b[K"

pytestmark = pytest.mark.xdist_group("big_blue_log")  # it is flown once


class Terminal(io.StringIO):
    """A standard error that is a terminal, or is none."""

    def __init__(self, *, is_one: bool = True) -> None:
        super().__init__()
        self._is_one = is_one

    def isatty(self) -> bool:
        return self._is_one


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr(progress, "_FIRST_S", 0.0)
    yield Terminal()
    wish(is_told=True)


def run(stderr, *typed):
    with redirect_stderr(stderr):
        return main(typed)


def commands(folder):
    spec, log, script = "big_blue", str(big_blue_log()), str(folder / "of_nothing.pcs.script")
    Path(script).write_text("G.PruneEdges ();\n")
    return {
        f"planning {spec}": ["plan", spec],
        "explaining elevator": ["why", spec, "elevator"],
        f"drawing {spec}": ["render", spec],
        f"comparing {spec} with elevator_and_chute": ["diff", spec, "elevator_and_chute"],
        "the fault tree of elevator": ["export", "openpsa", spec, "elevator"],
        f"replaying {log}": ["replay", log, spec],
        f"deriving the graph of {spec}": ["pcs", "graph", spec],
        f"assessing {spec}": ["pcs", "check", spec],
        "editing g_eav": ["pcs", "edit", "g_eav", "combine", "g_max"],
        "comparing g_eav with g_star": ["pcs", "script", "g_eav", "g_star"],
        f"trying {script}": ["pcs", "apply", script, spec],
        "cutting g_star": ["pcs", "cut", "g_star"],
        f"the traffic of {spec}": ["bus", spec],
        f"converting {log}": ["log", "convert", log, spec, "-o", str(folder / "flight.mcap")],
    }


@pytest.mark.parametrize("number", mostly_soak(range(14), {*range(14)} - {3}))  # 3, the comparison, takes long
def test_a_command_tells_what_it_does_and_for_how_long_before_it_prints(tmp_path, capsys, terminal, number):
    what, typed = list(commands(tmp_path).items())[number]
    assert run(terminal, *typed) in (0, 1)
    told = terminal.getvalue()
    assert f"{ERASED}{what}: 0 s" in told
    assert told.endswith(ERASED)
    assert capsys.readouterr().out


def test_nothing_is_told_to_a_pipe_and_beside_json(capsys, terminal):
    assert run(terminal, "plan", "big_blue", "--json") == 0
    assert terminal.getvalue() == ""
    pipe = Terminal(is_one=False)
    assert run(pipe, "plan", "big_blue") == 0
    assert pipe.getvalue() == ""
    assert capsys.readouterr().out


def test_work_that_is_done_soon_tells_nothing_and_an_error_has_a_line_of_its_own(terminal, monkeypatch):
    assert run(terminal, "plan", "big_blue", "--phase", "dive") == 2
    assert terminal.getvalue().split(ERASED)[-1].startswith("heronry")
    monkeypatch.setattr(progress, "_FIRST_S", 3600.0)
    shown = terminal.getvalue()
    with redirect_stderr(terminal), Working("nothing that takes long"):
        pass
    assert terminal.getvalue() == shown


def test_steps_are_not_told_beside_json(terminal):
    wish(is_told=False)
    with redirect_stderr(terminal), Progress() as silent:
        silent.begin("flights", 3)
        silent.step()
    assert terminal.getvalue() == ""
    wish(is_told=True)
    with redirect_stderr(terminal), Progress() as telling:
        telling.begin("flights", 3)
    assert f"{ERASED}flights: 0 of 3" in terminal.getvalue()
