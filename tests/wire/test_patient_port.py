"""Frames that wake nobody: they wait in a socket of their own, and are read when the node wakes for something else."""

import select
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from heronry_tools.runtime.softbus.starter import start_hub
from heronry_wire.bus_opening import LinkError
from heronry_wire.frame import Frame
from heronry_wire.frame_port import Arrival
from heronry_wire.link import REOPEN_NS, Link
from heronry_wire.patient_port import PatientPort

DATUM, OTHER_DATUM, COMMAND, OWN = 300, 301, 100, 299
PATIENCE_S, MOMENT_S = 10.0, 0.05


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Path]:
    with closing(start_hub(str(tmp_path / "can0.sock"), 1_000_000)):
        yield tmp_path / "can0.sock"


@pytest.fixture
def bus(hub: Path) -> Iterator["TwoNodes"]:
    with TwoNodes(hub) as both:
        yield both


class TwoNodes(ExitStack):
    """A node that is patient with data, and another one that sends."""

    def __init__(self, hub: Path) -> None:
        super().__init__()
        config = {"interface": "softbus", "channel": str(hub)}
        self.node, self.other = Link(config), Link(config)
        self.enter_context(closing(self.node))
        self.enter_context(closing(self.other))
        self.node.be_patient()
        self.node.accept({DATUM, OTHER_DATUM, COMMAND}, patient=frozenset((DATUM, OTHER_DATUM)))

    def say(self, *identifiers: int) -> None:
        """Let the other node send frames, and wait until all have left."""
        for one in identifiers:
            self.other.send(Frame(one, b"x"), time.monotonic_ns())
        while not self.other.all_left:
            select.select([self.other], [], [], PATIENCE_S)
            self.other.receive(time.monotonic_ns())

    def is_woken(self, within_s: float) -> bool:
        return bool(select.select([self.node], [], [], within_s)[0])

    def taken(self) -> list[Arrival]:
        return self.node.receive(time.monotonic_ns())

    def all_of(self, number: int) -> list[int]:
        """Read until `number` frames have come; returns their identifiers."""
        until_s, found = time.monotonic() + PATIENCE_S, []
        while len(found) < number and time.monotonic() < until_s:
            found += [arrival.frame.can_id for arrival in self.taken()]
        return found


def test_a_patient_frame_wakes_nobody_and_is_there_when_the_node_reads(bus: TwoNodes) -> None:
    assert bus.node.is_patient
    bus.say(DATUM, OTHER_DATUM)
    assert not bus.is_woken(MOMENT_S)
    assert bus.all_of(2) == [DATUM, OTHER_DATUM]
    bus.say(COMMAND)
    assert bus.is_woken(PATIENCE_S)
    assert bus.all_of(1) == [COMMAND]


def test_frames_of_both_sockets_come_in_the_order_of_their_arrival(bus: TwoNodes) -> None:
    for one in (DATUM, COMMAND, OTHER_DATUM, COMMAND):
        bus.say(one)
    time.sleep(MOMENT_S)
    arrivals = bus.taken()
    assert [arrival.frame.can_id for arrival in arrivals] == [DATUM, COMMAND, OTHER_DATUM, COMMAND]
    assert [arrival.time_ns for arrival in arrivals] == sorted(arrival.time_ns for arrival in arrivals)


def test_what_is_patient_may_change_and_nothing_is_taken_twice_for_long(bus: TwoNodes) -> None:
    bus.node.accept({DATUM, COMMAND}, patient=frozenset((COMMAND,)))
    bus.say(COMMAND, OTHER_DATUM)
    assert not bus.is_woken(MOMENT_S)
    assert bus.all_of(1) == [COMMAND]
    bus.say(DATUM)
    assert bus.is_woken(PATIENCE_S)
    assert bus.all_of(1) == [DATUM]
    bus.node.accept({COMMAND})
    bus.say(DATUM, COMMAND)
    assert bus.is_woken(PATIENCE_S)
    assert bus.all_of(1) == [COMMAND]
    time.sleep(MOMENT_S)
    assert bus.taken() == []


def test_the_echo_of_an_own_frame_is_never_patient(bus: TwoNodes) -> None:
    bus.node.accept({DATUM, OWN}, patient=frozenset((DATUM, OWN)))
    bus.node.send(Frame(OWN, b"mine"), time.monotonic_ns())
    assert bus.is_woken(PATIENCE_S)
    while not bus.node.all_left:
        assert bus.taken() == []


def test_a_flood_of_patient_frames_is_read_in_turns(bus: TwoNodes) -> None:
    bus.say(*[DATUM] * 200)
    time.sleep(MOMENT_S)
    first = bus.taken()
    assert bus.node.has_more
    assert len(first) < 200
    assert len(first) + len(bus.all_of(200 - len(first))) == 200


def test_a_bus_that_is_back_is_patient_again(tmp_path: Path) -> None:
    path = tmp_path / "can0.sock"
    with closing(start_hub(str(path), 1_000_000)) as first, TwoNodes(path) as bus:
        first.close()
        while bus.node.is_open:
            bus.is_woken(PATIENCE_S)
            bus.taken()
        assert not bus.node.is_patient
        with closing(start_hub(str(path), 1_000_000)):
            for link in (bus.node, bus.other):
                link.receive(time.monotonic_ns())
                link.pump(time.monotonic_ns() + 2 * REOPEN_NS)
            assert bus.node.is_patient
            bus.say(DATUM)
            assert not bus.is_woken(MOMENT_S)
            assert bus.all_of(1) == [DATUM]


def test_a_bus_that_cannot_be_opened_twice_is_an_error_and_nothing_stays_open(
    hub: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(LinkError, match="no bus answers there"):
        PatientPort({"interface": "softbus", "channel": str(hub.with_name("none.sock"))})
    monkeypatch.setattr("heronry_wire.patient_port.port_of", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        PatientPort({"interface": "softbus", "channel": str(hub)})
