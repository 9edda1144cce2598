"""Serving one function: start its output module, wire the inputs of this module, and start the producers it needs.

- A module is tried on its old PE first, then on the other PEs, the emptiest first. If no PE has room, other modules
  are moved away from one PE to PEs where they fit (`_clear`).
- An input is wired to a running producer if possible. If there is none, a producer is started: one that ran before,
  or else the cheapest.
- A producer in an unsuitable mode is put into a suitable mode, if all modules that read from it accept that mode
  (`switch`).

*Adopting* serves in the same way, but starts only modules that ran before, in their old modes and on their old PEs.

A module whose inputs are being wired is *busy*. It counts as running, so that its own outputs may feed it, and its mode
must not change. If a method of `Server` returns False, it has left the draft unchanged; the exception is `Server.hold`.

Two counts of tries limit the work: `fuel` for one wanted function, and a budget for all of them. So a plan takes a
limited time even on a full aircraft. Since no clock is used, the plan is the same on every machine.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from heronry_manager.planner.greedy.draft import Draft
from heronry_manager.planner.greedy.leaves import LEAF, Node
from heronry_manager.planner.greedy.scene import Scene
from heronry_manager.planner.greedy.tables import Tables
from heronry_manager.planner.greedy.wanted import Goal, Wanted

_FUEL: Final = 40  # modules tried for one function
_BUDGET: Final = 800  # modules tried or moved for all functions; adopted ones do not count
_DEEPEST: Final = 120  # modules in a chain: Python's limit on nested calls is not far beyond

Before = Sequence[tuple[int, int]]
"""Mode and PE of each module before; mode -1: it did not run; PE -1: its PE is down."""


class Server:
    """Changes one draft so that functions are served."""

    def __init__(self, tables: Tables, wanted: Wanted, scene: Scene, draft: Draft, before: Before) -> None:
        """Begin with a draft that serves nothing; `before`: the modes and PEs in which modules ran."""
        self.draft = draft
        self.fuel = _FUEL
        self._budget = _BUDGET
        self.short = 0  # PEs on which a module found no room, since this was last cleared
        self.busy = 0  # modules whose mode must stay
        self.moving = True  # whether other modules may be moved to make room
        self.adopting = False
        self.tight = False  # fill the fullest PE first, wherever modules were before
        self._tables, self._wanted, self._scene, self._before = tables, wanted, scene, before

    def is_served(self, goal: Goal) -> bool:
        """Tell whether an output module of the function runs in the draft."""
        mode = self.draft.mode
        return any(mode[module] >= 0 for module in goal.outputs)

    def serve(self, goal: Goal) -> bool:
        """Serve a function as it was served before, or else in its best possible mode.

        Tell whether the function is served now.
        """
        self.short = 0
        if self.is_served(goal):
            return True
        before, module_of = self._before, self._tables.numbers.module_of
        modes = sorted(goal.modes, key=lambda mode: before[module_of[mode]][0] != mode)
        return self.serve_in(modes)

    def serve_in(self, modes: Iterable[int]) -> bool:
        """Start the first of these output modes that can run; tell whether there is one."""
        self.fuel = _FUEL
        return any(self.run(self._tables.numbers.module_of[mode], mode) for mode in modes)

    def adopt(self, goals: Iterable[Goal]) -> None:
        """Serve the functions in `goals` that can be served as before, each with its output in the same mode.

        Whatever these outputs need runs in the same modes and on the same PEs as before, too.
        """
        self.adopting = True
        for goal in goals:
            self.fuel = len(self._before)
            for module in goal.outputs:
                mode = self._before[module][0]
                if mode >= 0 and self.draft.mode[module] < 0:
                    self.run(module, mode)
        self.adopting = False

    # Modules

    def run(self, module: int, mode: int, pe: int = -1) -> bool:
        """Start a module and wire what its mode needs; tell whether it runs. `pe`: the only PE to try; -1: any PE."""
        if min(self.fuel, self._budget) <= 0 or not self._scene.possible >> mode & 1:
            return False
        if self.busy.bit_count() > _DEEPEST:
            return False
        self.fuel -= 1
        self._budget -= not self.adopting
        draft, needs = self.draft, self._tables.orders.needs[mode]
        mark = draft.mark()
        for place in self.places(module, mode) if pe < 0 else self._there(module, mode, pe):
            draft.start(module, mode, place)
            if needs is None:
                return True
            draft.refused = False
            self.busy |= 1 << module
            done = self.hold(needs, module, may_start=True)
            self.busy ^= 1 << module
            if done:
                return True
            draft.undo(mark)
            if not draft.refused:
                break
        return False

    def _there(self, module: int, mode: int, pe: int) -> Iterator[int]:
        if self._scene.hosts[mode] >> pe & 1 and self.draft.fits(module, mode, pe):
            yield pe

    def places(self, module: int, mode: int) -> Iterator[int]:
        """Yield the PEs to try for a mode, in this order.

        1. The old PE of the module, if it has room. While adopting, this is the only PE.
        2. The other PEs with room, the emptiest first.
        3. If no other PE has room, and `moving` is set: one PE, after modules have been moved away from it (`_clear`).

        With `tight`, the old PE is treated like the others, and the fullest PE comes first.
        """
        draft, home = self.draft, -1 if self.tight else self._before[module][1]
        hosts = self._scene.hosts[mode] & self._scene.pes
        if home >= 0 and hosts >> home & 1 and draft.fits(module, mode, home):
            yield home
        if self.adopting:
            return
        cpu = draft.cpu
        others = [pe for pe in range(len(cpu)) if hosts >> pe & 1 and pe != home and draft.fits(module, mode, pe)]
        others.sort(key=cpu.__getitem__, reverse=not self.tight)
        yield from others
        if others:
            return
        self.short |= hosts
        if self.moving and not self._tables.rules.rivals[module] & draft.running:
            cleared = next((pe for pe in range(len(cpu)) if hosts >> pe & 1 and self._clear(module, mode, pe)), None)
            if cleared is not None:
                yield cleared

    def _clear(self, module: int, mode: int, pe: int) -> bool:
        """Move modules from a PE, one by one, until a mode fits there; tell whether it fits.

        Of the modules that fit elsewhere, the smallest one that makes enough room is moved. If no single module makes
        enough room, the largest one is moved, and then the search goes on. If the mode does not fit in the end, the
        draft is unchanged.
        """
        draft, tables = self.draft, self._tables
        mark, here = draft.mark(), draft.on[pe]
        left = [other for other in range(len(draft.mode)) if here >> other & 1]
        left.sort(key=lambda other: tables.sizes.size[draft.mode[other]])
        while not draft.fits(module, mode, pe):
            missing = (
                tables.sizes.cpu[mode] - draft.cpu[pe],
                tables.sizes.ram[mode] - draft.ram[pe],
                tables.sizes.flash[module] - draft.flash[pe],
            )
            enough = [other for other in left if self._frees(other, missing)] or left[::-1]
            moved = next((other for other in enough if self._move_away(other, pe)), None)
            if moved is None:
                draft.undo(mark)
                return False
            left.remove(moved)
        return True

    def _frees(self, module: int, missing: tuple[int, int, int]) -> bool:
        """Tell whether a module takes at least the CPU, RAM and flash that are missing, so that moving it frees enough.

        missing: CPU, RAM and flash, in the units of `Sizes`.
        """
        tables, mode = self._tables, self.draft.mode[module]
        cpu, ram, flash = missing
        return tables.sizes.cpu[mode] >= cpu and tables.sizes.ram[mode] >= ram and tables.sizes.flash[module] >= flash

    def _move_away(self, module: int, pe: int) -> bool:
        self._budget -= 1
        draft, mode = self.draft, self.draft.mode[module]
        hosts = self._scene.hosts[mode] & self._scene.pes & ~(1 << pe)
        cpu, need = draft.cpu, self._tables.sizes.cpu[mode]
        return any(hosts >> one & 1 and cpu[one] >= need and draft.move(module, one) for one in range(len(cpu)))

    def switch(self, module: int, mode: int, *, may_worsen: bool = False) -> bool:
        """Put a running module into another mode; tell whether this was possible.

        All modules that read from the module must accept the mode.

        may_worsen: whether the new mode may be worth less to a function than the old mode.
        """
        draft, tables, weight = self.draft, self._tables, self._wanted.weight
        old, pe = draft.mode[module], draft.pe[module]
        if self.busy >> module & 1 or not self._scene.possible >> mode & 1:
            return False
        if not may_worsen and weight.get(mode, 0) < weight.get(old, 0):
            return False
        readers = [leaf for leaf in draft.consumers[module] if tables.leaves.module[leaf] != module]
        if any(mode not in tables.leaves.worth[leaf] for leaf in readers):
            return False
        mark = draft.mark()
        for leaf in readers:
            draft.unwire(leaf, tables.leaves.module[leaf])
        draft.drop_inputs(module)
        draft.stop(module)
        stopped = draft.mark()
        for place in (pe, -1):
            if self.run(module, mode, place) and all(self._feed_again(leaf, module) for leaf in readers):
                return True
            draft.undo(stopped)
        draft.undo(mark)
        return False

    def _feed_again(self, leaf: int, producer: int) -> bool:
        """Wire a leaf to a producer again, if the reading module still runs in the mode to which the leaf belongs.

        Returns whether the leaf is wired now.
        """
        draft, tables = self.draft, self._tables
        consumer = tables.leaves.module[leaf]
        return draft.mode[consumer] == tables.leaves.mode[leaf] and draft.wire(leaf, consumer, producer)

    # Gates

    def hold(self, node: Node, consumer: int, *, may_start: bool) -> bool:
        """Wire as few inputs as are needed to satisfy a gate; tell whether the gate is satisfied.

        If False is returned, the caller must undo what was changed in the draft.

        may_start: whether producers that do not run may be started.
        """
        most, number, inputs, cheapest = node
        if most == LEAF:
            return self.feed(number, consumer, may_start=may_start)
        if number == len(inputs):
            for one in inputs:  # noqa: SIM110 - a chain of modules is as deep as its calls: no generators between
                if not self.hold(one, consumer, may_start=may_start):
                    return False
            return True
        if self.adopting:
            return len(self._held(inputs, number, consumer, may_start=True)) == number
        held = self._held(inputs, number, consumer, may_start=False)
        if may_start and len(held) < number:
            others = [one for one in cheapest if one not in held]
            held += self._held(others, number - len(held), consumer, may_start=True)
        return len(held) == number

    def _held(self, inputs: Iterable[Node], most: int, consumer: int, *, may_start: bool) -> list[Node]:
        """Make inputs of a gate hold, one after the other, until `most` of them do; return those that hold."""
        held: list[Node] = []
        for one in inputs:
            if len(held) == most:
                break
            mark = self.draft.mark()
            if self.hold(one, consumer, may_start=may_start):
                held.append(one)
            else:
                self.draft.undo(mark)
        return held

    def feed(self, leaf: int, consumer: int, *, may_start: bool) -> bool:
        """Wire a leaf to a running producer, or start a producer for the leaf; tell whether the leaf is wired."""
        before, mode_of, givers = self._before, self.draft.mode, self._tables.orders.dearest[leaf]
        if not self.adopting:
            for mode, module in givers:
                if mode_of[module] == mode and self.draft.wire(leaf, consumer, module):
                    return True
            if not may_start:
                return False
            givers = [giver for giver in self._tables.orders.cheapest[leaf] if mode_of[giver[1]] != giver[0]]
            if len(givers) > 1:
                givers.sort(key=lambda giver: before[giver[1]][0] != giver[0])
        for mode, module in givers:  # noqa: SIM110 - as above
            if self.feed_from(leaf, consumer, mode, module):
                return True
        return False

    def feed_from(self, leaf: int, consumer: int, mode: int, module: int) -> bool:
        """Wire a leaf of the module `consumer` to `module` in `mode`; tell whether the leaf is wired.

        If `module` does not run, it is started in `mode`; if it runs in another mode, it is switched to `mode`.
        """
        draft = self.draft
        mark, now = draft.mark(), draft.mode[module]
        if self.adopting and self._before[module][0] != mode:
            return False
        draft.refused = False
        if self._gets_into(module, mode) and draft.wire(leaf, consumer, module):
            return True
        draft.undo(mark)
        near = draft.pe[consumer]  # on the consumer's PE, where no bus is needed
        if now < 0 and draft.refused and not self.adopting and self.run(module, mode, near):
            if draft.wire(leaf, consumer, module):
                return True
            draft.undo(mark)
        return False

    def _gets_into(self, module: int, mode: int) -> bool:
        now = self.draft.mode[module]
        if now < 0:
            return self.run(module, mode)
        return now == mode or (not self.adopting and self.switch(module, mode))
