"""A blank PE joins big_blue on a bus at half load, and gets its code over the bus: how long it takes, and who is late.

The aircraft flies at a fifth of its rates, since nine agents, two buses and a recorder share one computer; other
equipment fills the bus up to its half. `heronry record` records the flight. A datum is late if the time since the datum
before it is longer than its period and its deadline together: then it left after its deadline, whenever its module had
computed it. Silences of the whole bus do not count: the other equipment sends all the time, so then this computer stood
still, and no frame was in the way of another.
"""

import re
import signal
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest

from agent.loader_bundles import signing_key
from heronry_dg.loader import loads
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.traffic import identifiers
from heronry_manager import events
from heronry_manager.core.settings import CodeBundle
from heronry_manager.events.reading import events_in
from heronry_tools.cli import main
from heronry_tools.recording.recorded_folder import log_of
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_wire.bundle import pack
from heronry_wire.bundle_signing import sign
from heronry_wire.frame import LoggedFrame
from heronry_wire.identifiers import sdo_request_id
from live.node_processes import PATIENCE_S, Nodes, ended
from live.told_events import next_event

pytestmark = [pytest.mark.live, pytest.mark.soak, pytest.mark.timing]
LONGEST = 1.3  # times what the transfer takes in the simulator
PE, MODULE, IMAGE = "payload", "wing_monitor", "over_the_bus:WingMonitor"  # it serves a function of criticality C
OTHERS_ID, OTHERS_NS = 400, 280_000  # 135 bits in 280 us: 48 % of 1 Mbit/s
SILENCE_NS = 5_000_000
SLOWER = 5
CHANGES = {
    "bitrate: 1000000,": "bitrate: 1000000, heartbeat_ms: 200, foreign: "
    f"[{{identifier: {OTHERS_ID}, bytes: 8, period_ms: {OTHERS_NS / 1e6}}}],",
    "heartbeat_ms: 200, misses: 4": "heartbeat_ms: 400, misses: 4",
    "ram: 32KiB, flash: 96KiB": "ram: 32KiB, flash: 256KiB",
    f"{MODULE}:\n": f'{MODULE}:\n    image: "{IMAGE}"\n    runs_on: [{PE}]\n',
}
CODE = b"""
from heronry_agent.module import Module
class WingMonitor(Module):
    def step(self, inputs):
        return {"wing_state": 0}
"""
OTHER_EQUIPMENT = f"""
import sys, time
import can
bus = can.Bus(interface="softbus", channel=sys.argv[1])
frame = can.Message(arbitration_id={OTHERS_ID}, data=bytes(8), is_extended_id=False)
due_ns = time.monotonic_ns()
while True:
    due_ns = max(due_ns + {OTHERS_NS}, time.monotonic_ns() - 20_000_000)
    time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
    bus.send(frame)
"""


def half_loaded() -> str:
    """Return the spec of the flight."""
    text = shipped_spec_path("big_blue").read_text()
    for old, new in CHANGES.items():
        text = text.replace(old, new, 1)
        assert new in text
    return re.sub(r"rate_hz: ([\d.]+)", lambda found: f"rate_hz: {float(found[1]) / SLOWER}", text)


class Flight(Nodes):
    """The processes of a flight in which everything runs but one PE."""

    def __init__(self, can0: Path, folder: Path, radio: Path) -> None:
        super().__init__(can0, folder)
        self.beyond = Nodes(radio, folder)
        self.file = folder / "half.dg.yaml"
        self.file.write_text(half_loaded())
        self.spec = loads(half_loaded(), "half.dg.yaml")
        self.key = signing_key(folder)
        files = {"over_the_bus.py": CODE, "more.bin": Random(1).randbytes(100_000)}
        self.bundle = sign(pack("wings", 3, (IMAGE,), files), self.key).content
        (folder / "bundles").mkdir()
        (folder / "bundles" / "wings.bundle").write_bytes(self.bundle)

    def start_pe(self, pe: str, *words: str) -> None:
        buses = self.spec.pes[pe].buses
        if "can0" in buses:
            more = ["--bus", f"radio=softbus:{self.beyond.bus[-1]}"] if len(buses) > 1 else []
            self.agent(pe, "--simulated", *more, *words)
        else:
            self.beyond.agent(pe, "--simulated", "--bitrate", str(self.spec.buses["radio"].bitrate), *words)

    def take_off(self) -> Iterable[str]:
        """Start everything but the one PE; returns the events of the manager since a configuration runs."""
        self.start("other_equipment", "-c", OTHER_EQUIPMENT, self.bus[-1])
        for pe in self.spec.pes.keys() - {PE}:
            table = self.folder / f"{pe}.table"
            assert main(["table", str(self.file), pe, "-o", str(table), "--contingencies", "none"]) == 0
            self.start_pe(pe, "--table", str(table))
        manager = self.manager(str(self.file), "--bundles", str(self.folder / "bundles"))
        next_event(manager, events.Reconfigured)
        return manager

    def end(self) -> None:
        """End all processes on both buses."""
        super().end()
        self.beyond.end()


