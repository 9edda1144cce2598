"""What remains of a system after faults: routes, gateways, replicated buses, the manager's bus, smaller capacities."""

from fractions import Fraction

import pytest

from heronry_dg.loader import load, loads
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, Survivors, UnknownElementError, elements, places, situation, survivors

# A chain: nose, bus `can0`, mid, bus `can1` (doubled), tail, wireless bus `radio`, ground.
FLEET = loads(
    """
dg: 1
buses:
  can0: {bitrate: 500000}
  can1: {bitrate: 125000, channels: 2, max_load: 0.7, reserve: 0.2}
  radio: {bitrate: 50000, kind: wireless}
manager: {bus: can1}
pes:
  nose: {node_id: 92, buses: [can0], cpu: 0.333, ram: 1KiB, flash: 1KiB}
  mid: {node_id: 93, buses: [can0, can1], cpu: 1, ram: 1KiB, flash: 1KiB, features: [fpu]}
  tail: {node_id: 94, buses: [can1, radio], cpu: 1, ram: 1KiB, flash: 1KiB}
  ground: {node_id: 95, buses: [radio], cpu: 4, ram: 1KiB, flash: 1KiB, features: [fpu]}
devices: {gps: {kind: sensor, pe: nose}}
variables: {position: {type: FLOAT}}
modules:
  receiver: {device: gps, gives: {position: 1}, cpu: 0, ram: 0, rate_hz: 1}
  filter: {needs: position, requires: [fpu], cpu: 0, ram: 0, rate_hz: 1}
functions: {navigation: {output: filter}}
phases: {climb: {}, glide: {}}
""",
    "fleet.dg.yaml",
)


def left(*down: str, limits: list[str] | None = None) -> Survivors:
    return survivors(FLEET, situation(FLEET, down, limits or []))


def test_with_nothing_down_everything_is_there() -> None:
    whole = left()
    assert list(whole.pe_cpu_millis) == ["nose", "mid", "tail", "ground"]
    assert whole.bus_mbit_per_s == {"can0": 350_000_000, "can1": 62_500_000, "radio": 35_000_000}
    assert whole.route("nose", "ground") == ("can0", "can1", "radio")
    assert whole.route("ground", "nose") == ("radio", "can1", "can0")
    assert whole.route("mid", "mid") == ()
    assert whole.hosts(FLEET.modules["receiver"]) == ("nose",)
    assert whole.hosts(FLEET.modules["filter"]) == ("mid", "ground")


def test_the_way_from_a_bus_to_a_pe_begins_with_this_bus() -> None:
    assert left().way("can1", "tail") == left().way("can1", "mid") == ("can1",)
    assert left().way("can1", "nose") == ("can1", "can0")
    assert left().way("can0", "ground") == ("can0", "can1", "radio")
    assert left("bus:radio").way("can0", "ground") == ()


@pytest.mark.parametrize(
    ("down", "up"),
    [
        (["pe:mid"], ["tail", "ground"]),
        (["pe:tail"], ["nose", "mid"]),
        (["bus:can0"], ["mid", "tail", "ground"]),
        (["bus:radio"], ["nose", "mid", "tail"]),
        (["channel:can1.1"], ["nose", "mid", "tail", "ground"]),
        (["channel:can1.1", "channel:can1.2"], []),
        (["bus:can1"], []),
        (["pe:mid", "pe:tail"], []),
    ],
)
def test_a_pe_without_a_route_to_the_managers_bus_counts_as_down(down: list[str], up: list[str]) -> None:
    rest = left(*down)
    assert list(rest.pe_cpu_millis) == up
    assert {one for pair in rest.routes for one in pair} == set(up)


def test_a_pe_takes_its_devices_along() -> None:
    assert left().devices == {"gps"}
    for down in ("device:gps", "pe:nose", "bus:can0"):
        assert left(down).devices == frozenset()
        assert left(down).hosts(FLEET.modules["receiver"]) == ()


def test_a_failed_module_runs_nowhere() -> None:
    assert left("module:filter").hosts(FLEET.modules["filter"]) == ()


def test_capacity_shrinks_cpu_to_a_whole_thousandth_and_buses_to_a_thousandth_of_a_bit() -> None:
    rest = left(limits=["pe:nose=50%", "bus:radio=33.3333333%", "bus:can0=0%", "pe:mid=100%"])
    assert rest.pe_cpu_millis["nose"] == 166
    assert rest.pe_cpu_millis["mid"] == 1000
    assert rest.bus_mbit_per_s["radio"] == int(35_000_000 * Fraction("0.333333333"))
    assert rest.bus_mbit_per_s["can0"] == 0
    assert rest.route("nose", "mid") == ("can0",)


