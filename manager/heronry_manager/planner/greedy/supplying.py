"""Level 3 of the greedy plan: optional inputs, and better versions for inputs that are wired already.

Every running module is checked, including modules that are started here. For each of its open inputs a producer is
tried. For each of its wired inputs a producer of a version that is worth more is tried. No module is moved for an
input, and no function is served in another way.

There are two rounds. In the first round only producers in the mode in which they ran before are tried, so that new
inputs do not take the room of old inputs. In the second round all producers are tried.
"""

from typing import Final

from heronry_manager.planner.greedy.draft import Draft
from heronry_manager.planner.greedy.leaves import LEAF, Node
from heronry_manager.planner.greedy.serving import Server
from heronry_manager.planner.greedy.tables import Tables

_FUEL: Final = 12  # modules tried for one input


def supply(draft: Draft, server: Server, tables: Tables) -> None:
    """Wire open optional inputs, and rewire wired inputs to producers of versions that are worth more.

    This is done as far as there is room. No module is moved for an input.
    """
    server.moving = False
    for adopting in (True, False):
        server.adopting = adopting
        _go_through(draft, server, tables)
    server.moving = True


def _go_through(draft: Draft, server: Server, tables: Tables) -> None:
    done = 0
    while left := draft.running & ~done:
        low = left & -left
        done |= low
        module = low.bit_length() - 1
        needs = tables.orders.needs[draft.mode[module]]
        if needs is not None and tables.orders.has_choice[draft.mode[module]]:
            server.busy |= low
            _Supplier(draft, server, tables, module).supply(needs)
            server.busy ^= low


class _Supplier:
    """Wires more inputs of one running module, and gives better versions to inputs that are wired already."""

    def __init__(self, draft: Draft, server: Server, tables: Tables, module: int) -> None:
        self._draft, self._server, self._tables, self._module = draft, server, tables, module

    def supply(self, node: Node) -> None:
        """Wire more inputs below a gate that holds already, and rewire wired inputs below it to better versions.

        node: the gate, or a wired leaf, which is only rewired.
        """
        most, number, inputs, _ = node
        if most == LEAF:
            self._improve(number)
        elif number == most == 1:
            self._choose(inputs)
        else:
            for one in inputs:
                if number == len(inputs) or self._holds(one) or (self._has_room(node) and self._try(one)):
                    self.supply(one)

    def _has_room(self, node: Node) -> bool:
        """Tell whether a gate allows one more input to hold, in addition to those that hold already."""
        most, _, inputs, _ = node
        return most == len(inputs) or sum(map(self._holds, inputs)) < most

    def _try(self, node: Node) -> bool:
        mark = self._draft.mark()
        self._server.fuel = _FUEL
        if self._server.hold(node, self._module, may_start=True):
            return True
        self._draft.undo(mark)
        return False

    def _improve(self, leaf: int) -> None:
        """Rewire a leaf, which is wired already, to a producer of a version that is worth more.

        If no such producer can feed the leaf, the leaf keeps its wire.
        """
        draft, worths = self._draft, self._tables.leaves.worth[leaf]
        now = worths[draft.mode[draft.feeder[leaf]]]
        for mode, module in self._tables.orders.dearest[leaf]:
            if worths[mode] <= now:
                return
            mark = draft.mark()
            draft.unwire(leaf, self._module)
            self._server.fuel = _FUEL
            if self._server.feed_from(leaf, self._module, mode, module):
                return
            draft.undo(mark)

    def _choose(self, inputs: tuple[Node, ...]) -> None:
        """In a gate where exactly one input may hold, exchange the input that holds for one that is worth more.

        Only inputs before the one that holds are tried, and the first suitable one is taken. If there is none, the
        input that holds stays. Then the input that holds is supplied (`supply`).
        """
        held = next(one for one in inputs if self._holds(one))
        now = self._points(held)
        for one in inputs[: inputs.index(held)]:
            mark = self._draft.mark()
            self._unwire(held)
            if self._try(one) and self._points(one) > now:
                held = one
                break
            self._draft.undo(mark)
        self.supply(held)

    def _unwire(self, node: Node) -> None:
        most, number, inputs, _ = node
        if most == LEAF and self._draft.feeder[number] >= 0:
            self._draft.unwire(number, self._module)
        for one in inputs:
            self._unwire(one)

    def _points(self, node: Node) -> int:
        most, number, inputs, _ = node
        if most == LEAF:
            feeder = self._draft.feeder[number]
            return self._tables.leaves.worth[number][self._draft.mode[feeder]] if feeder >= 0 else 0
        return sum(map(self._points, inputs))

    def _holds(self, node: Node) -> bool:
        most, number, inputs, _ = node
        if most == LEAF:
            return self._draft.feeder[number] >= 0
        return sum(map(self._holds, inputs)) >= number
