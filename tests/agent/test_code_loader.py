"""The loader as the agent's loop sees it: real keepers, and what follows for the core; no bus and no modules."""

import select
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from agent.loader_bundles import IMAGE, bundle, signed, signing_key
from heronry_agent.core.vocabulary import (
    ControlProgram,
    EndPartition,
    ImagesArrived,
    ImagesMissing,
    KeepParts,
    ModuleEvent,
    PartitionEnded,
    ProgramChanged,
    ProgramState,
    StartFailed,
    StartModule,
    StepFailed,
    Stepped,
    StopModule,
    WriteProgram,
)
from heronry_agent.loader.code_loader import RETRY_NS, CodeLoader
from heronry_agent.loader.folder import Folder
from heronry_agent.loader.keeper_process import KEEPER_NS, KeeperProcess
from heronry_agent.loader.store import Store
from heronry_agent.loader.trial import GAP_NS, TRIAL_NS, Trial, Verdict
from heronry_wire.pe_table import ModeEntry, ModuleEntry

MODULE, PARTITION = 4, "C+"
ENTRY = ModuleEntry(
    MODULE,
    "probe",
    IMAGE,
    None,
    demux=False,
    movable=False,
    modes=(ModeEntry("only", 20_000, 10, (), {}),),
    partition=PARTITION,
)
START, NO_START = ControlProgram(is_start=True), ControlProgram(is_start=False)
RUN = StartModule(MODULE, ENTRY, 0)
PATIENCE_S = 60


def program(version: int, error: int = 0, *, is_at_work: bool = False) -> ProgramState:
    """What the loader says with this version in use."""
    return ProgramState(version, error, is_at_work, bytes.fromhex(bundle(version).digest) if version else b"")


