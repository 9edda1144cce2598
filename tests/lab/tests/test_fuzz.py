"""The fuzzer: every decoder and every core accepts arbitrary bytes, and a defect would be found."""

import importlib.util
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from random import Random

import pytest

from heronry_agent.core.agent import AgentCore
from heronry_manager import events
from heronry_manager.core.turn import Turn
from heronry_wire.state_frames import PeState
from lab.fuzz import __main__ as fuzz
from lab.fuzz.mutation import inputs
from lab.fuzz.target import Story, Target
from lab.fuzz.targets import TARGETS

CORPUS = Path("tests/fuzz_corpus")
STORIES = 14  # the last targets: a story takes longer than a decoder
COUNTS = dict.fromkeys(TARGETS, 150) | dict.fromkeys([*TARGETS][-STORIES:], 12) | {"log": 12}  # a log is flown again


@pytest.mark.parametrize("name", TARGETS)
def test_nothing_raises(name: str) -> None:
    begin = fuzz.corpus(CORPUS, TARGETS[name])
    for data in islice(inputs(begin, Random(name)), len(begin) + COUNTS[name]):
        TARGETS[name].run(data)


def test_there_is_no_corpus_without_its_target() -> None:
    assert {folder.name for folder in CORPUS.iterdir() if folder.is_dir()} <= set(TARGETS)


@pytest.mark.parametrize("name", ["agent", "keyed_agent", "gateway", "keyed_gateway"])
def test_the_story_of_a_pe_begins_with_one_that_flies(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cores: set[AgentCore] = set()

    def validate(core: AgentCore) -> None:
        cores.add(core)

    monkeypatch.setattr(AgentCore, "validate", validate)
    for seed in TARGETS[name].seeds():
        TARGETS[name].run(seed)
    assert [core.active_configuration.state for core in cores] == [PeState.ACTIVE]


@pytest.mark.parametrize("name", ["manager", "keyed_manager", "standby", "keyed_standby", "radio_manager"])
def test_the_story_of_a_manager_begins_with_one_that_deploys_a_plan_or_takes_over(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[object] = []

    def emit(turn: Turn, kind: object, **_: object) -> None:
        told.append(kind)

    monkeypatch.setattr(Turn, "emit", emit)
    for seed in TARGETS[name].seeds():
        TARGETS[name].run(seed)
    assert (events.TakenOver if "standby" in name else events.Reconfigured) in told


def test_a_story_gives_numbers_below_a_bound_and_zeros_at_its_end() -> None:
    story = Story(b"\x01\x02\x03\xff")
    assert (story.number(256), story.number(1 << 16), story.number(16)) == (1, 0x203, 15)
    assert not story
    assert (story.number(7), story.bytes(3)) == (0, b"")


def test_inputs_are_the_same_for_a_seed_and_many() -> None:
    drawn = [list(islice(inputs([b"one", b"another"], Random(seed)), 500)) for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
    assert len(set(drawn[0])) > 350


def raising(data: bytes) -> None:
    if b"x" in data:
        raise IndexError("an x")


def fuzzed(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str, guided: bool = False) -> int:
    targets = {"bad": Target("bad", raising, lambda: [b"x"]), "good": Target("good", raising, lambda: [b"o"])}
    monkeypatch.setattr(fuzz, "TARGETS", targets)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: guided or None)
    monkeypatch.chdir(folder)
    return fuzz.main(arguments)


def test_a_finding_is_written_to_a_file_and_can_be_repeated(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fuzzed(monkeypatch, tmp_path, "--count", "1") == 1
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "bad: FOUND: IndexError: an x"
    assert told[2].startswith("good: 1 inputs in ")
    *_, name, _, file = told[1].split()
    assert name == "bad"
    assert Path(file).read_bytes() == b"x"
    assert fuzzed(monkeypatch, tmp_path, "bad", "--input", file) == 1
    assert "IndexError: an x" in capsys.readouterr().err
    (tmp_path / "harmless").write_bytes(b"o")
    assert fuzzed(monkeypatch, tmp_path, "bad", "--input", "harmless") == 0


def test_without_atheris_the_inputs_of_seconds_are_unguided(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fuzzed(monkeypatch, tmp_path, "good", "--seconds", "30") == 1
    assert capsys.readouterr().out.startswith("good: FOUND: IndexError")


def test_an_unknown_target_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fuzzed(monkeypatch, tmp_path, "none") == 2
    assert capsys.readouterr().err == "heronry: there is no target 'none'; the targets are bad, good\n"
    for budget in ("--count", "--seconds"):
        assert fuzzed(monkeypatch, tmp_path, "good", budget, "0") == 2
        assert capsys.readouterr().err == "heronry: --count and --seconds are 1 or more\n"


@dataclass
class Atheris:
    """Stands for a process of atheris, which not every computer has: the files that it leaves."""

    returncode: int
    crash: bytes | None
    stderr: str = "atheris has no memory"

    def __call__(self, command: Sequence[str], **_: object) -> "Atheris":
        assert command[2:5] == ["lab.fuzz.guided", "good", "7"]
        folder = Path(command[-1])
        assert (folder / "kept-0").read_bytes() == b"o"
        (folder / "new").write_bytes(b"reaches more")
        if self.crash is not None:
            (folder / "crash-1").write_bytes(self.crash)
        return self


@pytest.mark.parametrize(
    "expected",
    [
        (Atheris(0, None), 0, "good: 7 s guided by code coverage, 1 inputs that reach new code, nothing found"),
        (Atheris(77, b"xo"), 1, "good: FOUND"),
        (Atheris(1, None), 2, "heronry: atheris has ended with exit code 1: atheris has no memory"),
    ],
)
def test_with_atheris_the_inputs_of_seconds_are_guided(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    expected: tuple[Atheris, int, str],
) -> None:
    atheris, code, says = expected
    monkeypatch.setattr(subprocess, "run", atheris)
    assert fuzzed(monkeypatch, tmp_path, "good", "--seconds", "7", guided=True) == code
    told = capsys.readouterr()
    assert (told.out + told.err).startswith(says)
