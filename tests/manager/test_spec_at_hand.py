"""The spec that a standby manager has at hand: how it is given, kept over a restart, and flown by."""

import time
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import Memory
from heronry_manager.core.vocabulary import OperatorSaid, Reply, SpecAtHand
from heronry_manager.shell.control_protocol import Reload
from heronry_manager.shell.other_spec import OtherSpec
from heronry_manager.shell.planner_processes import PlannerProcesses
from heronry_manager.shell.spec_reloads import SpecReloads, Successor

FILE = shipped_spec_path("elevator_and_chute")
TEXT = FILE.read_text()
PATIENCE_S = 60


class Reloads(SpecReloads):
    """The reader of specs of a manager that flies elevator_and_chute; all files are below `folder`."""

    def __init__(self, folder: Path, copies: str = "copies") -> None:
        (folder / copies).mkdir()
        self.planners: list[str] = []
        super().__init__(load(FILE), FILE, load, self.made_ready, folder / copies, close=lambda: None)
        self.resume(folder / "kept")

    def made_ready(self, other: OtherSpec, _file: Path) -> Successor:
        """Write down what happens to planners; no test here lets another core begin."""

        def make(_memory: Memory, _now_ns: int) -> tuple[ManagerCore, PlannerProcesses]:
            raise AssertionError("no core begins here")

        def note(what: str) -> None:
            self.planners.append(f"{what} {other.spec.digest}")

        return Successor(lambda: note("start"), make, lambda: note("close"))

    def read(self) -> list[OperatorSaid | SpecAtHand | Reply]:
        """Return what is told once the spec has been read."""
        until = time.monotonic() + PATIENCE_S
        while not (told := list(self.poll(is_changing=False))):
            assert self.is_reading
            assert time.monotonic() < until
            time.sleep(0.005)
        return told


def newer(folder: Path, priority: int) -> Path:
    file = folder / f"newer_{priority}.dg.yaml"
    file.write_text(TEXT.replace("priority: 20", f"priority: {priority}"))
    return file


@pytest.fixture
def reloads(tmp_path: Path) -> Reloads:
    return Reloads(tmp_path)


def test_an_order_goes_to_the_core_and_a_spec_for_a_standby_stays_at_hand(reloads: Reloads, tmp_path: Path) -> None:
    file = newer(tmp_path, 30)
    spec = load(file)
    assert reloads.begin(7, Reload(str(file))) is None
    (said,) = reloads.read()
    assert isinstance(said, OperatorSaid)
    assert reloads.begin(8, Reload(str(file), spec.digest, for_standby=True)) is None
    told, reply = reloads.read()
    assert told == SpecAtHand(spec.digest)
    assert isinstance(reply, Reply)
    assert (reply.number, reply.done) == (8, True)
    file.write_text("dg: 1\n")  # it is edited meanwhile
    found = reloads.follows()
    assert found.other.spec.digest == spec.digest
    assert load(reloads.flies).digest == spec.digest
    assert load(str(reloads.before)).digest == load(FILE).digest


def test_a_spec_at_hand_outlives_a_restart_and_the_last_one_counts(reloads: Reloads, tmp_path: Path) -> None:
    for priority in (30, 40):
        reloads.begin(1, Reload(str(newer(tmp_path, priority)), for_standby=True))
        reloads.read()
    first, second = (load(newer(tmp_path, priority)).digest for priority in (30, 40))
    wanted = [f"start {first}", f"close {first}", f"start {second}"]
    until = time.monotonic() + PATIENCE_S
    while sorted(reloads.planners) != sorted(wanted):
        assert time.monotonic() < until, reloads.planners
        time.sleep(0.005)
    again = Reloads(tmp_path, "more")
    told, reply = again.read()
    assert told == SpecAtHand(load(newer(tmp_path, 40)).digest)
    assert isinstance(reply, Reply)
    assert reply.number == 0  # of no caller


def test_a_kept_spec_that_is_damaged_is_left_out(reloads: Reloads, tmp_path: Path) -> None:
    reloads.begin(1, Reload(str(newer(tmp_path, 30)), for_standby=True))
    reloads.read()
    (kept,) = (tmp_path / "kept").iterdir()
    kept.write_text("dg: 1\nna")
    (reply,) = Reloads(tmp_path, "more").read()
    assert isinstance(reply, Reply)
    assert not reply.done


def test_a_disk_that_keeps_nothing_costs_only_the_copy(reloads: Reloads, tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("a file in the place of the folder")
    reloads.begin(1, Reload(str(newer(tmp_path, 30)), for_standby=True))
    told, _ = reloads.read()
    assert isinstance(told, SpecAtHand)


def test_what_cannot_be_flown_is_refused_and_nothing_is_at_hand(reloads: Reloads, tmp_path: Path) -> None:
    file = newer(tmp_path, 30)
    assert reloads.begin(1, Reload(str(file), "ab" * 32, for_standby=True)) is None
    busy = reloads.begin(2, Reload(str(file)))
    assert busy is not None
    assert "give the order again" in busy.sentence
    (reply,) = reloads.read()
    assert isinstance(reply, Reply)
    assert "has changed since it was shown" in reply.sentence
    for path, reason in ((tmp_path / "none.dg.yaml", "No such file"), (FILE, "flies by this spec already")):
        reloads.begin(3, Reload(str(path), for_standby=True))
        (reply,) = reloads.read()
        assert isinstance(reply, Reply)
        assert reason in reply.sentence
    assert not (tmp_path / "kept").exists()
