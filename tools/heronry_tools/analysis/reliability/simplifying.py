"""Makes a formula smaller before a diagram is made of it. A fault tree with shared parts often falls to a small one.

Three rewritings are repeated while they help; each keeps the value of the root:

    what stands beside   In `f or h` the rest `h` matters only while f is false, so `h` may be read with f false; in
                         `f and h` it may be read with f true. If an OR is false, so are its inputs; if an AND is
                         true, so are they. A node that is read in several places keeps what is known in all of them.
                         Of the inputs of a gate each is read so by those after it alone: two that both rely on each
                         other might both drop what they share
    what decides         If a gate g is true whenever x is, g is `x or h`, where h is g with x false; if g is false
                         whenever x is, g is `x and h`, with x true in h. So x moves up, and its other places below go
    what goes together   Inputs that the same gates read, all of them ORs or all of them ANDs, get a gate of their own
"""

from typing import Final

from heronry_tools.analysis.reliability.formula import FALSE, LEAF, TRUE, Formula

_ROUNDS: Final = 6
_EFFORT: Final = 40_000  # nodes that are looked at without a gain until moving nodes up ends


def simplified(formula: Formula, root: int) -> int:
    """Return a node of the same value as `root` that depends on less, if one is found."""
    for _ in range(_ROUNDS):
        before = root
        root = _read_in_context(formula, root)
        root = _decided(formula, root)
        root = _together(formula, root)
        if root == before:
            break
    return root


def _edges(formula: Formula, root: int) -> int:
    return sum(len(formula.inputs[node]) for node in formula.below(root))


def _readers(formula: Formula, nodes: list[int]) -> dict[int, list[int]]:
    readers: dict[int, list[int]] = {node: [] for node in nodes}
    for node in nodes:
        for one in formula.inputs[node]:
            readers[one].append(node)
    return readers


def _read_in_context(formula: Formula, root: int) -> int:
    """Read each node with what is known to be false or true wherever it is read; bits of integers stand for nodes."""
    nodes = formula.below(root)
    bit = {node: 1 << index for index, node in enumerate(nodes)}
    false, true = _known(formula, nodes, bit)
    now: dict[int, int] = {}
    for node in nodes:
        if bit[node] & false[node]:
            now[node] = FALSE
        elif bit[node] & true[node]:
            now[node] = TRUE
        elif formula.least[node] == LEAF:
            now[node] = node
        else:
            now[node] = formula.at_least(formula.least[node], [now[one] for one in formula.inputs[node]])
    return now[root]


def _known(formula: Formula, nodes: list[int], bit: dict[int, int]) -> tuple[dict[int, int], dict[int, int]]:
    """Give, for each node, the nodes below it that are known to be false, and to be true, wherever it is read."""
    below, if_false, if_true = _consequences(formula, nodes, bit)
    false, true = {nodes[-1]: 0}, {nodes[-1]: 0}
    for node in reversed(nodes):
        inputs, least = formula.inputs[node], formula.least[node]
        here_false, here_true = false[node], true[node]
        if bit[node] & (here_false | here_true):
            here_false = here_true = -1  # then the inputs are not read here
        for one in sorted(inputs, key=lambda one: (formula.least[one] != LEAF, one)):
            false[one] = here_false & below[one] & false.get(one, -1)
            true[one] = here_true & below[one] & true.get(one, -1)
            if least == 1:
                here_false |= if_false[one]
            elif least == len(inputs):
                here_true |= if_true[one]
    return false, true


def _consequences(formula: Formula, nodes: list[int], bit: dict[int, int]) -> tuple[dict[int, int], ...]:
    """Give, for each node, what it depends on, what is false if it is, and what is true if it is; itself included."""
    below, if_false, if_true = dict(bit), dict(bit), dict(bit)
    for node in nodes:
        inputs, least = formula.inputs[node], formula.least[node]
        for one in inputs:
            below[node] |= below[one]
            if least == 1:
                if_false[node] |= if_false[one]
            if least == len(inputs):
                if_true[node] |= if_true[one]
    return below, if_false, if_true


