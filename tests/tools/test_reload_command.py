"""`heronry reload` without a manager that flies: what it refuses at once."""

import io
from pathlib import Path
from typing import Any

import pytest

from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.shell.control_protocol import Answer, Reload
from heronry_tools.cli import main
from heronry_tools.commands import reload

FILE = shipped_spec_path("elevator_and_chute")


class Manager:
    """Answers as a manager that flies elevator_and_chute."""

    def __init__(self, state: str = "active") -> None:
        self.status: dict[str, Any] = {
            "spec": "elevator_and_chute",
            "spec_digest": "old",
            "manager": {"state": state},
            "files": {"flies": str(FILE), "before": None},
            "reload": {"to": None, "state": None, "given_up": None, "at_hand": None, "flies": None},
        }
        self.orders: list[Reload] = []
        self.takes, self.refuses = True, ""

    def call(self, _path: Path, order: object) -> Answer:
        if isinstance(order, AskStatus):
            return Answer(done=True, sentence="", status=self.status)
        assert isinstance(order, Reload)
        if self.refuses:
            return Answer(done=False, sentence=self.refuses)
        self.orders.append(order)
        if self.takes:
            self.status["spec_digest"] = order.digest
        elif self.status["reload"] is None:
            self.status["reload"] = {"to": order.digest, "state": "0 of 3 PEs have the table", "given_up": None}
        return Answer(done=True, sentence="on its way")


@pytest.fixture
def manager(monkeypatch: pytest.MonkeyPatch) -> Manager:
    found = Manager()
    monkeypatch.setattr(reload, "call", found.call)
    return found


@pytest.fixture
def standby(manager: Manager, monkeypatch: pytest.MonkeyPatch) -> Manager:
    """A standby manager beside it, which follows when it has the spec."""
    found = Manager("standby")

    def call(path: Path, order: object) -> Answer:
        return (found if path == Path("x-standby") else manager).call(path, order)

    monkeypatch.setattr(reload, "call", call)
    monkeypatch.setattr(reload, "is_listened_on", lambda path: path == Path("x-standby"))
    return found


@pytest.fixture
def newer(tmp_path: Path) -> Path:
    file = tmp_path / "newer.dg.yaml"
    file.write_text(FILE.read_text().replace("priority: 20", "priority: 30"))
    return file


