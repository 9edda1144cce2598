"""The planner's process: loaded before the first request, queried over pipes, never silent, ended with its client."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, situation
from heronry_manager.planner.client import Failed, Planned, PlannerClient, PlannerError
from heronry_manager.planner.exact import Planner, plan
from heronry_manager.planner.messages import (
    MessageError,
    Ready,
    Refusal,
    Request,
    Solution,
    answer_line,
    read_answer,
    read_request,
    request_line,
)
from heronry_manager.planner.service import answer

FILE = Path(str(shipped_spec_path("elevator_and_chute")))


@pytest.fixture(scope="module")
def spec() -> Spec:
    return load(FILE)


@pytest.fixture(scope="module")
def client(spec: Spec) -> Iterator[PlannerClient]:
    with PlannerClient(spec, FILE) as started:
        yield started


def answers(client: PlannerClient, count: int) -> list[Planned | Failed]:
    """Wait as an event loop would."""
    found: list[Planned | Failed] = []
    while len(found) < count:
        assert select.select([client.fileno()], [], [], 60)[0], "the planner's process says nothing"
        found.extend(client.poll())
    return found


def test_an_answer_is_the_plan_that_this_process_would_make(spec: Spec, client: PlannerClient) -> None:
    now = situation(spec, ["device:gps"], ["bus:can0=40%"])
    running = placement(plan(spec, situation(spec)).configuration)
    client.wait_until_ready()
    assert client.ask(now, running) == plan(spec, now, running)


def test_requests_are_answered_in_their_order_each_with_its_number(spec: Spec, client: PlannerClient) -> None:
    for number, down in ((7, "device:gps"), (8, "device:barometer"), (9, "pe:tail_pe")):
        client.request(number, situation(spec, [down]), None)
    found = answers(client, 3)
    assert [answer.request for answer in found] == [7, 8, 9]
    assert [a.plan.now.down for a in found if isinstance(a, Planned)] == [
        {"device:gps"},
        {"device:barometer"},
        {"pe:tail_pe"},
    ]


def test_a_blocking_question_does_not_take_the_answer_of_another_one(spec: Spec, client: PlannerClient) -> None:
    client.request(1, situation(spec), None)
    with pytest.raises(PlannerError, match="under way"):
        client.ask(situation(spec))
    assert [answer.request for answer in answers(client, 1)] == [1]


def test_a_cancelled_request_is_not_answered_and_the_next_one_is(spec: Spec, client: PlannerClient) -> None:
    fileno = client.fileno()
    client.request(1, situation(spec), None)
    client.request(2, situation(spec), None)
    client.cancel()
    client.request(3, situation(spec), None)
    assert [answer.request for answer in answers(client, 1)] == [3]
    assert client.fileno() == fileno


def test_a_request_inside_a_process_that_dies_fails_and_the_waiting_one_is_answered(
    spec: Spec, client: PlannerClient
) -> None:
    client.wait_until_ready()
    assert client.process_id is not None
    os.kill(client.process_id, signal.SIGSTOP)  # it answers nothing any more
    client.request(1, situation(spec), None)
    client.request(2, situation(spec), None)
    os.kill(client.process_id, signal.SIGKILL)
    first, second = answers(client, 2)
    assert first == Failed(1, "the planner's process ended (exit code -9)")
    assert isinstance(second, Planned)
    assert second.request == 2


def test_a_process_that_writes_a_wrong_line_is_ended(
    spec: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "wrong"
    program.write_text("#!/bin/sh\nread request\necho 3\nread end\n")
    program.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(program))
    with PlannerClient(spec, FILE) as client:
        client.request(1, situation(spec), None)
        (failed,) = answers(client, 1)
    assert isinstance(failed, Failed)
    assert failed.reason.startswith("the manager has ended the planner's process, which wrote a wrong line: ")


def test_a_question_that_cannot_be_answered_is_answered_with_the_reason(spec: Spec, client: PlannerClient) -> None:
    client.request(4, Situation(down=frozenset({"pe:nowhere"})), None)
    (failed,) = answers(client, 1)
    assert isinstance(failed, Failed)
    assert failed.request == 4
    assert "no PE is named 'nowhere'" in failed.reason


def test_a_spec_that_has_changed_since_it_was_loaded_is_not_planned_with(spec: Spec, tmp_path: Path) -> None:
    changed = tmp_path / "changed.dg.yaml"
    for old, new in ((b"cpu: 0.20", b"cpu: 0.21"), (b"dg: 1", b"dg: one")):
        assert old in FILE.read_bytes()
        changed.write_bytes(FILE.read_bytes().replace(old, new))
        with pytest.raises(PlannerError, match="has changed since it was loaded"):
            PlannerClient(spec, changed)


def test_a_comment_in_the_file_is_no_change(spec: Spec, tmp_path: Path) -> None:
    commented = tmp_path / "commented.dg.yaml"
    commented.write_bytes(FILE.read_bytes() + b"# a comment\n")
    with PlannerClient(spec, commented) as started:
        started.wait_until_ready()
        assert started.ask(situation(spec)) == plan(spec, situation(spec))


def test_no_folder_has_to_be_writable(spec: Spec, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", "/no/such/folder")
    with PlannerClient(spec, FILE) as started:
        started.wait_until_ready()


def test_the_process_goes_when_its_client_is_killed(spec: Spec) -> None:
    """The client is another process, killed with a request under way; the service must close our pipe by ending."""
    ours, theirs = os.pipe()
    code = (
        "import os, pathlib\n"
        "from heronry_dg.loader import load\n"
        "from heronry_dg.situation import situation\n"
        "from heronry_manager.planner.client import PlannerClient\n"
        f"file = pathlib.Path({str(FILE)!r})\n"
        "spec = load(file)\n"
        "client = PlannerClient(spec, file)\n"
        "client.wait_until_ready()\n"
        "client.request(1, situation(spec), None)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    # The service inherits standard error, so the pipe stays open as long as it lives.
    with subprocess.Popen([sys.executable, "-c", code], stderr=theirs) as started:
        os.close(theirs)
        assert started.wait(60) == -signal.SIGKILL
    assert select.select([ours], [], [], 60)[0], "the service outlives its client"
    assert os.read(ours, 1) == b""
    os.close(ours)


def test_with_no_client_left_to_answer_the_process_ends_without_a_message() -> None:
    with FILE.open("rb") as file:
        started = subprocess.Popen(
            [sys.executable, "-m", "heronry_manager.planner.service", str(file.fileno()), FILE.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=(file.fileno(),),
        )
    assert started.stdout is not None
    started.stdout.close()
    assert started.stderr is not None
    assert started.stderr.read() == b""
    started.communicate()
    assert started.returncode == 0


def test_requests_and_answers_are_read_back_as_they_were_written(spec: Spec) -> None:
    request = Request(3, situation(spec, ["device:gps"], ["bus:can0=33.3%"]), {"gps_driver": ("only", "sensor_pe")})
    assert read_request(request_line(request), spec) == request
    best = plan(spec, situation(spec))
    solution = Solution(3, best.configuration, best.objective, best.objective.key())
    for said in (Ready(), solution, Refusal(None, "no"), Refusal(3, "no")):
        assert read_answer(answer_line(said)) == said


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"[]",
        b"\xff",
        b'{"request": 1}',
        b'{"request": 1, "down": ["pe:x"], "limits": {}, "phase": null, "priorities": {}, "running": null}',
        b'{"request": 1, "down": [], "limits": {"bus:can0": "a"}, "phase": null, "priorities": {}, "running": null}',
        b'{"request": 1, "down": [], "limits": {}, "phase": "x", "priorities": {}, "running": null}',
        b'{"request": 1, "down": [], "limits": {}, "phase": null, "priorities": {}, "running": {"gps_driver": "only"}}',
        b'{"request": 1, "down": [], "limits": {}, "phase": null, "priorities": {"elevator": "9"}, "running": null}',
        b'{"request": 1, "down": [], "limits": {}, "phase": null, "priorities": {"x": 9}, "running": null}',
    ],
)
def test_a_line_that_is_no_request_is_refused(spec: Spec, line: bytes) -> None:
    refusal = answer(Planner(spec), line)
    assert isinstance(refusal, Refusal)
    assert refusal.reason.startswith(("a line between manager and planner is not", "the request for a plan cannot be"))


@pytest.mark.parametrize(
    "fields",
    [
        {"plan": 3},
        {"objective": [0] * 9},
        {"bounds": [0] * 11},
        {"objective": ["0"] * 10},
        {"modules": {"gps_driver": 3}},
        {"request": None},
    ],
)
def test_a_line_that_is_no_answer_is_an_error(fields: dict[str, object]) -> None:
    whole = {} if "plan" in fields else {"request": 1, "modules": {}, "objective": [0] * 10, "bounds": [0] * 10}
    with pytest.raises(MessageError):
        read_answer(json.dumps({**whole, **fields}).encode())
