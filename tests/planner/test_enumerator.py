"""Brute force gives the known answers: for the paper's Figure 3, and for specs small enough to count by hand."""

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load, loads
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from planner.enumerator import Enumerator, TooManyError, ways_to_hold

FIGURE_3 = load(shipped_spec_path("elevator_and_chute"))


def best(*down: str) -> Configuration:
    return Enumerator(FIGURE_3, situation(FIGURE_3, down)).best()[1]


def fed_with(configuration: Configuration, module: str) -> dict[str, tuple[str, int]]:
    """What each wired input of a module is fed with."""
    inputs = configuration.modules[module].inputs.values()
    return {wire.variable: (wire.producer, wire.version) for wire in inputs}


def test_figure_3_with_nothing_down() -> None:
    whole = best()
    assert {"servo_driver_1", "chute_driver", "servo_monitor"} <= whole.modules.keys()
    assert whole.modules["high_quality_altitude"].mode == "fused"
    assert not {"low_quality_altitude", "servo_driver_2"} & whole.modules.keys()


@pytest.mark.parametrize(
    ("down", "altitude"),
    [
        (["device:gps"], ("low_quality_altitude", 3)),
        (["device:barometer"], ("high_quality_altitude", 2)),
        (["device:gps", "device:barometer"], None),
    ],
)
def test_figure_3_takes_the_altitude_that_is_left(down: list[str], altitude: tuple[str, int] | None) -> None:
    fed = fed_with(best(*down), "chute_logic")
    assert fed.get("altitude") == altitude
    assert fed["release_command"] == ("release_driver", 1)


def test_figure_3_changes_to_the_other_servo() -> None:
    assert "servo_driver_2" in best("device:elevator_servo_1").modules


def test_figure_3_without_its_tail_keeps_the_parachute() -> None:
    rest = best("pe:tail_pe").modules
    assert "chute_driver" in rest
    assert not {"servo_driver_1", "servo_driver_2"} & rest.keys()


COUNTED = """
dg: 1
buses: {can0: {bitrate: 500000}}
pes:
  one: {node_id: 92, buses: [can0], cpu: 0.2, ram: 1KiB, flash: 1KiB}
  two: {node_id: 93, buses: [can0], cpu: 0.2, ram: 1KiB, flash: 1KiB}
variables: {a: {type: FLOAT, versions: 2}, b: {type: FLOAT}}
modules:
  first: {gives: {a: 1}, cpu: 0.1, ram: 0, rate_hz: 10}
  second: {gives: {a: 2, b: 1}, cpu: 0.1, ram: 0, rate_hz: 10}
  user: {needs: {or: {k: 0, of: [a, b]}}, cpu: 0.1, ram: 0, rate_hz: 10}
functions: {use: {output: user}}
"""


def count(text: str) -> int:
    spec = loads(text, "counted.dg.yaml")
    return sum(1 for _ in Enumerator(spec, situation(spec)).every(most=1000))


def test_every_configuration_is_found_once() -> None:
    # Nothing; the user alone (2 places); with a from first (4); with a, b, or both from second (3 x 4); with a from
    # first and b from second: of 8 placements 2 put all three on one PE, which holds two.
    assert count(COUNTED) == 1 + 2 + 4 + 12 + 6
    assert count(COUNTED.replace("k: 0", "k: 1")) == 1 + 4 + 12 + 6
    assert count(COUNTED.replace("k: 0", "k: 2")) == 1 + 4 + 6
    assert count(COUNTED + "together: [[first, user]]") == 1 + 2 + 2 + 12 + 2
    assert count(COUNTED + "separate: [[first, user]]") == 1 + 2 + 2 + 12 + 4


def test_it_says_when_there_are_too_many() -> None:
    spec = loads(COUNTED, "counted.dg.yaml")
    with pytest.raises(TooManyError):
        list(Enumerator(spec, situation(spec)).every(most=24))


def test_the_ways_in_which_a_nested_gate_can_hold() -> None:
    needs = FIGURE_3.modules["chute_logic"].modes["only"].needs
    assert set(ways_to_hold(needs)) == {
        frozenset(),
        frozenset({"0.0"}),
        frozenset({"0.1"}),
        frozenset({"1"}),
        frozenset({"0.0", "1"}),
        frozenset({"0.1", "1"}),
    }
