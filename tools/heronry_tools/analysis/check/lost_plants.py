"""The check of DG405: plants of criticality A or B that lose every control path with one fault.

In each phase, the check considers the plants that are on a control path of the best plan with everything up. Such a
plant is lost with an element if it is on no control path of the contingency for that element.

Sometimes the planner has the same choices after the loss of either of two elements, for example of a device and of its
only driver. Then one plan serves for both elements.
"""

from collections.abc import Iterator
from typing import Final

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_pcs.loops import loops
from heronry_pcs.plan_graph import plan_graph
from heronry_tools.analysis.check.single_faults import Choices, Loss, Lost, device_of, single_elements
from heronry_tools.analysis.check.wanted import phases
from heronry_tools.analysis.servable import Planning

_CLASSES: Final = ("A", "B")


def lost_plants(planning: Planning) -> Iterator[Loss]:
    """Yield each element whose loss takes plants of class A or B off every control path, with these plants.

    A module is left out if the loss of its device loses the same plants.
    """
    spec = planning.spec
    if not any(plant.criticality in _CLASSES for plant in spec.plants.values()):
        return
    healthy = {phase: _on_path(spec, planning.healthy(phase).configuration) for phase in phases(spec)}
    choices = Choices(spec)
    known: dict[object, Lost] = {choice: {} for choice in choices.of_all}
    lost: dict[str, Lost] = {}
    for element in single_elements(spec):
        down = frozenset({element})
        left = choices.without(element)
        if left not in known:
            gone = {
                phase: on_path - _on_path(spec, planning.contingency(phase, down).configuration)
                for phase, on_path in healthy.items()
                if on_path
            }
            by_plant = {name: tuple(phase for phase in gone if name in gone[phase]) for name in spec.plants}
            known[left] = {name: at for name, at in by_plant.items() if at}
        lost[element] = known[left]
        if lost[element] and lost.get(device_of(spec, element)) != lost[element]:
            yield Loss(element, lost[element])


def _on_path(spec: Spec, configuration: Configuration) -> frozenset[str]:
    """Return the plants of class A and B that a configuration has on a control path."""
    graph = plan_graph(spec, configuration)
    found = loops(graph)
    return frozenset(
        plant.name
        for plant in spec.plants.values()
        if plant.criticality in _CLASSES and found.control(graph.members[f"plant:{plant.name}"].vertices)
    )
