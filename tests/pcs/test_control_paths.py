"""What a configuration means for each plant: unmoved, unseen, on a path or open, and why."""

from dataclasses import replace

from heronry_dg.configuration import Configuration
from heronry_dg.model import Plant
from heronry_pcs.control_paths import ControlPath, PathState, control_paths, path_states
from pcs.test_plan_graphs import small


def test_each_state_and_its_reason() -> None:
    spec, whole = small()
    assert control_paths(spec, whole) == {
        "tank": ControlPath(PathState.ON_PATH, None),
        "room": ControlPath(PathState.UNMOVED, "the spec names no actuator that moves it"),
        "moon": ControlPath(PathState.UNMOVED, "the spec names no actuator that moves it"),
    }
    deaf = replace(spec, plants={"tank": Plant("tank", moved_by=("valve",))})
    assert control_paths(deaf, whole)["tank"].why == "the spec names no sensor that sees it"


def test_what_a_fault_takes_away_is_named() -> None:
    spec, whole = small()

    def without(*names: str) -> ControlPath:
        left = {name: replace(one, inputs={}) for name, one in whole.modules.items() if name not in names}
        return control_paths(spec, Configuration(left))["tank"]

    assert without("valve_driver", "gauge_driver") == ControlPath(
        PathState.UNMOVED, "no module runs on any actuator that moves it: valve"
    )
    assert without("gauge_driver") == ControlPath(
        PathState.UNSEEN, "no module runs on any sensor that sees it: gauge, idle"
    )
    assert without("control") == ControlPath(
        PathState.OPEN, "nothing leads from gauge, which sees it, to valve, which moves it"
    )


def test_a_plant_that_another_affects_closes_the_loop_of_both() -> None:
    """The valve moves the tank, the tank the room; the gauge sees the room alone."""
    spec, whole = small()
    tank, room = Plant("tank", ("valve",), (), ("room",)), Plant("room", (), ("gauge",))
    paths = control_paths(replace(spec, plants={"tank": tank, "room": room}), whole)
    assert path_states(paths) == {"tank": "unseen", "room": "unmoved"}


def test_a_spec_without_plants_has_none() -> None:
    spec, whole = small()
    assert control_paths(replace(spec, plants={}), whole) == {}
