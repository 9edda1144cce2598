"""The steps by which the greedy planner makes a new configuration from the configuration that ran before.

1. *Adopt*: keep functions that can still run as they did, the most important first.
2. *Serve* the other functions, the most important first, in the room that is left.
3. *Make room* for each function that found no room:
   - Switch the modules that run on full PEs to cheaper modes, as far as no function loses value.
   - Stop functions that matter less, and put other functions into worse modes, one by one until the function fits.
   - Then serve the stopped functions again, as far as possible.
   - Undo all of this if the configuration is not better at levels 1 and 2 than before.
4. *Improve*: put functions into better modes, as far as there is room.

Inputs (level 3) come last, once every function is served as well as possible (`supplying`).
"""

from typing import Final

from heronry_manager.planner.greedy.draft import Draft
from heronry_manager.planner.greedy.punctuality import Punctuality, Watch
from heronry_manager.planner.greedy.scene import Scene
from heronry_manager.planner.greedy.serving import Before, Server
from heronry_manager.planner.greedy.supplying import supply
from heronry_manager.planner.greedy.tables import Tables
from heronry_manager.planner.greedy.wanted import Goal, Wanted

_TRIES: Final = 40  # functions stopped or worsened in all, to make room
_SWITCH_FUEL: Final = 10  # modules tried in order to put one into another mode
_LOOKS_FOR_FUNCTIONS: Final = 3000  # budget of messages for a `Watch`
_LOOKS_FOR_INPUTS: Final = 1500


