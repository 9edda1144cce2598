"""Where the tracking filter runs: free it is aboard, and outlives a radio of a tenth; forced to the rover it does not.

The paper's minimum cut places the filter on the aircraft. Here a plan, a simulated flight and a flight with processes
show the same four cases.
"""

import pytest

pytest.importorskip("jsbsim")

from typing import Any

from heronry_dg.loader import load
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_manager.planner.exact import plan
from heronry_tools.fly.flight import EavFlight
from heronry_tools.fly.live.flight import fly_live
from heronry_tools.fly.mission import Mission
from heronry_tools.sim.faults.fault import read_fault

EAV = shipped_spec_path("eav")
SPEC = load(EAV)
ABOARD = {"nav_a", "nav_b", "flight"}
PLACES_ABOARD = [f"module:tracked_position@{pe}" for pe in sorted(ABOARD)]
WITHOUT_CORRECTIONS = "device:differential_receiver"
A_TENTH = "4 collapse bus:radio for 60 level 10"


def planned(*down, before=None, limits=()):
    """Return the PE and mode of the filter, the mode of the flight management, and the plan."""
    running = None if before is None else placement(before.configuration)
    found = plan(SPEC, situation(SPEC, (WITHOUT_CORRECTIONS, *down), limits), running)
    assert found.optimal
    modules: Any = found.document()["modules"]
    of_the_filter = modules.get("tracked_position", {"pe": None, "mode": None})
    return of_the_filter["pe"], of_the_filter["mode"], modules["flight_management"]["mode"], found


def test_the_plan_has_the_filter_aboard_and_keeps_it_there_when_the_radio_shrinks() -> None:
    *free, before = planned()
    *shrunk, _ = planned(before=before, limits=["bus:radio=10%"])
    assert free[0] in ABOARD
    assert free[1:] == ["tracking", "precise"]
    assert shrunk == free


def test_the_plan_loses_the_landing_when_the_filter_is_forced_to_the_rover_and_the_radio_shrinks() -> None:
    *forced, before = planned(*PLACES_ABOARD)
    *shrunk, _ = planned(*PLACES_ABOARD, before=before, limits=["bus:radio=10%"])
    assert forced == ["rover", "tracking", "precise"]
    assert shrunk[1:] != ["tracking", "precise"]
    assert shrunk[2] == "waiting"


def simulated(*acts):
    given = tuple(read_fault(SPEC, act) for act in acts)
    landing, record = EavFlight(SPEC, Mission(seed=1, longest_s=7.0, acts=given)).fly()
    places = [stretch.label for stretch in record.stretches if stretch.subject == "tracked_position"]
    return places[0], landing.mode


MISSING_ABOARD = [f"0 missing {place}" for place in PLACES_ABOARD]


def test_the_filter_aboard_outlives_a_radio_of_a_tenth() -> None:
    assert simulated(A_TENTH) == ("nav_b (tracking)", "precise")


@pytest.mark.soak  # the plan without it is tried in every run
def test_forced_to_the_rover_it_is_lost() -> None:
    assert simulated(*MISSING_ABOARD) == ("rover (tracking)", "precise")
    assert simulated(*MISSING_ABOARD, A_TENTH) == ("rover (tracking)", "waiting")


def by_processes(file, *acts, expected):
    """Fly until `expected` holds for where the filter runs, for its mode and for that of the flight management.

    A flight in which it does not hold is the result, unless the computer stood still in it: then it tells nothing, and
    is flown again.
    """
    spec = load(file)
    given = tuple(read_fault(spec, act) for act in acts)
    for _ in range(3):
        end = fly_live(spec, file, Mission(seed=1, longest_s=9.0, acts=given))
        place, _, mode = end["places"].get("tracked_position", "").partition(" ")
        found = place, mode, end["places"].get("flight_management", "").partition(" ")[2]
        if expected(*found) or not end["stood_still"]:
            return found
    pytest.skip(f"the computer stood still in each of three flights; the last one ended with {found}")


@pytest.fixture
def forced(tmp_path):
    """The EAV with the filter on the rover alone."""
    free = "image: eav_tracked_position\n    requires: [fpu]\n"
    assert free in EAV.read_text()
    file = tmp_path / "eav.dg.yaml"
    file.write_text(EAV.read_text().replace(free, "image: eav_tracked_position\n    runs_on: [rover]\n"))
    return file


def tracks_aboard(place, *modes):
    return place in ABOARD and modes == ("(tracking)", "(precise)")


def tracks_on_the_rover(*found):
    return found == ("rover", "(tracking)", "(precise)")


def waits(place, mode, of_the_management):
    return of_the_management == "(waiting)"


@pytest.mark.live
@pytest.mark.soak
def test_with_processes_the_filter_aboard_outlives_a_radio_of_a_tenth() -> None:
    assert tracks_aboard(*by_processes(EAV, A_TENTH, expected=tracks_aboard))


@pytest.mark.live
@pytest.mark.soak
def test_with_processes_forced_to_the_rover_it_is_lost(forced) -> None:
    assert tracks_on_the_rover(*by_processes(forced, expected=tracks_on_the_rover))
    assert waits(*by_processes(forced, A_TENTH, expected=waits))
