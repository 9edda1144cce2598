"""Flights in real time: what plant process and devices share, and one short flight with processes."""

import json
import socket
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main
from heronry_tools.console.errors import UserError
from heronry_tools.fly.latency import LatencyProbe
from heronry_tools.fly.live.driver import COMMANDS, FOLDER, READINGS, FlightDriver
from heronry_tools.fly.live.flight import _Flight, fly_live
from heronry_tools.fly.live.plant_process import HELD
from heronry_tools.fly.live.plant_process import main as plant_process
from heronry_tools.fly.live.shared_readings import Reader, Snapshot, Writer
from heronry_tools.fly.mission import Mission

NOW_NS = 5_000_000_000


def snapshot(time_ns=NOW_NS, **readings):
    return Snapshot(time_ns, 12.5, readings, frozenset({"elevator_1"}))


@pytest.fixture
def writer(tmp_path):
    return Writer(tmp_path / READINGS)


@pytest.fixture
def commands(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / COMMANDS))
        yield listener


@pytest.fixture
def driver(tmp_path, writer, commands):
    writer.write(snapshot(pitot_1=17.5, ins_1=(1, 2, 3), gps=None))
    made = FlightDriver(0, {FOLDER: str(tmp_path)})
    yield made
    made.close()


def test_what_was_written_last_is_read(tmp_path, writer):
    for count in range(20):
        writer.write(snapshot(pitot_1=float(count), ins_1=(count, -count)))
        assert Reader(tmp_path / READINGS).newest().readings == {"pitot_1": float(count), "ins_1": (count, -count)}


def test_a_file_without_a_snapshot_is_not_there(tmp_path, writer):
    with pytest.raises(FileNotFoundError):
        Reader(tmp_path / READINGS)


def test_readings_that_do_not_fit_are_refused(writer):
    with pytest.raises(ValueError, match="too many for a slot"):
        writer.write(snapshot(**{f"device_{i}": "x" * 100 for i in range(50)}))


def test_a_device_reads_and_a_dead_one_does_not(driver):
    assert driver.open("pitot_1").read(NOW_NS) == (17.5, NOW_NS, True)
    assert driver.open("ins_1").read(NOW_NS).value == (1, 2, 3)
    assert driver.open("gps").read(NOW_NS) == (None, NOW_NS, False)


def test_readings_of_a_plant_process_that_is_gone_are_none(driver):
    assert driver.open("pitot_1").read(NOW_NS + 600_000_000).value is None


def test_a_command_reaches_the_plant_process_and_a_stuck_servo_takes_none(driver, commands):
    assert driver.open("aileron_1").command(3.5, NOW_NS) == 3.5
    assert json.loads(commands.recv(4096)) == ["aileron_1", 3.5]
    assert driver.open("elevator_1").command(3.5, NOW_NS) is None
    driver.open("aileron_1").make_safe(NOW_NS)
    assert driver.follows(["ins_1"]) == frozenset()


def test_without_a_listener_a_command_is_not_taken(driver, commands):
    commands.close()
    assert driver.open("aileron_1").command(3.5, NOW_NS) is None


MISSION = {"seed": 1, "wind": 3.0, "corrections_lost_s": None, "longest_s": 0.5, "probed": False, "record": None}


def test_a_flight_that_cannot_go_on_ends_with_one_sentence(tmp_path, monkeypatch, capsys):
    def diverge():
        raise UserError("the flight model has diverged")

    diverging = SimpleNamespace(run=diverge)
    monkeypatch.setattr("heronry_tools.fly.live.plant_process.PlantProcess", lambda *_: diverging)
    monkeypatch.setattr(sys, "argv", ["plant_process", str(tmp_path), json.dumps(MISSION)])
    plant_process()
    said = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    plant = SimpleNamespace(said=lambda _: said)
    with pytest.raises(UserError, match="the flight model has diverged"):
        _Flight(None, plant, None, Mission(), None).run()


def test_the_plant_process_waits_for_the_first_command_and_tells_how_it_ended(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "heronry_tools.fly.live.plant_process", str(tmp_path), json.dumps(MISSION)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with process:
        while not (tmp_path / READINGS).exists():
            assert process.poll() is None
            time.sleep(0.02)
        devices = FlightDriver(0, {FOLDER: str(tmp_path)})
        height_m = devices.reader.newest().height_m
        time.sleep(0.1)
        assert devices.reader.newest().height_m == height_m, "it waits"
        assert {name: devices.reader.newest().readings[name] for name in HELD} == HELD
        process.stdin.write('{"fail": "aileron_1", "how": "stuck"}\n')
        process.stdin.flush()
        for servo in ("elevator_1", "aileron_2", "rudder_1", "throttle_2"):
            devices.open(servo).command(0.5, NOW_NS)
        assert "released_ns" in json.loads(process.stdout.readline())
        end = json.loads(process.stdout.readline())
        assert end["causes"] == ["not landed"]
        assert devices.reader.newest().height_m != height_m
        assert devices.reader.newest().refusing == {"aileron_1"}
        devices.close()


def test_the_probe_counts_from_the_sample_to_the_command():
    probe = LatencyProbe()
    assert probe.offset_deg_per_s(1_000_000_000) == 0.0
    probe.commanded("elevator_1", 0.0, 2_900_000_000)
    assert probe.offset_deg_per_s(3_000_000_000) == 10.0
    probe.commanded("aileron_1", 5.0, 3_010_000_000)
    probe.commanded("elevator_1", 0.1, 3_020_000_000)
    probe.commanded("elevator_1", 1.6, 3_045_000_000)
    probe.commanded("elevator_1", 5.6, 3_070_000_000)
    assert probe.latencies_ns == [45_000_000]
    assert probe.offset_deg_per_s(3_500_000_000) == 0.0
    assert probe.offset_deg_per_s(4_000_000_000) == 10.0
    assert probe.unanswered == 1


@pytest.mark.parametrize("option", ["--compiled", "--judged", "--must-land"])
def test_what_real_time_cannot_do_is_said(option, capsys):
    assert main(["fly", "eav", "--live", option]) == 2
    assert "leave --live out" in capsys.readouterr().err


def test_a_bus_cannot_be_killed_in_real_time(capsys):
    assert main(["fly", "eav", "--live", "--kill", "bus:radio@10m"]) == 2
    assert "only a PE or a device can be killed; write a bus fault with --act" in capsys.readouterr().err


def test_in_real_time_only_a_bus_can_be_disturbed(capsys):
    assert main(["fly", "eav", "--live", "--act", "3 pause pe:nav_a for 0.3"]) == 2
    assert "with --live only these faults can be injected" in capsys.readouterr().err


@pytest.mark.live
def test_a_fleet_of_processes_flies():
    path = shipped_spec_path("eav")
    end = fly_live(load(path), path, Mission(seed=1, longest_s=2.0))
    assert end["causes"] == ["not landed"]
    assert end["places"]["flight_management"].endswith("(precise)")