def test_what_changes_is_shown_and_the_user_asked(
    manager: Manager, newer: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("builtins.input", lambda _: "n")
    assert main(["reload", str(newer), "--socket", "x"]) == 1
    assert not manager.orders
    monkeypatch.setattr("builtins.input", lambda _: "y")
    assert main(["reload", str(newer), "--socket", "x"]) == 0
    assert [order.file for order in manager.orders] == [str(newer)]
    assert "the aircraft flies by elevator_and_chute since" in capsys.readouterr().out


def test_why_a_change_was_given_up_is_told(manager: Manager, newer: Path, capsys: pytest.CaptureFixture[str]) -> None:
    manager.takes = False
    manager.status["reload"] = {"to": None, "state": None, "given_up": "pe:nav is not available any more"}
    assert main(["reload", str(newer), "--json", "--socket", "x"]) == 1
    assert "given up, the old spec flies on: pe:nav" in capsys.readouterr().out


def test_an_order_that_the_manager_has_forgotten_is_not_waited_for(
    manager: Manager, newer: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    manager.takes = False
    forgotten, manager.status["reload"] = manager.status["reload"], None

    def restart(_seconds: float) -> None:
        manager.status["reload"] = forgotten

    monkeypatch.setattr("heronry_tools.commands.reload.time.sleep", restart)
    assert main(["reload", str(newer), "--yes", "--socket", "x"]) == 1
    said = capsys.readouterr()
    assert "0 of 3 PEs have the table" in said.out
    assert "does not carry out this order any more" in said.out + said.err


def test_without_an_answer_to_the_question_nothing_changes(
    manager: Manager, newer: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    assert main(["reload", str(newer), "--socket", "x"]) == 1
    assert "nothing has changed" in capsys.readouterr().err
    assert not manager.orders


def test_a_manager_that_knows_no_reload_is_told(
    manager: Manager, newer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    manager.status["files"] = {"spec": str(FILE), "journal": None}
    assert main(["reload", str(newer), "--socket", "x"]) == 2
    assert "start it again with this version" in capsys.readouterr().err


def test_words_that_name_nothing_or_too_much_are_refused(manager: Manager, capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([], ["my.dg.yaml", "--back"], ["--back", "--watch"]):
        assert main(["reload", *words, "--socket", "x"]) == 2
    assert main(["reload", "--back", "--socket", "x"]) == 2
    assert "there is no way back" in capsys.readouterr().err
    for words in (["--standby", "--watch"], ["--standby", "--without-standby"]):
        assert main(["reload", str(FILE), *words, "--socket", "x"]) == 2
        assert "leave the other option out" in capsys.readouterr().err
    assert main(["reload", str(FILE), "--standby", "--socket", "x"]) == 2
    assert "no standby manager runs here" in capsys.readouterr().err
    manager.status["manager"] = {"state": "standby"}
    assert main(["reload", str(FILE), "--socket", "x"]) == 2
    assert "give it the spec with --standby" in capsys.readouterr().err
    assert not manager.orders


def test_a_standby_manager_here_is_given_the_spec_first(
    manager: Manager, standby: Manager, newer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reload", str(newer), "--yes", "--socket", "x"]) == 0
    assert [order.for_standby for order in standby.orders] == [True]
    assert [order.for_standby for order in manager.orders] == [False]
    assert "and the standby manager has followed" in capsys.readouterr().out


def test_a_standby_manager_that_takes_no_spec_ends_the_order_unless_it_is_left_out(
    manager: Manager, standby: Manager, newer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    standby.refuses = "its bus is another one"
    assert main(["reload", str(newer), "--yes", "--socket", "x"]) == 1
    assert "does not take the spec: its bus is another one; mend that, or give --without-standby" in (
        capsys.readouterr().err
    )
    assert not manager.orders
    assert main(["reload", str(newer), "--yes", "--without-standby", "--socket", "x"]) == 0
    assert len(manager.orders) == 1


def test_a_standby_manager_that_does_not_follow_in_time_is_told(
    manager: Manager, standby: Manager, newer: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reload, "_FOLLOWS_S", 0.0)
    standby.takes = False
    assert main(["reload", str(newer), "--yes", "--socket", "x"]) == 0
    assert "has not followed yet" in capsys.readouterr().out
    assert manager.orders


def test_on_its_own_computer_a_standby_manager_alone_is_given_the_spec(
    manager: Manager, standby: Manager, newer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reload", str(newer), "--standby", "--socket", "x"]) == 0
    assert [order.for_standby for order in standby.orders] == [True]
    assert not manager.orders
    digest = standby.status["spec_digest"]
    standby.status["spec_digest"] = "old"
    standby.status["reload"]["flies"] = digest[:4]
    assert main(["reload", str(newer), "--standby", "--socket", "x"]) == 0
    assert "on its way, and the standby manager has followed" in capsys.readouterr().out
    assert main(["reload", str(newer), "--standby", "--socket", "x"]) == 0
    assert "has this spec already" in capsys.readouterr().out
    bad = newer.with_name("bad.dg.yaml")
    bad.write_text(newer.read_text().replace("cpu: 0.03", "cpu: 30", 1))
    assert main(["reload", str(bad), "--standby", "--socket", "x"]) == 1


def test_each_save_flies_and_a_bad_one_is_told(
    manager: Manager, newer: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    saves = iter(["", "dg: 1\n", None])

    def sleep(_seconds: float) -> None:
        text = next(saves)
        if text is None:
            raise KeyboardInterrupt
        newer.unlink(missing_ok=True)  # as an editor does
        if text:
            newer.write_text(text)

    monkeypatch.setattr("heronry_tools.commands.reload.time.sleep", sleep)
    assert main(["reload", "--watch", str(newer), "--socket", "x"]) == 0
    assert len(manager.orders) == 1
    assert "heronry: " in capsys.readouterr().err
