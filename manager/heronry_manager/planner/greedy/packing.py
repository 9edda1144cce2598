"""Packing: proposes places for the modules of functions of class A to D, if these modules find no room one by one.

Modules are chosen first, and then packed:

*Choose*: the functions are served in their cheapest modes, by their cheapest producers, as if no PE had limits.

*Pack*: the chosen modules are put on the real PEs, without wires.

1. Modules with only one possible PE come first, then the others, the largest first. The size of a module is the sum of
   the CPU, RAM and flash that it needs, each weighted by its scarcity.
2. Each module goes to the PE with the least room left.
3. If modules do not fit, these modules go to the front of the order, and all modules are packed anew. This is repeated
   a few times. The packing that places the most modules is used.

There are two proposals:

    first     all functions are packed together
    second    the functions are taken one after the other, the most important first; a function is kept if all modules
              chosen so far can be packed

A proposal has places of modules, but no wires. `repairing` starts from a proposal in place of a running configuration,
and makes a complete configuration.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from heronry_dg.objective import CRITICAL_CLASSES
from heronry_manager.planner.greedy.draft import Draft
from heronry_manager.planner.greedy.scene import Scene
from heronry_manager.planner.greedy.serving import Before, Server
from heronry_manager.planner.greedy.tables import Tables
from heronry_manager.planner.greedy.wanted import Goal, Wanted

_ROUNDS: Final = 8  # of one packing
_BUDGET: Final = 2000  # modules placed in all rounds
_ENDLESS: Final = 1 << 60


def packings(tables: Tables, wanted: Wanted, scene: Scene) -> Iterator[Before]:
    """Yield two proposals, each with PEs for the modules that critical functions need.

    The first proposal packs the modules of all these functions together, the second function by function.
    """
    draft = Draft(tables, replace(scene, bus_room=[_ENDLESS] * len(tables.numbers.buses)))
    draft.cpu, draft.ram, draft.flash = ([_ENDLESS] * len(tables.numbers.pes) for _ in range(3))
    server = Server(tables, wanted, scene, draft, _nothing(tables))
    critical = [goal for goal in wanted.goals if goal.rank < len(CRITICAL_CLASSES)]
    packer = _Packer(tables, wanted, scene)
    for goal in critical:
        _choose(server, goal)
    yield packer.packed(draft)[0]
    draft.undo(0)
    best = _nothing(tables)
    for goal in critical:
        mark = draft.mark()
        _choose(server, goal)
        places, left_out = packer.packed(draft)
        if left_out:
            draft.undo(mark)
        else:
            best = places
    yield best


def _nothing(tables: Tables) -> Before:
    return [(-1, -1)] * len(tables.numbers.modules)


def _choose(server: Server, goal: Goal) -> None:
    if not server.is_served(goal):
        server.serve_in(reversed(goal.modes))


class _Packer:
    """Places as many as possible of the chosen modules on the PEs that can be used in a situation."""

    def __init__(self, tables: Tables, wanted: Wanted, scene: Scene) -> None:
        self._tables, self._scene = tables, scene
        self._draft = Draft(tables, scene)
        self._server = Server(tables, wanted, scene, self._draft, _nothing(tables))
        self._server.tight = True
        self._budget = _BUDGET

    def packed(self, chosen: Draft) -> tuple[Before, int]:
        """Find places for as many of the modules that `chosen` runs as possible, within the packer's budget.

        Returns for each module of the spec its mode and PE, both -1 without a place, and how many of the chosen modules
        have found no place.
        """
        draft, tables = self._draft, self._tables
        order = _order(tables, self._scene, draft, [mode for mode in chosen.mode if mode >= 0])
        best, fewest = _nothing(tables), len(order)
        for _ in range(_ROUNDS):
            left_out = _pack(tables, self._server, order)
            if len(left_out) < fewest:
                fewest, best = len(left_out), list(zip(draft.mode, draft.pe, strict=True))
            draft.undo(0)
            self._budget -= len(order)
            if not left_out or self._budget <= 0:
                break
            order = [*left_out, *(mode for mode in order if mode not in left_out)]
        return best, fewest


def _order(tables: Tables, scene: Scene, draft: Draft, modes: Sequence[int]) -> list[int]:
    sizes, module_of = tables.sizes, tables.numbers.module_of
    needs = {mode: (sizes.cpu[mode], sizes.ram[mode], sizes.flash[module_of[mode]]) for mode in modes}
    pes = [pe for pe in range(len(tables.numbers.pes)) if scene.pes >> pe & 1]
    there = [max(1, sum(of[pe] for pe in pes)) for of in (draft.cpu, draft.ram, draft.flash)]
    demand = [sum(needed) for needed in zip(*needs.values(), strict=True)]
    scarcity = [demanded / (all_there * all_there) for demanded, all_there in zip(demand, there, strict=False)]

    def size(mode: int) -> float:
        return sum((needed * scarce for needed, scarce in zip(needs[mode], scarcity, strict=True)), 0.0)

    def is_free(mode: int) -> bool:
        return (scene.hosts[mode] & scene.pes).bit_count() > 1

    return sorted(modes, key=lambda mode: (is_free(mode), -size(mode)))


def _pack(tables: Tables, server: Server, order: Sequence[int]) -> list[int]:
    """Place modes on PEs in this order, without wires; return the modes that found no place."""
    left_out = []
    for mode in order:
        module = tables.numbers.module_of[mode]
        place = next(server.places(module, mode), None)
        if place is None:
            left_out.append(mode)
        else:
            server.draft.start(module, mode, place)
    return left_out
