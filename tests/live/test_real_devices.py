"""One aircraft on a software bus whose devices are real to heronry: a server that speaks as gpsd, and files as of IIO.

Each of its sources is lost in turn, and in the end the PE: what `heronry plan` says is reached, and the actuator's
register holds the safe value.
"""

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_manager.events import FaultReported, PlanReady
from heronry_manager.events.line import to_object
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.fleet import Fleet, run_folder

pytestmark = pytest.mark.live
PATIENCE_S = 60.0
SPEC = """
dg: 1
name: two_heights
buses: {can0: {bitrate: 1000000, heartbeat_ms: 100}}
pes:
  nav: {node_id: 92, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}
  tail: {node_id: 93, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}
devices:
  gps: {kind: sensor, pe: nav, stale_ms: 1000}
  probe: {kind: sensor, pe: nav, stale_ms: 1000, range: [0, 3300]}
  servo: {kind: actuator, pe: tail, limits: [0, 2000], safe: 7}
variables:
  height: {type: FLOAT, unit: m, versions: 2}
modules:
  receiver: {image: 'two_heights:Receiver', device: gps, gives: {height: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  reader: {image: 'two_heights:Reader', device: probe, gives: {height: 2}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  mover:
    image: 'two_heights:Mover'
    device: servo
    needs: {xor: ['height@1', 'height@2']}
    cpu: 0.1
    ram: 1KiB
    rate_hz: 10
functions:
  move: {output: mover, criticality: A}
"""
CODE = """
from heronry_agent.module import Module


class Receiver(Module):
    def step(self, inputs):
        position = self.ctx.read()
        return {} if position is None else {"height": position[2] / 1000}


class Reader(Module):
    def step(self, inputs):
        height = self.ctx.read()
        return {} if height is None else {"height": height}


class Mover(Module):
    def step(self, inputs):
        height = inputs.get("height")
        if height is not None:
            self.ctx.write(height.number())
        return {}
"""


class TalkingGpsd:
    """A server that answers a WATCH as gpsd does, ten times a second."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        self._server.settimeout(0.1)
        while not self._ends.is_set():
            with suppress(OSError):
                connection, _ = self._server.accept()
                with connection:
                    while not self._ends.wait(0.1):
                        fix = {"class": "TPV", "mode": 3, "lat": 38.0, "lon": -84.5, "altMSL": 300.0}
                        connection.sendall(json.dumps(fix).encode() + b"\n")

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self._server.close()


class Aircraft:
    """Its files, processes and events."""

    def __init__(self, folder: Path, gpsd: TalkingGpsd, fleet: Fleet, events: AwaitedEvents) -> None:
        self.probe, self._register = (
            folder / "iio:device0" / "in_voltage_raw",
            folder / "iio:device1" / "out_voltage_raw",
        )
        self.gpsd, self.fleet, self.events = gpsd, fleet, events

    def register(self) -> str:
        return self._register.read_text()

    def until_told(self, element: str) -> None:
        while to_object(self.events.wait(FaultReported))["element"] != element:
            pass

    def until_planned_without(self, *down: str) -> PlanReady:
        while set(down) - set((ready := self.events.wait(PlanReady)).plan.down):
            pass
        return ready


def until(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.01)


@pytest.fixture
def aircraft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Aircraft]:
    (tmp_path / "two_heights.py").write_text(CODE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for number, (name, channel) in enumerate((("adc081c", "in_voltage_raw"), ("ad5241", "out_voltage_raw"))):
        folder = tmp_path / f"iio:device{number}"
        folder.mkdir()
        (folder / "name").write_text(name)
        (folder / channel).write_text("290")
    gpsd = TalkingGpsd()
    root = str(tmp_path)
    drivers = {
        "gps": {"driver": "gpsd", "options": {"port": gpsd.port}},
        "probe": {"driver": "iio", "options": {"device": "adc081c", "channel": "in_voltage", "root": root}},
        "servo": {"driver": "iio_out", "options": {"device": "ad5241", "channel": "out_voltage", "root": root}},
    }
    (tmp_path / "devices.json").write_text(json.dumps(drivers))
    file = tmp_path / "two_heights.dg.yaml"
    file.write_text(SPEC)
    spec, folder = load(file), run_folder()
    try:
        with Fleet(spec, file, folder, devices=tmp_path / "devices.json") as fleet:
            fleet.start_buses(choose(spec, folder, {}, None, prefer_vcan=False))
            events = AwaitedEvents(fleet, fleet.start_manager())
            for pe in spec.pes:
                fleet.start_pe(pe)
            yield Aircraft(tmp_path, gpsd, fleet, events)
    finally:
        gpsd.close()


def test_a_lost_source_is_planned_around_and_an_agent_that_is_paused_or_killed_leaves_a_safe_register(
    aircraft: Aircraft,
) -> None:
    until(lambda: aircraft.register() == "300")
    aircraft.gpsd.close()
    aircraft.until_told("device:gps")
    assert "reader" in aircraft.until_planned_without("device:gps").plan.modules
    until(lambda: aircraft.register() == "290")
    aircraft.fleet.stop("tail")
    until(lambda: aircraft.register() == "7")
    aircraft.fleet.go_on("tail")
    until(lambda: aircraft.register() == "290")
    aircraft.probe.write_text("291")
    until(lambda: aircraft.register() == "291")
    aircraft.fleet.kill_pe("tail")
    until(lambda: aircraft.register() == "7")


def test_a_source_out_of_its_range_is_lost(aircraft: Aircraft) -> None:
    until(lambda: aircraft.register() == "300")
    aircraft.probe.write_text("5000")
    aircraft.gpsd.close()
    aircraft.until_told("device:gps")
    aircraft.until_told("device:probe")
    assert not aircraft.until_planned_without("device:gps", "device:probe").plan.modules
    until(lambda: aircraft.register() == "7")
