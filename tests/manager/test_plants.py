"""The event control_paths after every epoch, and what the status says of plants."""

from dataclasses import replace

from heronry_dg.configuration import Configuration
from heronry_dg.plan import Plan
from heronry_dg.situation import situation
from heronry_manager import events
from heronry_manager.planner.exact import plan
from heronry_manager.shell.plants import Plants
from heronry_tools.reports.status import _plants
from pcs.test_plan_graphs import small

RUNS = events.Reconfigured(70, 5, ("first heard",), events.Times(1, 2, 3, 4), (), (), ())
ADOPTED = events.Adopted(70, epoch=5, digest="00A1B2")


def planned() -> tuple[Plants, Plan]:
    spec, _ = small()
    return Plants(spec), plan(spec, situation(spec))


def test_an_epoch_that_runs_is_followed_by_what_it_means_for_the_plants() -> None:
    plants, made = planned()
    states = {"tank": "on_path", "room": "unmoved", "moon": "unmoved"}
    for runs in (RUNS, ADOPTED):
        assert plants.after(runs, made) == events.ControlPaths(70, epoch=5, plants=states)
    assert plants.after(events.PlanKept(70, request=1), made) is None
    assert plants.after(ADOPTED, None) is None


def test_the_status_says_why_a_loop_is_open() -> None:
    plants, made = planned()
    assert plants.status(None) == {}
    left = {name: one for name, one in made.configuration.modules.items() if name == "clock"}
    said = plants.status(replace(made, configuration=Configuration(left)))["plants"]
    assert said["tank"] == {"path": "unmoved", "why": "no module runs on any actuator that moves it: valve"}
    assert list(_plants({"tank": said["tank"], "wing": {"path": "on_path", "why": None}})) == [
        "control loops, as planned",
        "  the loop through tank: OPEN, because no module runs on any actuator that moves it: valve",
        "  the loop through wing: closed",
    ]


def test_a_spec_without_plants_is_told_nothing() -> None:
    spec, _ = small()
    plants, made = Plants(replace(spec, plants={})), planned()[1]
    assert plants.after(RUNS, made) is None
    assert plants.status(made) == {}