def test_the_first_phase_counts_when_none_is_asked_for() -> None:
    assert situation(FLEET) == Situation(phase="climb")
    assert situation(FLEET, phase="glide").phase == "glide"


def test_a_changed_priority_counts_where_the_function_is_wanted() -> None:
    spec = load(shipped_spec_path("big_blue"))
    release, chute = spec.functions["balloon_release"], spec.functions["parachute"]
    ascent = situation(spec, phase="ascent", priorities=["balloon_release=3", "balloon_release=4"])
    glide = situation(spec, phase="glide", priorities=["balloon_release=4"])
    assert (ascent.priority_of(release), glide.priority_of(release)) == (4, 0)
    assert ascent.priority_of(chute) == chute.priority_in("ascent")
    assert situation(spec, priorities=["parachute=0"]).priority_of(chute) == 0
    assert len({ascent, situation(spec, phase="ascent"), glide}) == 3


@pytest.mark.parametrize("text", ["parachute", "parachute=", "parachute=-1", "parachute=32768", "parachute=1.5", "x=1"])
def test_a_priority_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UnknownElementError, match=r"is not a priority; write FUNCTION=N|no function is named 'x'"):
        situation(load(shipped_spec_path("big_blue")), priorities=[text])


def test_everything_that_can_be_down_is_a_known_element() -> None:
    every = elements(FLEET)
    assert "channel:can1.2" in every
    assert "channel:can0.1" not in every
    assert situation(FLEET, every).down == frozenset(every)


@pytest.mark.parametrize(
    ("down", "limits", "phase", "sentence"),
    [
        (["nose"], [], None, "'nose' is not an element; did you mean 'pe:nose'?"),
        (["tail rotor"], [], None, "'tail rotor' is not an element; write KIND:NAME with KIND one of pe, device"),
        (["pe:nosee"], [], None, "no PE is named 'nosee'; did you mean 'nose'?"),
        (["engine:left"], [], None, "'engine:left' is not an element"),
        (["channel:can0.1"], [], None, "no channel is named 'can0.1'; did you mean"),
        (["channel:can1.3"], [], None, "no channel is named 'can1.3'; did you mean"),
        ([], ["bus:radio=40"], None, "'bus:radio=40' is not a limit; write for example bus:NAME=40%"),
        ([], ["bus:radio=-4%"], None, "'bus:radio=-4%' is not a limit"),
        ([], [f"bus:radio={'9' * 5000}%"], None, "'bus:radio=9999"),
        ([], ["bus:radio=101%"], None, "'bus:radio=101%' is more than the capacity there is"),
        ([], ["device:gps=40%"], None, "'device:gps' has no capacity to limit"),
        ([], ["bus:radio=40%", "bus:radio=50%"], None, "'bus:radio' is limited twice"),
        ([], [], "landing", "no phase is named 'landing'"),
    ],
)
def test_what_the_spec_does_not_have_is_refused(
    down: list[str], limits: list[str], phase: str | None, sentence: str
) -> None:
    with pytest.raises(UnknownElementError) as refused:
        situation(FLEET, down, limits, phase)
    assert str(refused.value).startswith(sentence)


def test_a_module_can_be_down_on_one_of_its_pes() -> None:
    assert places(FLEET, "filter") == ("module:filter@mid", "module:filter@ground")
    assert places(FLEET, "receiver") == ()
    assert left("module:filter@mid").hosts(FLEET.modules["filter"]) == ("ground",)
    assert left("module:filter@mid", "module:filter@ground").hosts(FLEET.modules["filter"]) == ()
    assert left("module:filter@mid", "pe:ground").hosts(FLEET.modules["filter"]) == ()
    assert left("module:filter@mid").hosts(FLEET.modules["receiver"]) == ("nose",)


@pytest.mark.parametrize(
    ("element", "sentence"),
    [
        ("module:filtre@mid", "no module is named 'filtre'; did you mean 'filter'?"),
        ("module:filter@midd", "no PE is named 'midd'; did you mean 'mid'?"),
        (
            "module:filter@tail",
            "module 'filter' has no place on 'tail'; write one of module:filter@mid, module:filter@ground",
        ),
        (
            "module:receiver@nose",
            "module 'receiver' has no place on 'nose'; write module:receiver: it has no choice of PEs",
        ),
        ("device:gps@nose", "no device is named 'gps@nose'; the spec has gps"),
    ],
)
def test_a_place_that_does_not_exist_is_refused(element: str, sentence: str) -> None:
    with pytest.raises(UnknownElementError) as caught:
        situation(FLEET, [element])
    assert str(caught.value) == sentence
