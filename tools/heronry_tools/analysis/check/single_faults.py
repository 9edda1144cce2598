"""The check of DG401 to DG404: critical functions that one fault loses, found with the planner.

A function is *lost with an element* if the best plan with everything up serves the function, and the best plan without
the element does not. Functions that no plan serves with everything up are reported as DG3xx, and left out here.

Three rules make most plans unnecessary:

- Some elements leave the planner the same choices when they are lost, for example a device and its only driver. They
  share one plan.
- If no module could still give the output of a function, the function is lost. This needs no plan.
- If the remaining functions of all phases can be served together, none of them is lost. Only if they cannot, a plan is
  made for each phase.

A phase is *crowded* if its best plan gives up critical functions for lack of room (DG303 to DG306). In such a phase a
fault counts only if no module could still give the output of a function that was served: what else is lost for lack of
room says nothing until there is room.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from heronry_dg.check.subject import UNSEEN, Work
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, elements, survivors
from heronry_manager.planner.sweep import what_is_left
from heronry_tools.analysis.check.wanted import Phase, critical_functions, phases
from heronry_tools.analysis.servable import Planning

Lost = Mapping[str, tuple[Phase, ...]]
"""Functions, each with the phases in which it is lost."""


@dataclass(frozen=True, slots=True)
class Loss:
    """The functions that are lost with one element.

    functions: by name of the function, the phases in which it is lost.
    """

    element: str
    functions: Lost


class Choices:
    """What single faults leave the planner to choose from, as values that can be compared.

    of_all: the values that stand for all choices, as with everything up.
    """

    def __init__(self, spec: Spec) -> None:
        self._spec, healthy = spec, survivors(spec, Situation())
        self._hosts = {module.name: healthy.hosts(module) for module in spec.modules.values()}
        self._drivers: dict[str, list[str]] = {}
        for module in spec.modules.values():
            if module.device is not None:
                self._drivers.setdefault(module.device, []).append(module.name)
        self.of_all: tuple[object, ...] = (what_is_left(healthy), frozenset())

    def without(self, element: str) -> object:
        """Return the choices without an element; equal values of two elements mean equal choices.

        The loss of a module or device leaves all choices but those of some modules: the value names these modules.
        """
        kind, _, name = element.partition(":")
        if kind not in ("device", "module"):
            return what_is_left(survivors(self._spec, Situation(frozenset({element}))))
        gone = [name] if kind == "module" else self._drivers.get(name, ())
        return frozenset(module for module in gone if self._hosts[module])


def losses(planning: Planning, work: Work = UNSEEN) -> Iterator[Loss]:
    """Yield a `Loss` for every element with which at least one critical function is lost; `work` counts the elements.

    A module is left out if the loss of its device loses the same functions in the same phases.
    """
    spec = planning.spec
    critical, crowded = _served(planning)
    by_phase = bool(crowded) or _differs_by_phase(planning, critical)
    choices = Choices(spec)
    known: dict[object, Lost] = {choice: {} for choice in choices.of_all}
    lost: dict[str, Lost] = {}
    faults = list(single_elements(spec))
    work.begin("single faults", len(faults))
    for element in faults:
        work.step()
        left = choices.without(element)
        if left not in known:
            down = frozenset({element})
            known[left] = (
                _lost_by_phase(planning, critical, crowded, down) if by_phase else _lost(planning, critical, down)
            )
        lost[element] = known[left]
        if lost[element] and lost.get(device_of(spec, element)) != lost[element]:
            yield Loss(element, lost[element])


def single_elements(spec: Spec) -> Iterator[str]:
    """Yield the elements that one fault can take out of use.

    Channels and replicated buses are left out: one fault takes one channel, and the other channel carries on.
    """
    for element in elements(spec):
        kind, _, name = element.partition(":")
        if kind != "channel" and (kind != "bus" or spec.buses[name].channels == 1):
            yield element


def _served(planning: Planning) -> tuple[dict[Phase, frozenset[str]], frozenset[Phase]]:
    """Return the critical functions that each phase's best plan serves with everything up, and the crowded phases."""
    by_phase = {phase: critical_functions(planning.spec, phase) for phase in phases(planning.spec)}
    possible = {phase: planning.in_phase(phase).possible(names) for phase, names in by_phase.items()}
    together = frozenset[str]().union(*possible.values())
    if not _differs_by_phase(planning, by_phase) and planning.all_at_once(together).configuration is not None:
        return possible, frozenset()
    crowded = frozenset(
        phase for phase, names in possible.items() if planning.in_phase(phase).all_at_once(names).configuration is None
    )
    served = {
        phase: names - planning.unserved(names, phase) if phase in crowded else names
        for phase, names in possible.items()
    }
    return served, crowded


def _lost_by_phase(
    planning: Planning, critical: Mapping[Phase, frozenset[str]], crowded: frozenset[Phase], down: frozenset[str]
) -> Lost:
    """Return what `_lost` gives, for a spec with crowded phases or with inputs that only some phases have."""
    each = {
        phase: wanted - planning.in_phase(phase).possible(wanted, down)
        if phase in crowded
        else _lost_in(planning.in_phase(phase), phase, wanted, down)
        for phase, wanted in critical.items()
    }
    return _in_order(planning.spec, each)


def _lost(planning: Planning, critical: Mapping[Phase, frozenset[str]], down: frozenset[str]) -> Lost:
    """Return the critical functions that a fault loses, in the spec's order, each with the phases where it is lost."""
    possible = planning.possible(frozenset[str]().union(*critical.values()), down)
    gone = {phase: wanted - possible for phase, wanted in critical.items()}
    if not planning.can_serve(possible, down):
        for phase, wanted in critical.items():
            if not planning.can_serve(wanted & possible, down):
                gone[phase] = planning.unserved(wanted, phase, down)
    return _in_order(planning.spec, gone)


def _in_order(spec: Spec, gone: Mapping[Phase, frozenset[str]]) -> Lost:
    if not any(gone.values()):
        return {}
    by_function = {name: tuple(phase for phase in gone if name in gone[phase]) for name in spec.functions}
    return {name: at for name, at in by_function.items() if at}


def _differs_by_phase(planning: Planning, by_phase: Mapping[Phase, frozenset[str]]) -> bool:
    """Tell whether the spec has an input that `only_in` leaves unwired in at least one of these phases."""
    return any(planning.in_phase(phase) is not planning for phase in by_phase)


def _lost_in(planning: Planning, phase: Phase, wanted: frozenset[str], down: frozenset[str]) -> frozenset[str]:
    """Return the functions in `wanted` that are lost in a phase while the elements in `down` are down."""
    possible = planning.possible(wanted, down)
    fits = planning.can_serve(possible, down)
    return wanted - possible if fits else planning.unserved(wanted, phase, down)


def device_of(spec: Spec, element: str) -> str:
    """Return `device:NAME` for an element `module:NAME`, with the name of the module's device.

    Gives `device:None` for a module without a device, and an empty text for any element that is no module.
    """
    kind, _, name = element.partition(":")
    return f"device:{spec.modules[name].device}" if kind == "module" else ""
