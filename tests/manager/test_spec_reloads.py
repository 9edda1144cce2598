"""Specs that are read for `heronry reload`: which one counts, and what stays behind of the others."""

import threading
from collections.abc import Callable
from pathlib import Path
from time import monotonic, sleep

import pytest

from heronry_dg.loader import load
from heronry_dg.situation import Situation
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import Memory
from heronry_manager.core.vocabulary import OperatorSaid, Reply, RequestSwitch
from heronry_manager.shell.control_protocol import Reload
from heronry_manager.shell.other_spec import OtherSpec
from heronry_manager.shell.planner_processes import PlannerProcesses
from heronry_manager.shell.spec_reloads import SpecReloads, Successor
from manager.test_reloading import TEXT


def until(holds: Callable[[], bool]) -> None:
    end_s = monotonic() + 60
    while not holds():
        assert monotonic() < end_s
        sleep(0.002)


class Reloads:
    """The specs of one manager; what happens to their planners is written down, by a priority in them."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.happened = folder, list[tuple[str, str, bool]]()
        (folder / "copies").mkdir()
        file = self.file("20")
        self.specs = SpecReloads(
            load(file), file, load, self.prepare, folder / "copies", close=lambda: self.note("20", "close")
        )

    def file(self, priority: str) -> Path:
        file = self.folder / f"{priority}.dg.yaml"
        file.write_text(TEXT.replace("priority: 20", f"priority: {priority}"))
        return file

    def note(self, priority: str, what: str) -> None:
        self.happened.append((priority, what, threading.current_thread() is threading.main_thread()))

    def prepare(self, _other: OtherSpec, copy: Path) -> Successor:
        def make(_memory: Memory, _now_ns: int) -> tuple[ManagerCore, PlannerProcesses]:
            raise AssertionError("no core is needed here")

        name = copy.name.removesuffix(".dg.yaml")
        return Successor(lambda: self.note(name, "start"), make, lambda: self.note(name, "close"))

    def order(self, priority: str, *, is_changing: bool) -> OperatorSaid | Reply:
        assert self.specs.begin(1, Reload(str(self.file(priority)), "")) is None
        told: list[OperatorSaid | Reply] = []
        until(lambda: bool(told.extend(self.specs.poll(is_changing=is_changing)) or told))
        return told[0]

    def copies(self) -> set[str]:
        return {file.name for file in (self.folder / "copies").rglob("*.yaml")}


@pytest.fixture
def reloads(tmp_path: Path) -> Reloads:
    return Reloads(tmp_path)


def test_an_order_that_comes_while_another_one_is_carried_out_takes_nothing_from_it(reloads: Reloads) -> None:
    first = reloads.order("30", is_changing=False)
    assert isinstance(first, OperatorSaid)
    assert isinstance(reloads.order("40", is_changing=True), OperatorSaid)  # the core refuses it
    assert reloads.happened == [("30", "start", True), ("40", "close", True)]
    assert reloads.copies() == {"20.dg.yaml", "30.dg.yaml"}
    ready = reloads.specs.first(RequestSwitch(1, Situation(), {}))
    assert ready.plan is not None
    assert reloads.specs.takes_over().other.spec.digest == load(reloads.file("30")).digest


def test_the_planners_of_a_spec_end_when_it_does_not_fly_any_more(reloads: Reloads) -> None:
    reloads.order("30", is_changing=False)
    reloads.specs.takes_over()
    until(lambda: ("20", "close", False) in reloads.happened)
    reloads.order("40", is_changing=False)
    reloads.specs.takes_over()
    until(lambda: ("30", "close", False) in reloads.happened)
    reloads.order("20", is_changing=False)
    assert reloads.copies() == {"20.dg.yaml", "30.dg.yaml", "40.dg.yaml"}


def test_of_a_spec_whose_order_ends_without_a_change_nothing_stays(reloads: Reloads) -> None:
    reloads.order("30", is_changing=False)
    assert list(reloads.specs.poll(is_changing=True)) == []
    assert reloads.happened == [("30", "start", True)]
    assert list(reloads.specs.poll(is_changing=False)) == []
    until(lambda: ("30", "close", False) in reloads.happened)
    assert isinstance(reloads.order("20", is_changing=False), Reply)  # the aircraft flies by it already
    assert reloads.copies() == {"20.dg.yaml"}
    assert reloads.specs.first(RequestSwitch(1, Situation(), {})).problem == "there is no other spec"