def _decided(formula: Formula, root: int) -> int:
    """Move nodes up that alone decide about a gate."""
    nodes = formula.below(root)
    readers = _readers(formula, nodes)
    size, effort = _edges(formula, root), _EFFORT
    for node in sorted(nodes, key=lambda one: (-len(readers[one]), -one)):  # most is gained where most is read
        for value in (TRUE, FALSE):
            if len(readers.get(node, ())) < 2 or effort < 0:
                break
            effort -= len(nodes)
            above = _above(readers, node)
            tops = _decides(formula, root, readers, node, above, value=value)
            if not tops:
                continue
            join = formula.any_of if value == TRUE else formula.all_of
            other = FALSE if value == TRUE else TRUE
            rests = formula.each_with_replaced(tops, {node: other}, above)
            changed = {top: join([node, rest]) for top, rest in rests.items()}
            new = formula.with_replaced(root, changed, above)
            effort -= 4 * len(nodes)
            now = _edges(formula, new)
            if now < size:
                root, size, effort = new, now, _EFFORT
                nodes = formula.below(root)
                readers = _readers(formula, nodes)
    return root


def _above(readers: dict[int, list[int]], node: int) -> set[int]:
    """Return the gates that depend on a node."""
    above, waiting = set[int](), [node]
    while waiting:
        for gate in readers[waiting.pop()]:
            if gate not in above:
                above.add(gate)
                waiting.append(gate)
    return above


def _decides(
    formula: Formula, root: int, readers: dict[int, list[int]], node: int, above: set[int], *, value: int
) -> list[int]:
    """Return the topmost gates that have a value whenever a node has it, if the node can move up to them."""
    forced = {node}
    for gate in sorted(above):
        inputs, least = formula.inputs[gate], formula.least[gate]
        needed = least if value == TRUE else len(inputs) - least + 1
        if sum(one in forced for one in inputs) >= needed:
            forced.add(gate)
    tops = [gate for gate in forced if gate != node and (gate == root or any(r not in forced for r in readers[gate]))]
    near = [one for one in tops if node in formula.inputs[one] and (formula.least[one] == 1) == (value == TRUE)]
    return tops if len(near) < len(tops) else []


def _together(formula: Formula, root: int) -> int:
    """Give a gate of their own to inputs that the same gates read, if these are all ORs or all ANDs."""
    nodes = formula.below(root)
    merged = _merged(formula, nodes)
    now: dict[int, int] = {}

    def value(node: int) -> int:
        """Return what a node became; a gate of merged inputs is made anew from what they became."""
        found = now.get(node)
        if found is None:
            found = now[node] = formula.at_least(formula.least[node], [now[one] for one in formula.inputs[node]])
        return found

    for node in nodes if merged else ():
        if formula.least[node] == LEAF:
            now[node] = node
            continue
        its = merged.get(node, {})
        new = [value(one) for one in dict.fromkeys(its.get(one, one) for one in formula.inputs[node])]
        now[node] = formula.at_least(len(new) if formula.least[node] > 1 and its else formula.least[node], new)
    return now.get(root, root)


def _merged(formula: Formula, nodes: list[int]) -> dict[int, dict[int, int]]:
    """Give, by gate and input, the gate that is to stand for the input and others."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for node, gates in _readers(formula, nodes).items():
        if len(gates) > 1:
            groups.setdefault(tuple(gates), []).append(node)
    merged: dict[int, dict[int, int]] = {}
    for readers, group in groups.items():
        if len(group) < 2:
            continue
        if all(formula.least[gate] == 1 for gate in readers):
            made = formula.any_of(group)
        elif all(formula.least[gate] == len(formula.inputs[gate]) for gate in readers):
            made = formula.all_of(group)
        else:
            continue
        for gate in readers:
            merged.setdefault(gate, {}).update(dict.fromkeys(group, made))
    return merged