class Repair:
    """Makes one draft for one situation from the configuration that ran before."""

    def __init__(self, tables: Tables, wanted: Wanted, scene: Scene, before: Before) -> None:
        """Start with no module.

        before: the mode and the PE in which each module ran; or, if modules are to be placed anew, those that
            `packings` proposes.
        """
        self.draft = Draft(tables, scene)
        self._server = Server(tables, wanted, scene, self.draft, before)
        self._tables, self._wanted, self._scene = tables, wanted, scene
        self._tries = _TRIES

    def run(self, punctuality: Punctuality | None = None) -> None:
        """Serve the wanted functions by steps 1 to 4 of this file, as well as possible at levels 1 and 2.

        punctuality: if it is given, the result also meets all deadlines; None: it may miss deadlines.
        """
        goals = self._wanted.goals
        self._server.adopt(goals)
        if punctuality is not None:
            in_time = punctuality.are_met(self.draft)  # as a rule it is, since it ran before
            self.draft.may_publish = Watch(punctuality, _LOOKS_FOR_FUNCTIONS).may_publish
            if not in_time:
                self.draft.undo(0)
                self._server.adopt(goals)
        for goal in goals:
            self._server.serve(goal)
        for goal in self.unserved():
            self._make_room(goal)
        self._improve()
        self._sweep()

    def supply(self, punctuality: Punctuality) -> None:
        """Wire optional inputs, and wire inputs to better versions (level 3).

        A draft that meets all deadlines still meets them afterwards.
        """
        mark = self.draft.mark()
        self.draft.may_publish = None
        supply(self.draft, self._server, self._tables)
        if not punctuality.are_met(self.draft):
            self.draft.undo(mark)
            self.draft.may_publish = Watch(punctuality, _LOOKS_FOR_INPUTS).may_publish
            supply(self.draft, self._server, self._tables)
        self._sweep()

    def score(self) -> int:
        """Return the value of the draft at levels 1 and 2 as one number; a greater one is better."""
        return self._wanted.score(self.draft.mode)

    def unserved(self) -> list[Goal]:
        """Return the functions that are not served, although a mode that serves them is possible in this situation."""
        possible = self._scene.possible
        return [
            goal
            for goal in self._wanted.goals
            if not self._server.is_served(goal) and any(possible >> mode & 1 for mode in goal.modes)
        ]

    def _sweep(self) -> None:
        self.draft.sweep(self._wanted.outputs)

    # Making room

    def _make_room(self, goal: Goal) -> None:
        mark, before = self.draft.mark(), self.score()
        if self._server.serve(goal):
            return
        self._shrink(self._server.short)
        if not self._server.serve(goal) and not self._serve_instead(goal):
            self.draft.undo(mark)
            return
        self._improve()
        if self.score() <= before:
            self.draft.undo(mark)

    def _serve_instead(self, goal: Goal) -> bool:
        """Serve `goal` at the expense of other functions; tell whether it is served now.

        The other functions are taken one by one, in the order of `_in_the_way`, until `goal` can be served or no tries
        are left. A function that is less important than `goal` is stopped. Any other function is put into a cheaper
        mode. When `goal` is served, these functions are served again if possible.
        """
        stopped = []
        for other, matters_less in self._in_the_way(goal):
            if self._tries <= 0:
                return False
            if not self._server.is_served(other):
                continue  # it shared an output with a stopped function
            self._tries -= 1
            if not (self._stop(other) if matters_less else self._worsen(other)):
                continue
            stopped.append(other)
            if self._server.serve(goal):
                for one in reversed(stopped):
                    self._server.serve(one)
                return True
        return False

    def _in_the_way(self, goal: Goal) -> list[tuple[Goal, bool]]:
        """Return all other served functions, each with True if it is less important than `goal`.

        Functions that use a PE where room is short come first, and then all others. In both groups, the least
        important function comes first.
        """
        goals, short = self._wanted.goals, self._server.short
        number = goals.index(goal)
        served = [(other, at) for at, other in enumerate(goals) if at != number and self._server.is_served(other)]
        served.sort(key=lambda other: (not self._uses(other[0], short), -other[1]))
        return [(other, at > number) for other, at in served]

    def _uses(self, goal: Goal, pes: int) -> bool:
        """Tell whether the output of a function, or a module that feeds the output, runs on one of these PEs.

        pes: a set of PEs, as the bits of an integer.
        """
        draft, seen = self.draft, 0
        frontier = [module for module in goal.outputs if draft.mode[module] >= 0]
        while frontier:
            module = frontier.pop()
            if pes >> draft.pe[module] & 1:
                return True
            if not seen >> module & 1:
                seen |= 1 << module
                leaves = self._tables.leaves.of_mode[draft.mode[module]]
                frontier += [draft.feeder[leaf] for leaf in leaves if draft.feeder[leaf] >= 0]
        return False

    def _stop(self, goal: Goal) -> bool:
        module = self._output(goal)
        if self.draft.consumers[module]:
            return False
        self.draft.drop_inputs(module)
        self.draft.stop(module)
        self._sweep()
        return True

    def _worsen(self, goal: Goal) -> bool:
        """Put the output module of a function into a cheaper mode; tell whether that was possible."""
        module = self._output(goal)
        modes, price = self._tables.numbers.modes_of[module], self._tables.orders.price
        now = price[self.draft.mode[module]]
        for mode in sorted((mode for mode in modes if price[mode] < now), key=price.__getitem__):
            if self._switch(module, mode, may_worsen=True):
                return True
        return False

    def _shrink(self, pes: int) -> None:
        """Switch each module that runs on one of these PEs to the cheapest mode that is possible for it.

        The new mode must add as much to levels 1 and 2 as the present one. If no cheaper mode is possible, the
        module keeps its mode.

        pes: the set of PEs, as bits by number of the PE.
        """
        weight, size = self._wanted.weight, self._tables.sizes.size
        for module, mode in enumerate(self.draft.mode):
            if mode >= 0 and pes >> self.draft.pe[module] & 1:
                cheaper = [one for one in self._tables.numbers.modes_of[module] if size[one] < size[mode]]
                cheaper = [one for one in cheaper if weight.get(one) == weight.get(mode)]
                any(self._switch(module, one) for one in sorted(cheaper, key=size.__getitem__))

    def _switch(self, module: int, mode: int, *, may_worsen: bool = False) -> bool:
        self._server.fuel = _SWITCH_FUEL
        done = self._server.switch(module, mode, may_worsen=may_worsen)
        if done:
            self._sweep()
        return done

    # Improving

    def _improve(self) -> None:
        """Serve each function that can be served now, and put its output module into the best possible mode.

        Functions that were served before are improved, too. No output module gets a worse mode.
        """
        weight, modes_of = self._wanted.weight, self._tables.numbers.modes_of
        for goal in self._wanted.goals:
            if self._server.serve(goal):
                module = self._output(goal)
                now = weight[self.draft.mode[module]]
                better = [mode for mode in modes_of[module] if weight[mode] > now]
                any(self._switch(module, mode) for mode in sorted(better, key=lambda mode: -weight[mode]))

    def _output(self, goal: Goal) -> int:
        return next(module for module in goal.outputs if self.draft.mode[module] >= 0)
