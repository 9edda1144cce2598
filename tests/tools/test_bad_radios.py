"""Faults of radios in flights of real processes: the faults of a script, injected into a hub at their times."""

from pathlib import Path

import can
import pytest

from heronry_tools.runtime.softbus.client import SoftBus
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_tools.sim.scenario.bad_radios import BadRadios, Disturbance, disturbance
from heronry_tools.sim.scenario.script import Deed, read_script

S = 1_000_000_000
SCENARIO = Path("tests/scenarios/the_ground_flies_it_until_the_radio_fades.scenario")


@pytest.fixture
def deeds() -> tuple[Deed, ...]:
    """30 % loss from 2 s on, a tenth of the bandwidth from 7 s on, nothing from 11 s to 15 s."""
    return read_script(SCENARIO).deeds


@pytest.mark.parametrize(
    ("at_s", "found"),
    [
        (1.9, Disturbance()),
        (2, Disturbance(1, 300)),
        (6.9, Disturbance(1, 300)),
        (7, Disturbance(10, 0)),
        (11, Disturbance(1, 1000)),
        (14.95, Disturbance(1, 1000)),
        (15, Disturbance()),
    ],
)
def test_what_a_bus_is_like_follows_from_the_time(at_s: float, found: Disturbance, deeds: tuple[Deed, ...]) -> None:
    assert disturbance(deeds, round(at_s * S)) == found


def test_the_hub_follows_the_script(deeds: tuple[Deed, ...], tmp_path: Path) -> None:
    with (
        start_hub(tmp_path / "radio") as hub,
        SoftBus(str(hub.path), receive_own_messages=True) as sender,
        SoftBus(str(hub.path)) as receiver,
    ):
        with BadRadios(deeds, {"radio": str(hub.path)}) as radios:
            assert radios.next_ns(0) == 2 * S
            assert radios.next_ns(14 * S) == round(14.9 * S)
            assert radios.next_ns(15 * S) is None
            radios.follow(12 * S)
            radios.follow(13 * S)
            sender.send(can.Message(arbitration_id=0x123))
            assert sender.recv(10) is not None  # its echo: it has left before the radio is a good one again
            radios.follow(16 * S)
            sender.send(can.Message(arbitration_id=0x124))
        received = receiver.recv(10)
        assert received is not None
        assert received.arbitration_id == 0x124


def test_buses_that_nothing_is_done_to_are_left_alone() -> None:
    kill = Deed(1, S, "kill", "pe:ground", "kill pe:ground")
    with BadRadios((kill,), {"radio": "/nowhere"}) as radios:
        assert radios.next_ns(0) is None
        radios.follow(0)
