"""Rules between modules: which must run on different PEs, on one PE, or never at the same time."""

from collections.abc import Iterable
from dataclasses import dataclass

from heronry_manager.planner.greedy.numbering import Numbering


@dataclass(frozen=True, slots=True)
class PlacementRules:
    """The rules between modules; each module is named by its number (`numbering`).

    `separate`, `together` and `rivals` have one entry for each module: a set of other modules. The set is an
    integer, in which bit n stands for the module with the number n.

    separate: the modules that must run on another PE than this module.
    together: the modules that must run on the same PE as this module.
    rivals: the modules of which none may run while this module runs (`Spec.rivals`).
    demuxes: for each DEMUX, the numbers of its ends, in order.
    """

    separate: list[int]
    together: list[int]
    rivals: list[int]
    demuxes: list[list[int]]  # ends of each DEMUX, in order


def placement_rules(numbers: Numbering) -> PlacementRules:
    """Read the placement rules and DEMUXes of the spec."""
    spec, number = numbers.spec, numbers.module_number
    return PlacementRules(
        separate=_others(numbers, spec.separate),
        together=_others(numbers, spec.together),
        rivals=_others(numbers, spec.rivals()),
        demuxes=[[number[name] for name in demux.ends] for demux in spec.demuxes.values()],
    )


def _others(numbers: Numbering, groups: Iterable[Iterable[str]]) -> list[int]:
    """Return, by module number, the set of the other modules in the groups of the module: bit n stands for module n."""
    others = [0] * len(numbers.modules)
    for group in groups:
        members = [numbers.module_number[name] for name in group]
        everybody = sum(1 << module for module in members)
        for module in members:
            others[module] |= everybody & ~(1 << module)
    return others
