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
from contextlib import nullcontext
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

import pytest

from heronry_pcs.graph import Graph, Leaf, Part
from heronry_pcs.graph_files import to_json
from heronry_tools.runtime.softbus.starter import start_hub
from lab.benches.check import chain
from thoroughness import IS_WHOLE
from watch.flights import big_blue_log

pytestmark = pytest.mark.live

LATEST_S = 2.5  # big_blue's contingencies take longer, and so does everything that flies
MOMENTS = 10 if IS_WHOLE else 1
SOON_S = 20.0  # nothing is timed here: -rP shows the time that it took
WHOLE_S = 200.0
BUS = "-i softbus -c ./bus.sock -b 1000000"
COMMANDS = {
    "plan": "plan big_blue --down pe:flight --json",
    "contingencies": "contingencies big_blue -o result.contingencies",
    "contingencies in processes": "contingencies big_blue --jobs 2 -o result.contingencies",
    "bound": "bound big_blue",
    "bound of a decision": "bound big_blue --decide 30",
    "campaign": "campaign big_blue --faults 1",
    "cutsets": "cutsets big_blue elevator",
    "why": "why big_blue guidance --down device:gps --phase glide",
    "check": "check big_blue elevator_and_chute",
    "check of a large spec": "check chain.dg.yaml",
    "diff": "diff big_blue elevator_and_chute",
    "bus": "bus big_blue",
    "render": "render big_blue -o result.svg",
    "dbc": "dbc big_blue -o result.dbc",
    "table": "table big_blue nav -o result.table",
    "sim": "sim big_blue --runs 4 --seconds 20",
    "sim in processes": "sim big_blue --runs 8 --seconds 20 --jobs 2",
    "exhaust": "exhaust elevator_and_chute --sample 200 --jobs 2",
    "scenario": "scenario kill.scenario",
    "fly": "fly eav --runs 3 -o result.txt",
    "fly with processes": "fly eav --live",
    "pcs check": "pcs check big_blue",
    "pcs cut": "pcs cut big_blue -o result.txt",
    "pcs cut of a large graph": "pcs cut wheel.pcs.json -o result.txt",
    "module try": "module try slow:Slow --steps 60 -o result.txt",
    "log convert": "log convert kill.scenario -o result.mcap",
    "log convert to MDF 4": "log convert kill.scenario -o result.mf4",
    "replay": "replay flight.log big_blue -o result.txt",
    "top": "top --log kill.scenario --json",
    "demo": "demo elevator_and_chute --for 20",
    "demo with its page": "demo elevator_and_chute --web --for 20",
    "doctor": "doctor",
    "doctor on a bus": f"doctor elevator_and_chute --wait 20 {BUS}",
    "send-table": f"send-table big_blue nav {BUS}",
    "softbus": "softbus ./own.sock",
    "manager": f"manager elevator_and_chute --state-dir state {BUS}",
    "top on a bus": f"top elevator_and_chute --json {BUS}",
    "record": f"record elevator_and_chute -o recorded {BUS}",
    "metrics": f"metrics elevator_and_chute {BUS}",
    "metrics on a port": f"metrics elevator_and_chute --port 0 {BUS}",
    "web": f"web elevator_and_chute --port 0 {BUS}",
}
SERVE = ("softbus", "manager", "record", "metrics on a port", "web")  # they end with 0 when a signal stops them
DATED = ("log convert to MDF 4", "metrics", "module try")  # what they write says when it was, or how long it took
SHARES = 8  # each run of `make test` interrupts one command of each share, another one each time
STANDARD_OUTPUT, ERRORS = "result.stdout", "errors"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to work in; sockets of managers are in another one: a path of a socket must be short."""
    (tmp_path / "kill.scenario").write_text(SCENARIO)
    with TemporaryDirectory() as runtime:
        monkeypatch.setenv("XDG_RUNTIME_DIR", runtime)
        yield tmp_path


def write_flight(file: Path) -> None:
    copyfile(big_blue_log(), file)


def write_wheel(file: Path) -> None:
    """A large component graph: a chain of components from the left side to the right one, with shortcuts."""
    last, draw = 1500, random.Random(7)
    sides = {0: "left", last: "right"}
    leaves = {f"A{n}": Leaf(f"A{n}", {"p": draw.randrange(1, 99)}, "x", side=sides.get(n)) for n in range(last + 1)}
    pairs = ((n, m) for n in range(last) for m in (n + 1, min(last, n + 2 + draw.randrange(40))))
    edges = frozenset((f"A{n}.p", f"A{m}.p") for n, m in pairs)
    graph = Graph("wheel", leaves, {}, Part(frozenset(f"{name}.p" for name in leaves), edges, frozenset(leaves)))
    file.write_text(to_json(graph))


READ = {  # what a command reads: how it is written
    "chain.dg.yaml": lambda file: file.write_text(chain(2000)),
    "wheel.pcs.json": write_wheel,
    "slow:Slow": lambda file: file.with_name("slow.py").write_text(SLOW),
    "flight.log": write_flight,
}
SCENARIO = """\
# A computer dies, and much time passes after that.
spec big_blue
seed 7
at 2.0s kill pe:flight
end 30s
"""
SLOW = """\
import time
from heronry_agent.module import Module

