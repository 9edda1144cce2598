"""A replicated bus with real processes, on two software buses and on two vcans: wires are cut, one after the other."""

import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import yaml

from heronry_dg.loader import load
from heronry_manager import events
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.shell.control_client import call
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from heronry_tools.runtime.softbus.starter import HubProcess, start_hub
from heronry_tools.runtime.witness import Witness
from live.told_events import E

PATIENCE_S = 90.0
SPEC = Path("tests/scenarios/twin_wires.dg.yaml")
EVERYBODY = {"the manager", "front", "rear", "tail"}


def slow_spec(folder: Path, heartbeat_ms: int) -> Path:
    """The part of the aircraft that is on can0, slow enough for a computer that does other things too."""
    document = yaml.safe_load(SPEC.read_text())
    document["buses"] = {"can0": {"bitrate": 500000, "channels": 2, "heartbeat_ms": heartbeat_ms, "misses": 4}}
    del document["pes"]["belly"], document["devices"]["gps"], document["functions"]["altimeter"]
    document["pes"]["tail"]["buses"] = ["can0"]
    for module in ("gps_driver", "high_quality_altitude", "pressure_driver"):
        del document["modules"][module]
    for variable in ("gps_altitude", "absolute_pressure", "altitude"):
        del document["variables"][variable]
    for module in document["modules"].values():
        module["rate_hz"] = 10
    file = folder / "twin_wires.dg.yaml"
    file.write_text(yaml.safe_dump(document, sort_keys=False))
    return file


class Hubs:
    """Two software buses; a wire that is pulled is a hub that is killed."""

    heartbeat_ms = 250

    def __init__(self, folder: Path) -> None:
        self.places = [str(folder / f"wire{number}.sock") for number in (1, 2)]
        self.named = ("softbus", ",".join(self.places), 500_000)
        self._hubs: list[HubProcess] = [start_hub(place, 500_000) for place in self.places]

    def pull(self, channel: int) -> None:
        self._hubs[channel - 1].kill()

    def mend(self, channel: int) -> None:
        self._hubs[channel - 1] = start_hub(self.places[channel - 1], 500_000)

    def close(self) -> None:
        for hub in self._hubs:
            hub.close()


class Vcans:
    """vcan0 and vcan1; a wire that is pulled is an interface that is down."""

    heartbeat_ms = 500

    def __init__(self, _: Path) -> None:
        self.named = ("socketcan", "vcan0,vcan1", None)
        ip("add", "vcan1", "type", "vcan")
        ip("set", "vcan1", "up")

    def pull(self, channel: int) -> None:
        ip("set", f"vcan{channel - 1}", "down")

    def mend(self, channel: int) -> None:
        ip("set", f"vcan{channel - 1}", "up")

    def close(self) -> None:
        ip("del", "vcan1")
        ip("set", "vcan0", "up")


def ip(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True)


class Flight:
    """A manager and three PEs on two wires, and all their events and frames."""

    def __init__(self, folder: Path, wires: Hubs | Vcans, stack: ExitStack) -> None:
        self.wires, self.file = wires, slow_spec(folder, wires.heartbeat_ms)
        self.spec = load(self.file)
        self.events: list[events.Event] = []
        self.fleet = stack.enter_context(Fleet(self.spec, self.file, run_folder()))
        choices = choose(self.spec, self.fleet.folder, {}, wires.named)
        self.fleet.start_buses(choices)
        self._ear = stack.enter_context(Ear(choices["can0"], self.spec.buses["can0"]))
        self.witness = Witness(self.spec)
        self._stream = EventStream(self.fleet.start_manager())
        for pe in self.spec.pes:
            self.fleet.start_pe(pe)

    def until(self, what: str, holds: Any) -> None:
        """Let time pass until something holds."""
        until_s = time.monotonic() + PATIENCE_S
        while not holds():
            readers: list[Any] = [self._stream, *self._ear.readers]
            select.select(readers, [], [], 0.1)
            self.events += self._stream.take()
            for time_ns, frame in self._ear.hear():
                self.witness.see(time_ns, frame)
            words = self.fleet.ended()
            assert words is None, words
            assert time.monotonic() < until_s, f"waited for: {what}; told: {self.events[-20:]}"

    def kinds(self, *kinds: type[E]) -> list[E]:
        return [event for event in self.events if isinstance(event, kinds)]

    def told(self, kind: type[events.ChannelLost | events.ChannelBack], channel: str) -> set[str]:
        """The nodes that have reported that a channel is lost, or back."""
        return {event.by for event in self.kinds(kind) if event.channel == channel}

    def lacking(self) -> dict[str, list[str]]:
        """The nodes that lack a channel, by the status of the manager."""
        status = call(self.fleet.control_socket(), AskStatus()).status
        assert status is not None
        return dict(status["channels"])