class Loop:
    """A loader, and the part of the agent's loop that serves it."""

    def __init__(self, folder: Path, key: Path | None = None) -> None:
        self.said: list[str] = []
        self.loader = CodeLoader(
            folder / "code", KeeperProcess(folder / "code", key), {MODULE: ENTRY}, self.said.append
        )
        self.now_ns = 1_000_000_000

    def order(self, action) -> list[ModuleEvent]:
        """Give an order, and wait until it is done."""
        events = self.loader.ordered(action, self.now_ns)
        return events or self.wait()

    def wait(self) -> list[ModuleEvent]:
        end_s = time.monotonic() + PATIENCE_S
        events: list[ModuleEvent] = []
        while self.loader.readers:
            assert time.monotonic() < end_s
            ready, _, _ = select.select(list(self.loader.readers), [], [], 1)
            events += self.loader.take(ready, self.now_ns)
        return events

    def bring(self, version: int) -> list[ModuleEvent]:
        assert self.order(WriteProgram(bundle(version).content)) == [ProgramChanged(self.loader.program)]
        return self.order(START)

    def step_for(self, duration_ns: int) -> list[ModuleEvent]:
        events: list[ModuleEvent] = []
        for _ in range(duration_ns // GAP_NS):
            self.now_ns += GAP_NS
            events += self.loader.heard(Stepped(MODULE, 1, {}), self.now_ns)
        return events


def test_parts_are_kept_until_their_bundle_is_whole(tmp_path: Path) -> None:
    loop, store = Loop(tmp_path), Store(Folder(tmp_path / "code"))
    loop.loader.ordered(KeepParts(b"some"), loop.now_ns)
    loop.loader.ordered(KeepParts(b"some more"), loop.now_ns)  # a keeper is at work
    loop.order(KeepParts(b"most"))
    assert not loop.loader.program.is_at_work
    assert (loop.loader.kept_parts, store.kept()) == (b"most", b"most")
    assert Loop(tmp_path).loader.kept_parts == b"most"
    loop.order(WriteProgram(bundle(3).content))
    assert (loop.loader.kept_parts, store.kept()) == (b"", b"")
    loop.order(KeepParts(b"others"))
    loop.order(START)
    assert loop.loader.kept_parts == b"others"
    loop.order(NO_START)
    assert (loop.loader.kept_parts, store.kept()) == (b"", b"")
    assert loop.said[1:] == ["version 3 of probe is in use"]


def test_parts_that_the_disk_does_not_take_are_no_fault(tmp_path: Path) -> None:
    loop = Loop(tmp_path)
    (tmp_path / "code" / "parts").mkdir()
    loop.order(KeepParts(b"some"))
    assert (loop.loader.program, loop.said) == (program(0), [])
    again = Loop(tmp_path)
    assert (again.loader.program, again.loader.kept_parts, again.said) == (program(0), b"", [])


@pytest.fixture
def loop(tmp_path: Path) -> Iterator[Loop]:
    loop = Loop(tmp_path)
    yield loop
    loop.loader.close()


def test_code_comes_runs_for_a_minute_and_is_kept(loop: Loop, tmp_path: Path) -> None:
    assert loop.loader.program == program(0, 0)
    assert loop.bring(3) == [ProgramChanged(program(3, 0)), ImagesArrived(frozenset((IMAGE,)))]
    assert loop.loader.is_changed
    assert loop.loader.path == str(tmp_path / "code" / "slot-a.bundle")
    loop.loader.ordered(RUN, loop.now_ns)
    assert loop.step_for(TRIAL_NS + 2 * GAP_NS) == []
    loop.wait()
    assert loop.said[-1] == "the code has run for a minute, and is kept"
    assert Store(Folder(tmp_path / "code")).state().tries is None
    again = Loop(tmp_path)
    assert (again.loader.program, again.said) == (program(3, 0), ["code of probe, version 3"])


FAILURES = {
    "it raises": StepFailed(MODULE, 1, "ValueError: 1"),
    "it cannot be built": StartFailed(MODULE, "TypeError: no"),
    "its partition ends": PartitionEnded(PARTITION, "exit code 3"),
    "it cannot be imported": ImagesMissing({IMAGE: "the code cannot be imported"}),
}


@pytest.mark.parametrize("how", FAILURES)
def test_code_that_fails_is_out_of_use_at_once(loop: Loop, how: str, tmp_path: Path) -> None:
    loop.bring(3)
    loop.loader.ordered(RUN, loop.now_ns)
    loop.loader.is_changed = False
    changed, missing = loop.loader.heard(FAILURES[how], loop.now_ns)
    assert changed == ProgramChanged(program(0, 0))
    assert isinstance(missing, ImagesMissing)
    assert list(missing.images) == [IMAGE]
    assert loop.loader.is_changed
    assert loop.loader.path is None
    loop.wait()
    assert Store(Folder(tmp_path / "code")).state().code is None
    assert "the code before it is back" in loop.said[-1]


def test_code_that_hangs_is_replaced_by_the_code_before(loop: Loop) -> None:
    loop.bring(3)
    loop.loader.ordered(RUN, loop.now_ns)
    loop.step_for(TRIAL_NS + 2 * GAP_NS)
    loop.wait()
    loop.loader.ordered(StopModule(MODULE), loop.now_ns)
    loop.bring(4)
    loop.loader.ordered(RUN, loop.now_ns)
    assert loop.loader.ordered(EndPartition(PARTITION), loop.now_ns) == [ProgramChanged(program(3, 0))]
    loop.wait()
    assert loop.order(WriteProgram(bundle(4).content)) == [ProgramChanged(program(3, 7))]
    assert "is not above 4" in loop.said[-1]


def test_code_is_not_started_while_a_module_of_it_runs(loop: Loop) -> None:
    loop.bring(3)
    loop.loader.ordered(RUN, loop.now_ns)
    assert loop.loader.runs(PARTITION)
    assert loop.order(START) == [ProgramChanged(program(3, 7))]
    assert "let them run elsewhere first" in loop.said[-1]
    loop.loader.heard(PartitionEnded("C", "another one"), loop.now_ns)
    loop.loader.abandon()
    assert not loop.loader.runs(PARTITION)


def test_what_is_wrong_is_an_error_of_1f57h_and_a_sentence(tmp_path: Path) -> None:
    key = signing_key(tmp_path)
    loop = Loop(tmp_path, key.with_name(f"{key.name}.pub"))
    content = signed(key, 1).content
    cases = [(bundle(1).content, 7), (content[:-1], 3), (bytes((1 << 20) + 1), 6), (content, 0)]
    for sent, error in cases:
        assert loop.order(WriteProgram(sent)) == [ProgramChanged(program(0, error))]
        assert "\n" not in loop.said[-1]
    assert loop.order(NO_START) == [ProgramChanged(program(0, 0))]
    assert loop.order(START) == [ProgramChanged(program(0, 3))]
    assert "there is no code to start" in loop.said[-1]


def test_a_disk_that_takes_nothing_is_error_5_and_a_revert_is_repeated(loop: Loop, tmp_path: Path) -> None:
    loop.bring(3)
    record = tmp_path / "code" / "code.json.new"
    record.mkdir()  # the record cannot be drafted
    assert loop.order(WriteProgram(bundle(4).content)) == [ProgramChanged(program(3, 5))]
    loop.loader.heard(FAILURES["it raises"], loop.now_ns)
    loop.wait()
    assert loop.loader.program.version == 0
    assert loop.loader.next_ns == loop.now_ns + RETRY_NS
    record.rmdir()
    loop.now_ns += RETRY_NS
    loop.loader.take((), loop.now_ns)
    loop.wait()
    assert Store(Folder(tmp_path / "code")).state().code is None
    record.mkdir()
    assert loop.order(WriteProgram(bundle(4).content)) == [ProgramChanged(program(0, 5))]


def test_a_keeper_that_hangs_is_ended_and_told(loop: Loop) -> None:
    loop.loader.ordered(WriteProgram(bundle(1).content), loop.now_ns)
    loop.loader.ordered(NO_START, loop.now_ns)  # waits for the first one
    loop.now_ns += KEEPER_NS
    assert loop.loader.take((), loop.now_ns) == [ProgramChanged(program(0, 5, is_at_work=True))]
    assert "ended or hung" in loop.said[-1]
    assert loop.wait() == [ProgramChanged(program(0, 0))]
    loop.loader.ordered(WriteProgram(bundle(1).content), loop.now_ns)
    loop.loader.close()
    assert not loop.loader.readers


def test_a_gap_in_the_steps_of_code_counts_only_a_little() -> None:
    trial = Trial({MODULE}, {IMAGE}, {PARTITION})
    for now_ns in (0, 2 * TRIAL_NS, 4 * TRIAL_NS):
        trial.heard(Stepped(MODULE, 1, {}), now_ns)
    trial.heard(Stepped(MODULE + 1, 1, {}), 4 * TRIAL_NS + 1)
    assert trial.verdict is Verdict.RUNNING


def test_an_agent_without_a_loader_imports_nothing_of_it() -> None:
    program = "import sys, heronry_agent.shell.cli; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    modules = done.stdout.split()
    unwanted = ("heronry_agent.loader", "heronry_wire.bundle", "cryptography", "packaging", "subprocess", "json.tool")
    allowed = {"heronry_wire.part_transfer"}  # the bytes of object 2030h
    assert [one for one in modules if one.startswith(unwanted) and one not in allowed] == []