@pytest.fixture
def flight(tmp_path: Path) -> Iterator[Flight]:
    with (
        start_hub(tmp_path / "can0.sock", 1_000_000) as can0,
        start_hub(tmp_path / "radio.sock", 112_500) as radio,
        ended(Flight(can0.path, tmp_path, radio.path)) as flight,
    ):
        yield flight


def late(flight: Flight, frames: list[LoggedFrame]) -> dict[str, list[float]]:
    """By datum: how long after its deadline a frame of it left, in ms."""
    times_ns: dict[int, list[int]] = {}
    stood_still_ns, before_ns = 0, frames[0].time_ns
    for one in frames:
        silence_ns, before_ns = one.time_ns - before_ns, one.time_ns
        stood_still_ns += silence_ns if silence_ns > SILENCE_NS else 0
        times_ns.setdefault(one.frame.can_id, []).append(one.time_ns - stood_still_ns)
    found: dict[str, list[float]] = {}
    for (producer, variable), identifier in identifiers(flight.spec).items():
        period_ns = 10**12 // min(mode.rate_mhz for mode in flight.spec.modules[producer].modes.values())
        allowed_ns = period_ns + (flight.spec.variables[variable].deadline_ns or period_ns)
        gaps_ns = (after_ns - before_ns for before_ns, after_ns in pairwise(times_ns.get(identifier, ())))
        after_deadline = [(gap_ns - allowed_ns) / MS for gap_ns in gaps_ns if gap_ns > allowed_ns]
        if after_deadline:
            found[f"{variable} of {producer}"] = after_deadline
    return found


def took_in_the_simulator_ns(flight: Flight) -> int:
    code = CodeBundle("wings", 3, frozenset((IMAGE,)), flight.bundle)
    simulation = Simulation(flight.spec, 1, bundles=(code,))
    simulation.run_for(2_000 * MS)
    simulation.fleet.lacks(PE, MODULE)
    while not simulation.events_of(events.CodeBrought):
        assert simulation.now_ns < 90_000 * MS, simulation.events_of(events.CodeNotTaken)
        simulation.run_for(1_000 * MS)
    return simulation.events_of(events.CodeBrought)[0].took_ns


def brought(manager: Iterable[str]) -> tuple[events.CodeBrought, list[events.Event]]:
    """Wait for the code; returns also what may have ended a transfer before it was complete."""
    ended_early: list[events.Event] = []
    for told in events_in(manager):
        if isinstance(told, events.CodeBrought):
            return told, ended_early
        if isinstance(told, events.CodeNotTaken | events.PeLost | events.TableNotTaken):
            ended_early.append(told)
    raise AssertionError("the manager ended")


def test_code_comes_at_its_pace_and_no_datum_is_late(flight: Flight, capsys: pytest.CaptureFixture[str]) -> None:
    manager, recording = flight.take_off(), flight.folder / "recording"
    recorder = flight.start(
        "recorder", "-m", "heronry_tools.cli", "record", str(flight.file), "-o", str(recording), *flight.bus,
        "--for", "3600",
    )  # fmt: skip
    node = flight.spec.pes[PE].node_id
    flight.start_pe(
        PE, "--node", str(node), "--code-dir", str(flight.folder / "code"), "--code-key", f"{flight.key}.pub"
    )
    told, ended_early = brought(manager)
    next_event(manager, events.Reconfigured)
    runs = identifiers(flight.spec)[MODULE, "wing_state"]
    while not any(one.frame.can_id == runs for one in log_of(recording)):
        assert recorder.poll() is None
    recorder.send_signal(signal.SIGTERM)
    assert recorder.wait(PATIENCE_S) == 0
    flight.end()
    frames = [one for one in log_of(recording) if told.t_ns - told.took_ns <= one.time_ns <= told.t_ns]
    simulated_ns = took_in_the_simulator_ns(flight)
    with capsys.disabled():
        print(f"\n100 kB in {told.took_ns / 1e9:.1f} s; in the simulator {simulated_ns / 1e9:.1f} s")
    assert not ended_early, ended_early  # a computer that stands still for longer loses PEs: then no time is told
    assert sum(one.frame.can_id == sdo_request_id(node) for one in frames) * 7 >= len(flight.bundle)
    assert late(flight, frames) == {}
    held = range(frames[0].time_ns + 10**9, frames[0].time_ns + 3 * 10**9)
    data = frozenset(identifiers(flight.spec).values())
    without = [one for one in frames if one.time_ns not in held or one.frame.can_id not in data]
    assert late(flight, without)  # had other frames held the bus for 2 s, it would have been seen
    assert told.took_ns <= LONGEST * simulated_ns