on_vcan = [
    pytest.mark.vcan,
    pytest.mark.soak,  # a minute; test_lost_bus.py takes an interface down in every run
    pytest.mark.skipif(os.geteuid() != 0 or shutil.which("ip") is None, reason="it needs root and ip(8)"),
]


@pytest.fixture(params=[pytest.param(Hubs, marks=pytest.mark.live), pytest.param(Vcans, marks=on_vcan)])
def flight(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Flight]:
    with ExitStack() as stack:
        wires = request.param(tmp_path)
        stack.callback(wires.close)
        flight = Flight(tmp_path, wires, stack)
        flight.until("the first configuration", lambda: flight.kinds(events.Reconfigured))
        flight.until("the elevator", lambda: flight.witness.served("elevator", time.monotonic_ns()))
        yield flight


def test_pulling_a_wire_changes_nothing_but_the_report_and_pulling_both_loses_the_bus(flight: Flight) -> None:
    wires, begun_ns = flight.wires, time.monotonic_ns()
    wires.pull(2)
    flight.until("all nodes lack channel 2", lambda: flight.told(events.ChannelLost, "can0.2") == EVERYBODY)
    assert set(flight.lacking()["can0.2"]) == EVERYBODY
    wires.mend(2)
    flight.until("all nodes have channel 2", lambda: flight.told(events.ChannelBack, "can0.2") == EVERYBODY)
    wires.pull(1)
    flight.until("all nodes lack channel 1", lambda: flight.told(events.ChannelLost, "can0.1") == EVERYBODY)
    assert flight.lacking()["can0.2"] == []
    assert flight.kinds(events.PeLost, events.FaultReported, events.EpochAbandoned) == []
    assert len(flight.kinds(events.Reconfigured)) == len(flight.kinds(events.PlanRequested)) == 1
    assert flight.witness.served("elevator", time.monotonic_ns())
    long = [o for o in flight.witness.outages(time.monotonic_ns()) if o.from_ns > begun_ns and o.to_ns is None]
    assert long == []

    wires.pull(2)
    flight.until(
        "the manager has lost both",
        lambda: sum("is lost" in e.sentence for e in flight.kinds(events.BusTrouble)) >= 3,
    )
    time_of_loss_ns = time.monotonic_ns()
    flight.until("silence", lambda: not flight.witness.served("elevator", time.monotonic_ns()))
    lease_ns = 5 * flight.spec.buses["can0"].heartbeat_ns
    flight.until("longer than T_lease", lambda: time.monotonic_ns() > time_of_loss_ns + 2 * lease_ns)
    assert flight.kinds(events.PeLost) == [], "a manager that cannot receive declares no PE down"
    wires.mend(2)
    flight.until("they are new incarnations", lambda: len({e.pe for e in flight.kinds(events.PeLost)}) == 3)
    flight.until("all is as it was", lambda: flight.kinds(events.Reconfigured)[1:] and not flight.lacking()["can0.2"])
