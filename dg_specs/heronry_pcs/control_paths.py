"""Tells whether the running modules control each plant: the parts of the physical world that a spec's `plants:` name.

    unmoved   no running module drives an actuator that moves the plant
    unseen    a running module drives such an actuator, and none reads a sensor that sees the plant
    on_path   a loop leads from the plant through a sensor and modules to an actuator, and back to the plant
    open      the plant is moved and seen, and no loop leads through it

The first state that holds counts. There is no control without a path, but a path alone does not prove control.

Source: the paper that graph.py names, section 3.4, and the loops of loops.py.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import Enum

from heronry_dg.configuration import Configuration
from heronry_dg.model import Plant, Spec
from heronry_pcs.loops import loops
from heronry_pcs.plan_graph import plan_graph


class PathState(Enum):
    """Whether a plant is controlled; the values are written into events and the status."""

    UNMOVED = "unmoved"
    UNSEEN = "unseen"
    ON_PATH = "on_path"
    OPEN = "open"


@dataclass(frozen=True, slots=True)
class ControlPath:
    """The state of a plant's control path.

    why: a sentence that says why the path is not closed; None if the path is closed.
    """

    state: PathState
    why: str | None


def control_paths(spec: Spec, configuration: Configuration) -> dict[str, ControlPath]:
    """Assess each plant of a spec under a configuration, whose names must exist in the spec."""
    if not spec.plants:
        return {}
    graph = plan_graph(spec, configuration)
    found = loops(graph)
    wired = {spec.modules[name].device for name in configuration.modules}
    return {
        plant.name: _path(plant, wired, is_on_path=found.control(graph.members[f"plant:{plant.name}"].vertices))
        for plant in spec.plants.values()
    }


def path_states(paths: Mapping[str, ControlPath]) -> dict[str, str]:
    """Return the state of each plant's path by the plant's name, as text for the event `control_paths`."""
    return {plant: path.state.value for plant, path in paths.items()}


def _path(plant: Plant, wired: Collection[str | None], *, is_on_path: bool) -> ControlPath:
    moving, seeing = ([device for device in devices if device in wired] for devices in (plant.moved_by, plant.seen_by))
    if not moving:
        return ControlPath(PathState.UNMOVED, _lacks("actuator that moves it", plant.moved_by))
    if not seeing:
        return ControlPath(PathState.UNSEEN, _lacks("sensor that sees it", plant.seen_by))
    if is_on_path:
        return ControlPath(PathState.ON_PATH, None)
    why = f"nothing leads from {' or '.join(seeing)}, which sees it, to {' or '.join(moving)}, which moves it"
    return ControlPath(PathState.OPEN, why)


def _lacks(what: str, devices: Collection[str]) -> str:
    return f"no module runs on any {what}: {', '.join(devices)}" if devices else f"the spec names no {what}"
