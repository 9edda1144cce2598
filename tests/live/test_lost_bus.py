"""Faults of an agent's bus: the agent stays up, reports the fault once, and comes back.

On a software bus, on vcan, and on an interface with a controller of its own (`serial_adapter`).
"""

import os
import select
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import can
import pytest

from agent.one_pe import DEMAND_ID, NODE
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_wire.can_interface import read_interface
from heronry_wire.controller import ControllerState
from heronry_wire.identifiers import heartbeat_id, state_id
from heronry_wire.link import Link
from heronry_wire.state_frames import PeState, StatePage0
from live.serial_adapter import NoAdapterError, SerialAdapter
from live.test_agent_process import PATIENCE_S, Ground

needs_root = pytest.mark.skipif(os.geteuid() != 0 or shutil.which("ip") is None, reason="it needs root and ip(8)")
ON_VCAN = [pytest.mark.vcan, needs_root]
LONG_ON_VCAN = [*ON_VCAN, pytest.mark.soak]


def ip(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True)


def end_the_hub(ground: Ground) -> None:
    ground.hub.kill()


def start_the_hub(ground: Ground) -> None:
    ground.hub = start_hub(ground.place["channel"], 1_000_000)


def take_it_down(_: Ground) -> None:
    ip("set", "vcan0", "down")


def bring_it_up(_: Ground) -> None:
    ip("set", "vcan0", "up")


def unplug_it(_: Ground) -> None:
    ip("del", "vcan0")


def plug_it_in(_: Ground) -> None:
    ip("add", "vcan0", "type", "vcan")
    ip("set", "vcan0", "up")


class Log:
    """What an agent has said so far on standard error."""

    def __init__(self, ground: Ground) -> None:
        self._agent = ground.start("--state-dir", str(ground.folder / "state"))
        assert self._agent.stderr is not None
        self._descriptor, self._unread = self._agent.stderr.fileno(), b""

    def until(self, word: str) -> list[str]:
        """Read on until a line has this word."""
        lines: list[str] = []
        while not lines or word not in lines[-1]:
            line, newline, rest = self._unread.partition(b"\n")
            if newline:
                lines.append(line.decode())
                self._unread = rest
                continue
            assert select.select([self._descriptor], [], [], PATIENCE_S)[0], f"it does not write {word!r}: {lines}"
            chunk = os.read(self._descriptor, 65536)
            assert chunk, f"it ended before it wrote {word!r}: {lines}"
            self._unread += chunk
        return lines

    def end(self) -> str:
        """Stop it; all that it had still to say."""
        self._agent.send_signal(signal.SIGTERM)
        _, rest = self._agent.communicate(timeout=PATIENCE_S)
        assert self._agent.returncode == 0
        return str(rest)


def hear_a_new_incarnation(ground: Ground, before: StatePage0) -> None:
    ground.hear(lambda frame: frame.can_id == heartbeat_id(NODE) and frame.data == b"\x00")
    page = ground.hear_page_0()
    assert page.incarnation == (before.incarnation + 1) % 256
    assert page.state is PeState.UNCONFIGURED


@pytest.fixture
def ground(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Ground]:
    ground = Ground(tmp_path, request.param)
    yield ground
    ground.close()


@pytest.mark.parametrize(
    ("ground", "lose", "restore", "reason"),
    [
        pytest.param("softbus", end_the_hub, start_the_hub, "start one with", marks=pytest.mark.live, id="hub"),
        pytest.param("socketcan", take_it_down, bring_it_up, "the interface is down", marks=ON_VCAN, id="down"),
        pytest.param("socketcan", unplug_it, plug_it_in, "the interface is down", marks=LONG_ON_VCAN, id="unplugged"),
    ],
    indirect=["ground"],
)
def test_a_lost_bus_is_reported_and_when_it_is_back_the_pe_is_a_new_incarnation(
    ground: Ground, lose: Callable[[Ground], None], restore: Callable[[Ground], None], reason: str
) -> None:
    agent = Log(ground)
    before = ground.hear_page_0()
    ground.configure()
    ground.hear(lambda frame: frame.can_id == DEMAND_ID)
    lose(ground)
    told = agent.until("is lost")[-1]
    assert told.count("is lost") == 1
    ground.bus.shutdown()
    restore(ground)
    ground.bus = can.Bus(**ground.place, ignore_config=True)
    hear_a_new_incarnation(ground, before)
    said = "".join([told, *agent.until("is back after")])
    assert reason in said
    assert "is lost" not in agent.end()


@pytest.mark.parametrize("ground", [pytest.param("softbus", marks=pytest.mark.live)], indirect=True)
def test_a_pe_whose_node_id_was_taken_meanwhile_stays_silent_until_it_is_free(ground: Ground) -> None:
    agent = Log(ground)
    before = ground.hear_page_0()
    end_the_hub(ground)
    agent.until("is lost")
    ground.bus.shutdown()
    start_the_hub(ground)
    ground.bus = can.Bus(**ground.place, ignore_config=True)
    usurper = can.Message(arbitration_id=state_id(NODE), is_extended_id=False, data=bytes(8))
    task = ground.bus.send_periodic(usurper, 0.01)
    agent.until(f"another node has taken node-ID {NODE}")
    task.stop()
    hear_a_new_incarnation(ground, before)
    agent.end()


