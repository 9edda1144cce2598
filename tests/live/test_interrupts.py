"""A command that is interrupted ends with the signal's exit code: no result, no traceback, nothing left running.

The signal comes at a moment that is drawn anew in each run, and goes to the whole process group, as a terminal sends
Ctrl-C. A command that has ended by then has ended well, and the test says nothing about it.
"""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from thoroughness import IS_WHOLE, mostly_soak

pytestmark = pytest.mark.live

LATEST_S = 2.5  # big_blue's contingencies take longer, and so does everything that flies
MOMENTS = 10 if IS_WHOLE else 1
SOON_S = 20.0  # nothing is timed here: -rP shows the time that it took
COMMANDS = {
    "plan": "plan big_blue --down pe:flight --json",
    "contingencies": "contingencies big_blue -o result.contingencies",
    "contingencies in processes": "contingencies big_blue --jobs 2 -o result.contingencies",
    "bound": "bound big_blue --decide",
    "campaign": "campaign big_blue --faults 1",
    "cutsets": "cutsets big_blue elevator",
    "why": "why big_blue guidance --down device:gps --phase glide",
    "check": "check big_blue elevator_and_chute",
    "diff": "diff big_blue elevator_and_chute",
    "bus": "bus big_blue",
    "render": "render big_blue -o result.svg",
    "dbc": "dbc big_blue -o result.dbc",
    "table": "table big_blue nav -o result.table",
    "sim": "sim big_blue --runs 4 --seconds 20",
    "sim in processes": "sim big_blue --runs 8 --seconds 20 --jobs 2",
    "exhaust": "exhaust elevator_and_chute --sample 200 --jobs 2",
    "scenario": "scenario kill.scenario",
    "demo": "demo elevator_and_chute --for 20",
    "doctor": "doctor",
}
ALWAYS = ["plan", "contingencies in processes", "bound", "render", "sim", "exhaust", "demo", "check"]
STANDARD_OUTPUT, ERRORS = "result.stdout", "errors"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "kill.scenario").write_text("spec big_blue\nseed 7\nat 2.0s kill pe:flight\nend 30s\n")
    return tmp_path


@pytest.mark.parametrize("moment", range(MOMENTS))
@pytest.mark.parametrize("command", mostly_soak(COMMANDS, ALWAYS))
def test_an_interrupted_command_has_no_result(command: str, moment: int, folder: Path) -> None:
    number = random.choice((signal.SIGINT, signal.SIGINT, signal.SIGTERM))
    after_s = random.uniform(0.0, LATEST_S)
    process = started(COMMANDS[command].split(), folder)
    time.sleep(after_s)
    if process.poll() is not None:
        return  # it has ended by itself
    os.killpg(process.pid, number)
    sent_at = time.monotonic()
    process.wait(SOON_S)
    told = (folder / ERRORS).read_text()
    print(f"{command}: at {after_s:.2f} s {number.name}, ended {(time.monotonic() - sent_at) * 1e3:.0f} ms later")
    assert "Traceback" not in told, told
    assert soon(lambda: not list(left_in_session(process.pid))), list(left_in_session(process.pid))
    assert not list(folder.glob("*.new"))
    if process.returncode == 0:  # its work was done when the signal came: then it was done to the end
        assert results(folder) == results_of_whole(command, folder), after_s
        return
    assert process.returncode == 128 + number, (after_s, told)
    assert set(results(folder)) <= {STANDARD_OUTPUT, "result.contingencies.partial"}  # the next run goes on from it


def results_of_whole(command: str, folder: Path) -> dict[str, bytes]:
    """Give what the same command writes where nothing interrupts it."""
    for file in folder.glob("result.*"):
        file.unlink()
    assert started(COMMANDS[command].split(), folder).wait() == 0
    return results(folder)


def results(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.glob("result.*")}


def test_a_search_that_is_interrupted_gives_no_worse_plan(folder: Path) -> None:
    """CP-SAT has a handler of its own, which would end the search and give the best so far as the answer."""
    for after_s in (1.0,) if not IS_WHOLE else [0.4 + 0.1 * step for step in range(15)]:
        process = started(["contingencies", "big_blue", "--jobs", "1", "-o", "result.contingencies"], folder)
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        assert process.wait(SOON_S) == 130, (folder / ERRORS).read_text()
        assert not (folder / "result.contingencies").exists()


@pytest.mark.parametrize("command", ["plan big_blue --json", "--help", "rules", "bus big_blue"])
def test_standard_output_that_is_closed_is_told_in_one_sentence(command: str) -> None:
    done = subprocess.run(
        ["sh", "-c", f"{sys.executable} -m heronry_tools {command} >&-"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert done.stderr == "heronry: the output cannot be written: Bad file descriptor; make room, or write elsewhere\n"


def test_a_file_is_written_where_standard_output_is_closed(folder: Path) -> None:
    words = f"{sys.executable} -m heronry_tools dbc big_blue -o {folder / 'big_blue.dbc'} >&- 2>&- <&-"
    assert subprocess.run(["sh", "-c", words], check=False).returncode == 0
    assert "BO_ " in (folder / "big_blue.dbc").read_text()


def started(words: list[str], folder: Path) -> "subprocess.Popen[bytes]":
    """Start a command in a session of its own, and wait until Python has come to its first line."""
    environment = os.environ | {"XDG_CACHE_HOME": str(folder / "cache"), "XDG_STATE_HOME": str(folder / "state")}
    with (folder / STANDARD_OUTPUT).open("wb") as output, (folder / ERRORS).open("wb") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "heronry_tools", *words],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=errors,
            start_new_session=True,
            preexec_fn=take_interrupts,  # noqa: PLW1509 - no thread runs here
        )
    assert soon(lambda: process.poll() is not None or takes_termination(process.pid))
    return process


def take_interrupts() -> None:
    """Undo what a shell does to a job in the background: it lets it ignore SIGINT, and so would the command."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def takes_termination(pid: int) -> bool:
    """Whether a process has a handler for SIGTERM, which Python has none of its own for."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return True
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def left_in_session(session: int) -> Iterator[str]:
    """Command lines of the processes that a session still has."""
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and os.getsid(int(entry.name)) == session:
                yield (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue  # it has ended


def soon(condition: Callable[[], bool]) -> bool:
    """Whether a condition becomes true within some seconds: a process that was killed is gone a little later."""
    until = time.monotonic() + SOON_S
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True
