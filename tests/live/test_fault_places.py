"""Real PEs on a software bus: a module that lacks its code or crashes on one PE runs elsewhere; suspicions are told."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from heronry_manager.events import FaultReported, PeLost, PlanReady, Reconfigured, Suspicion, UnknownElement
from heronry_manager.events.reading import events_in
from live.told_events import E

pytestmark = pytest.mark.live
PYTHON = [sys.executable, "-m"]
SPEC = Path("dg_specs/examples/fail_over.dg.yaml")
PATIENCE_S = 60.0
LOGIC = "runs_on: [left, right], needs: altitude,"
GOOD = """
from heronry_agent.module import Module

class Logic(Module):
    def step(self, inputs):
        return {"chute_release": 0}
"""
CRASHES_ON_THE_FIRST_PE = """
from pathlib import Path
from heronry_agent.module import Module

HERE = Path(__file__).parent
MARK = HERE.parent / "crashed_on"

class Logic(Module):
    steps = 0

    def step(self, inputs):
        self.steps += 1
        if self.steps == 5 and (not MARK.exists() or MARK.read_text() == HERE.name):
            MARK.write_text(HERE.name)
            raise RuntimeError("no luck here")
        return {"chute_release": 0}
"""


class Desk:
    """A software bus, three PEs and a manager, whose events are kept."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._bus = ["-i", "softbus", "-c", str(folder / "can0.sock")]
        self._events = folder / "events"
        self._begun = contextlib.ExitStack()
        spec = folder / "spec.dg.yaml"
        text = SPEC.read_text().replace(LOGIC, f'{LOGIC} image: "chute_code:Logic",')
        text = text.replace("{bitrate: 500000}", "{bitrate: 500000, heartbeat_ms: 400}")
        assert "chute_code" in text
        assert "heartbeat_ms" in text
        spec.write_text(text)
        self._spec = str(spec)

    def begin(self, **codes: str | None) -> None:
        """Start everything; `codes` gives the code that each PE has of the logic, if it has any."""
        self._start(["heronry_tools", "softbus", self._bus[-1], "-b", "500000"], {})
        until(lambda: Path(self._bus[-1]).exists())
        for pe, code in codes.items():
            folder = self._folder / pe
            folder.mkdir()
            if code is not None:
                (folder / "chute_code.py").write_text(code)
            table = str(folder / "table")
            subprocess.run([*PYTHON, "heronry_tools", "table", self._spec, pe, "-o", table], check=True)
            self._start(["heronry_agent", "--simulated", "--table", table, *self._bus], {"PYTHONPATH": str(folder)})
        with self._events.open("w") as events:
            self._start(["heronry_tools", "manager", self._spec, *self._bus, "--json"], {}, events)

    def _start(self, words: list[str], environment: dict[str, str], out: Any = subprocess.DEVNULL) -> None:
        process = subprocess.Popen(
            [*PYTHON, *words],
            env={**os.environ, "XDG_STATE_HOME": str(self._folder), **environment},
            stdout=out,
            stdin=subprocess.DEVNULL,
        )
        self._begun.callback(process.wait, 30)
        self._begun.callback(process.terminate)

    def told(self, kind: type[E]) -> list[E]:
        lines = self._events.read_text().splitlines() if self._events.exists() else []
        return [event for event in events_in(lines) if isinstance(event, kind)]

    def runs(self, module: str, pe: str) -> bool:
        """Whether the last configuration that became active everywhere has the module on this PE."""
        done = self.told(Reconfigured)
        plans = [told.plan.modules for told in self.told(PlanReady) if done and told.t_ns <= done[-1].t_ns]
        return bool(plans) and module in plans[-1] and plans[-1][module].pe == pe

    def end(self) -> None:
        self._begun.close()


def until(holds: Any) -> None:
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    built = Desk(tmp_path)
    yield built
    built.end()


def test_a_pe_without_the_code_tells_so_and_flies_everything_else(desk: Desk) -> None:
    desk.begin(left=GOOD, right=None, tail=None)
    until(lambda: desk.told(FaultReported))
    until(lambda: desk.runs("chute_logic", "left"))
    assert {fault.element for fault in desk.told(FaultReported)} == {"module:chute_logic@right"}
    assert "pe:right" not in desk.told(PlanReady)[-1].plan.down
    assert desk.told(PeLost) == []


def test_a_module_that_crashes_on_one_pe_runs_on_the_other(desk: Desk, tmp_path: Path) -> None:
    desk.begin(left=CRASHES_ON_THE_FIRST_PE, right=CRASHES_ON_THE_FIRST_PE, tail=None)
    until(lambda: desk.told(FaultReported))
    there = (tmp_path / "crashed_on").read_text()
    until(lambda: desk.runs("chute_logic", "left" if there == "right" else "right"))
    assert {fault.element for fault in desk.told(FaultReported)} == {f"module:chute_logic@{there}"}
    assert desk.told(PlanReady)[-1].plan.down == (f"module:chute_logic@{there}",)


def test_reports_of_pes_and_buses_are_assessed_and_fail_none() -> None:
    words = [
        "demo",
        "tests/scenarios/suspected.dg.yaml",
        "--kill",
        "pe:far@7",
        "--for",
        "8",
        "--json",
        "--contingencies",
        "none",
    ]
    environment = {**os.environ, "PYTHONPATH": "tests"}
    ran = subprocess.run(
        [*PYTHON, "heronry_tools", *words], env=environment, capture_output=True, text=True, timeout=90, check=True
    )
    told = list(events_in(ran.stdout.splitlines()))
    suspected = {event.element for event in told if isinstance(event, Suspicion)}
    assert {"pe:right", "bus:can0", "bus:link"} <= suspected
    assert "suspecting" in [event.module for event in told if isinstance(event, UnknownElement)]
    assert [event for event in told if isinstance(event, FaultReported)] == []
