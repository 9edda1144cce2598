"""The output and exit codes of the operator's commands; the manager is its core and its socket, in a thread."""

import json
import os
import select
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from heronry_manager.core.vocabulary import Reply
from heronry_manager.shell.control_place import default_socket
from heronry_manager.shell.control_socket import ControlSocket
from heronry_tools.cli import main
from manager.one_manager import OneManager


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[OneManager]:
    """An active manager that listens to the operator."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    flying = OneManager()
    flying.start()
    stop_read, stop_write = os.pipe()

    def serve(control: ControlSocket) -> None:
        watched: list[Any] = [*control.readers(), stop_read]
        while stop_read not in select.select(watched, [], [])[0]:
            for said in control.poll():
                for action in flying.give(said):
                    if isinstance(action, Reply):
                        control.answer(action)
            watched = [*control.readers(), stop_read]

    with ControlSocket(default_socket("two_tails")) as control:
        server = Thread(target=serve, args=(control,))
        server.start()
        yield flying
        os.write(stop_write, b"x")
        server.join()
    os.close(stop_read)
    os.close(stop_write)


def test_an_order_prints_what_is_done(manager: OneManager, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fail", "device:servo_left"]) == 0
    assert main(["clear", "device:servo_left", "--of", "two_tails"]) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines() == [
        "device:servo_left counts as failed until it is cleared; a plan without it is on its way",
        "device:servo_left no longer counts as failed; a plan with it is on its way",
    ]
    assert printed.err == ""


def test_a_traceback_that_nobody_knows_is_one_sentence(manager: OneManager, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["traceback", "module:control"]) == 1
    assert "no failure of module:control is known to this manager" in capsys.readouterr().err


def test_nothing_is_locked_without_a_key(manager: OneManager, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["unlock", "pe:left"]) == 1
    assert "this manager has no key" in capsys.readouterr().err


def test_a_refusal_is_one_sentence_and_ends_with_1(manager: OneManager, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fail", f"bus:{manager.spec.manager.bus}"]) == 1
    assert "carries this manager's commands" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("order", "sentence"),
    [
        (["phase", "glide"], "no phase is named 'glide'; the spec has none"),
        (["fail", "pe:lefft"], "no PE is named 'lefft'; did you mean 'left'?"),
        (["fail", "left"], "'left' is not an element; did you mean 'pe:left'?"),
        (["clear", "devise:servo_left"], "'devise:servo_left' is not an element; did you mean 'device:servo_left'?"),
        (["priority", "elevatr", "7"], "no function is named 'elevatr'; did you mean 'elevator'?"),
        (["traceback", "module:contrl"], "no module is named 'contrl'; did you mean 'control'?"),
        (["traceback", "pe:left"], "pe:left has no code that could fail: name a module"),
        (["unlock", "device:servo_left"], "device:servo_left has no lock: name a PE, such as pe:left"),
    ],
)
def test_a_name_that_the_spec_does_not_have_ends_with_2(
    order: list[str], sentence: str, manager: OneManager, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (order, [*order, "--json"]):
        assert main(words) == 2
        assert capsys.readouterr() == ("", f"heronry: {sentence}\n")


def test_a_priority_is_set_shown_and_ended(manager: OneManager, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["priority", "elevator", "7"]) == 0
    assert main(["status"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("the priority of elevator is 7 from now on; a plan for it is on its way\n")
    assert "! elevator has priority 7, set by the operator\n" in printed
    assert main(["priority", "elevator", "default"]) == 0
    assert "the priority of elevator is that of the spec from now on" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["priority", "elevator", "-3"])
    assert "-3 is no priority; write a whole number from 0 to 32767, or default" in capsys.readouterr().err


def test_the_status_is_for_people_or_for_programs(manager: OneManager, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status"]) == 0
    assert capsys.readouterr().out.startswith("two_tails: manager 126 is active")
    assert main(["status", "--json", "--socket", str(default_socket("two_tails"))]) == 0
    assert json.loads(capsys.readouterr().out)["epoch"] == 1


def test_without_a_manager_one_sentence_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert main(["status"]) == 2
    assert "start one with 'heronry manager SPEC'" in capsys.readouterr().err


def test_an_order_answers_a_program_too(manager: OneManager, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fail", "device:servo_left", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["done"]
    assert answer["sentence"].startswith("device:servo_left counts as failed")
    assert main(["clear", "pe:left", "--json"]) == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out)["sentence"].startswith("no fault is latched on pe:left")
    assert printed.err == ""