@pytest.mark.timing
@pytest.mark.parametrize("ground", [pytest.param("softbus", marks=pytest.mark.live)], indirect=True)
def test_a_flood_of_frames_that_it_must_read_stops_no_heartbeat(ground: Ground) -> None:
    """A neighbour's state frames, as fast as the bus takes them: they outrank those of this PE, and leave it gaps."""
    agent = Log(ground)
    before = ground.hear_page_0()
    flood = can.Message(arbitration_id=state_id(NODE - 1), is_extended_id=False, data=bytes(8))
    own = [{"can_id": state_id(NODE), "can_mask": 0x7FF}]
    heard = 0
    with can.Bus(**ground.place, ignore_config=True, can_filters=own) as listener:
        for _ in range(4000):
            ground.bus.send(flood, PATIENCE_S)
            heard += listener.recv(0) is not None
    assert heard
    while ground.bus.recv(0) is not None:
        pass
    assert ground.hear_page_0().incarnation == before.incarnation
    assert "lost" not in agent.end()


@pytest.mark.parametrize("ground", [pytest.param("socketcan", marks=LONG_ON_VCAN)], indirect=True)
@pytest.mark.skipif(shutil.which("tc") is None, reason="it needs tc(8)")
def test_a_queue_that_takes_nothing_is_waited_out(ground: Ground) -> None:
    """A queue of length 0 answers every frame with ENOBUFS. In every run the adapter that stalls does."""
    agent = Log(ground)
    before = ground.hear_page_0()
    subprocess.run(["tc", "qdisc", "replace", "dev", "vcan0", "root", "pfifo", "limit", "0"], check=True)
    try:
        agent.until("gets nothing out")
    finally:
        subprocess.run(["tc", "qdisc", "del", "dev", "vcan0", "root"], check=True)
    while ground.bus.recv(0) is not None:
        pass
    assert ground.hear_page_0().incarnation == before.incarnation
    agent.end()


@pytest.mark.vcan
def test_frames_that_the_kernel_had_to_drop_are_counted() -> None:
    """No process reads them while they come; Linux keeps a few hundred."""
    place = {"interface": "socketcan", "channel": "vcan0"}
    with closing(Link(place)) as link, can.Bus(**place, ignore_config=True) as bus:
        for number in range(2000):
            bus.send(can.Message(arbitration_id=number, is_extended_id=False))
        taken = 0
        while arrivals := link.receive(time.monotonic_ns()):
            taken += len(arrivals)
        assert taken + link.health.counts["frames not taken in time"] == 2000
        assert taken < 2000
        assert "some are lost" in link.health.take_link_events()[0]


# An interface with a controller


@pytest.fixture
def adapter() -> Iterator[SerialAdapter]:
    try:
        adapter = SerialAdapter()
    except NoAdapterError as error:
        pytest.skip(f"no serial adapter here: {error}")
    with adapter:
        adapter.set_up(1_000_000)
        yield adapter


@pytest.fixture
def wire(adapter: SerialAdapter, tmp_path: Path) -> Iterator[Ground]:
    ground = Ground(tmp_path, "socketcan", adapter.name)
    yield ground
    ground.close()


@pytest.mark.vcan
@needs_root
def test_a_controller_that_goes_bus_off_is_reported_and_restarted_and_the_pe_begins_anew(
    wire: Ground, adapter: SerialAdapter
) -> None:
    agent = Log(wire)
    before = wire.hear_page_0()
    adapter.reports(b"sp000130")
    agent.until("error-passive")
    adapter.reports(b"sb000255")
    agent.until("its controller is bus-off")
    agent.until("is back after")
    interface = read_interface(adapter.name)
    assert interface is not None
    assert interface.state is ControllerState.ERROR_ACTIVE
    wire.bus.shutdown()  # the interface was down for a moment, and our own place with it
    wire.bus = can.Bus(**wire.place, ignore_config=True)
    until_s = time.monotonic() + PATIENCE_S
    while wire.hear_page_0().incarnation == before.incarnation:
        assert time.monotonic() < until_s
    agent.end()


@pytest.mark.vcan
@needs_root
def test_another_bit_rate_is_refused_and_in_flight_waited_out(wire: Ground, adapter: SerialAdapter) -> None:
    agent = Log(wire)
    wire.hear_page_0()
    adapter.set_up(500_000)
    agent.until("the interface runs at 500000 bit/s, and this bus at 1000000")
    second = wire.start()
    _, said = second.communicate(timeout=PATIENCE_S)
    assert second.returncode == 2
    assert f"'ip link set {adapter.name} down && ip link set {adapter.name} up type can bitrate 1000000'" in said
    adapter.set_up(1_000_000)
    agent.until("is back after")
    agent.end()


@pytest.mark.vcan
@needs_root
def test_an_adapter_that_stalls_fills_its_queue_and_nothing_else(wire: Ground, adapter: SerialAdapter) -> None:
    """Its queue of ten frames runs full: ENOBUFS, as on any controller whose frames no node acknowledges."""
    agent = Log(wire)
    before = wire.hear_page_0()
    adapter.stall()
    agent.until("gets nothing out")
    adapter.go_on()
    while wire.bus.recv(0) is not None:
        pass
    assert wire.hear_page_0().incarnation == before.incarnation
    agent.end()
