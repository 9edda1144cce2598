"""What the reserve of a bus holds, counted by hand (protocol rule 14)."""

from fractions import Fraction

import pytest

from heronry_dg.echo_rates import EchoRates
from heronry_dg.loader import load, loads
from heronry_dg.shipped import shipped_spec_path

SPEC = """
dg: 1
buses:
  can0: {{bitrate: 500000}}
  radio: {{kind: wireless, bitrate: {bitrate}, reserve: 0.2, heartbeat_ms: 200}}
pes:
  nose: {{node_id: 92, buses: [can0, radio], cpu: 1, ram: 8KiB, flash: 8KiB}}
  ground: {{node_id: 93, buses: [radio], cpu: 1, ram: 8KiB, flash: 8KiB}}
devices:
  gauge: {{kind: sensor, pe: nose}}
  lamp: {{kind: actuator, pe: ground}}
  horn: {{kind: actuator, pe: ground}}
  valve: {{kind: actuator, pe: nose}}
variables: {{level: {{type: FLOAT}}}}
modules:
  gauge_driver: {{device: gauge, gives: {{level: 1}}, cpu: 0.1, ram: 1KiB, rate_hz: 10}}
  lamp_driver: {{device: lamp, needs: level, cpu: 0.1, ram: 1KiB, rate_hz: 40}}
  horn_driver: {{device: horn, needs: level, cpu: 0.1, ram: 1KiB, rate_hz: 40}}
  valve_driver: {{device: valve, needs: level, cpu: 0.1, ram: 1KiB, rate_hz: 40}}
functions:
  shine: {{output: lamp_driver}}
  sound: {{output: horn_driver}}
  flow: {{output: valve_driver}}
"""


def rates(bitrate: int) -> EchoRates:
    return EchoRates(loads(SPEC.format(bitrate=bitrate), "x.dg.yaml"))


def test_what_management_sends_on_each_bus() -> None:
    wire, radio = (rates(50_000).by_bus[bus] for bus in ("can0", "radio"))
    assert radio.periodic == Fraction(4 * 135 * 1000, 200)  # LEASE, ALIVE and two states
    assert radio.passing == 0
    assert radio.heartbeats == 2 * 65
    assert radio.reports == 0  # the nose reports on the radio toward the manager alone
    assert radio.outputs == 2
    assert wire.periodic == Fraction(3 * 135 * 1000, 20)
    assert wire.passing == Fraction(135 * 1000, 200)  # the states of the ground, forwarded by the nose
    assert wire.heartbeats == 3 * 65  # of both PEs, and of the manager
    assert wire.reports == Fraction(135 * 1000, 200)
    assert wire.outputs == 3


@pytest.mark.parametrize(
    ("bitrate", "echoes_per_s"),
    [(50_000, 10), (27_650, 10), (27_649, 9), (16_850, 2), (15_500, 1), (10_000, 1)],
)
def test_the_rate_fills_the_reserve_and_is_one_to_ten(bitrate: int, echoes_per_s: int) -> None:
    """The rest of the radio takes 2 830 bit/s, and an echo of both outputs each second 270 bit/s."""
    found = rates(bitrate)
    assert found.by_bus["radio"].echoes_per_s == echoes_per_s
    assert (found.of("ground"), found.of("nose")) == (echoes_per_s, 10)
    fits = found.by_bus["radio"].total <= Fraction(2, 10) * bitrate
    assert fits == (bitrate >= 15_500)


def test_reports_cross_each_bus_on_their_way_to_the_manager() -> None:
    """Beyond the ground is another radio: its reports cross the first radio, and take room there that echoes had."""
    text = SPEC.format(bitrate=50_000).replace("buses: [radio]", "buses: [radio, rover]")
    rover = "  rover: {kind: wireless, bitrate: 50000, heartbeat_ms: 500}\npes:\n"
    found = EchoRates(loads(text.replace("pes:\n", rover), "x.dg.yaml"))
    assert [found.by_bus[bus].reports for bus in ("rover", "radio")] == [0, Fraction(135 * 1000, 500)]
    assert found.by_bus["can0"].reports == Fraction(135 * 1000, 500) + Fraction(135 * 1000, 200)
    short = SPEC.format(bitrate=27_650).replace("buses: [radio]", "buses: [radio, rover]")
    assert EchoRates(loads(short.replace("pes:\n", rover), "x.dg.yaml")).of("ground") == 9


@pytest.mark.parametrize("name", ["big_blue", "elevator_and_chute"])
def test_the_shipped_specs_have_room_for_ten_echoes_a_second(name: str) -> None:
    found = EchoRates(load(shipped_spec_path(name)))
    assert {found.of(pe) for pe in found.spec.pes} == {10}