class Slow(Module):
    def step(self, inputs):
        time.sleep(0.05)
        return {}
"""


@pytest.mark.soak
@pytest.mark.parametrize("moment", range(MOMENTS))
@pytest.mark.parametrize("command", COMMANDS)
def test_an_interrupted_command_has_no_result_at_any_moment(command: str, moment: int, folder: Path) -> None:
    interrupt(command, folder)


def test_an_interrupt_while_multiprocessing_is_imported_ends_the_process_without_a_word() -> None:
    program = """if True:
        import sys, types
        from heronry_wire import interruption
        sys.modules["multiprocessing"] = types.ModuleType("multiprocessing")  # as while its import has just begun
        interruption._end(2)
    """
    ended = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, timeout=SOON_S)
    assert (ended.returncode, ended.stderr) == (130, b"")


@pytest.mark.parametrize("share", range(SHARES))
def test_an_interrupted_command_has_no_result(share: int, folder: Path) -> None:
    interrupt(random.choice([*COMMANDS][share::SHARES]), folder)


def interrupt(command: str, folder: Path) -> None:
    """Send a signal to a running command at a random moment, and assert how it ends, and what it leaves."""
    words = COMMANDS[command].split()
    for word in READ.keys() & set(words):
        READ[word](folder / word)
    with start_hub(folder / "bus.sock", 1_000_000) if "./bus.sock" in words else nullcontext():
        before = set(folder.iterdir())
        number = random.choice((signal.SIGINT, signal.SIGINT, signal.SIGTERM))
        after_s = random.uniform(0.0, LATEST_S)
        process = started(words, folder)
        time.sleep(after_s)
        if process.poll() is not None:  # it has ended by itself
            assert process.returncode in (0, 1), (folder / ERRORS).read_text()
            return
        os.killpg(process.pid, number)
        sent_at = time.monotonic()
        process.wait(SOON_S)
        told = (folder / ERRORS).read_text()
        print(f"{command}: at {after_s:.2f} s {number.name}, ended {(time.monotonic() - sent_at) * 1e3:.0f} ms later")
        assert "Traceback" not in told, told
        assert soon(lambda: not list(left_behind(process.pid, folder))), list(left_behind(process.pid, folder))
        left = {file.name for file in set(folder.iterdir()) - before} - {ERRORS, STANDARD_OUTPUT, "__pycache__"}
        if process.returncode == 0 and command in SERVE:
            assert left <= {"cache", "state", "recorded"}
        elif process.returncode == 1:  # its answer was no when the signal came
            assert command.startswith("doctor"), told
        elif process.returncode == 0:  # its work was done when the signal came: then it was done to the end
            found, whole = results(folder), results_of_whole(command, folder)
            assert found.keys() == whole.keys(), after_s
            assert found == whole or command in DATED, after_s
        else:
            assert process.returncode == 128 + number, (command, after_s, told)
            assert left <= {"cache", "state", "result.contingencies.partial"}, (command, left)  # the next run continues


def results_of_whole(command: str, folder: Path) -> dict[str, bytes]:
    """Return what the same command writes where nothing interrupts it."""
    for file in folder.glob("result.*"):
        file.unlink()
    assert started(COMMANDS[command].split(), folder).wait(WHOLE_S) == 0, command
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


def left_behind(session: int, folder: Path) -> Iterator[str]:
    """Command lines of the processes that a session still has, or that have its environment in another session."""
    ours = f"XDG_CACHE_HOME={folder / 'cache'}".encode()
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and (
                os.getsid(int(entry.name)) == session or ours in (entry / "environ").read_bytes().split(b"\0")
            ):
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
