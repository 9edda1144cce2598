"""Writes the failure of a function as a fault tree in the Open-PSA Model Exchange Format, version 2.0d.

Each element is a basic event, under a name that the format allows, with the element as its label. An element that has a
common cause is a gate over its own failure and the cause, so that a reader needs no option to take it into account. The
length of the mission stands beside each rate.
"""

from collections.abc import Iterator
from xml.sax.saxutils import escape, quoteattr

from heronry_tools.analysis.reliability.chances import Hazards
from heronry_tools.analysis.reliability.formula import FALSE, LEAF, TRUE, Formula


def fault_tree(name: str, formula: Formula, root: int, hazards: Hazards, hours: float) -> str:
    """Return a node of a formula as an Open-PSA model whose one fault tree has `name` as its top gate.

    An event without a rate or probability gets the probability 0, and a comment that says so.
    """
    root = hazards.with_causes(formula, root)
    names = _Names(name, formula, root)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        "<opsa-mef>",
        f"  <define-fault-tree name={quoteattr(names.tree)}>",
        f"    <define-gate name={quoteattr(names.top)}>",
        f"      <label>{escape(name)} is lost</label>",
        f"      {_body(names, formula, root)}",
        "    </define-gate>",
    ]
    lines += [
        f'    <define-gate name="{names.of[node]}">{_body(names, formula, node)}</define-gate>'
        for node in reversed(formula.below(root))
        if formula.least[node] != LEAF and node != root
    ]
    lines += ["  </define-fault-tree>", "  <model-data>", *_events(names, formula, root, hazards, hours)]
    return "\n".join([*lines, "  </model-data>", "</opsa-mef>"]) + "\n"


class _Names:
    """Names of the nodes of a formula that the format allows: letters, digits, and single `-` and `_` between them."""

    def __init__(self, name: str, formula: Formula, root: int) -> None:
        taken: set[str] = set()
        self.tree = _free(f"{name}-lost", taken)
        self.top = _free(name, taken)
        self.of = {node: _free(formula.names[node], taken) for node in formula.below(root) if node in formula.names}
        gates = (node for node in formula.below(root) if formula.least[node] != LEAF and node != root)
        self.of |= {node: _free(f"gate-{number}", taken) for number, node in enumerate(gates, 1)}


def _free(text: str, taken: set[str]) -> str:
    parts = "".join(
        letter if letter.isascii() and letter.isalnum() else "-" if letter != "_" else "_" for letter in text
    )
    words = [word for word in parts.replace("_", " _ ").replace("-", " ").split() if word]
    name = ""
    for word in words:
        if word == "_":
            name = name if name.endswith(("_", "-")) or not name else f"{name}_"
        else:
            name = f"{name}{'' if not name or name.endswith('_') else '-'}{word}"
    name = name.rstrip("_-")
    name = name if name[:1].isalpha() else f"x{name}"
    free, number = name, 2
    while free.lower() in taken:
        free, number = f"{name}-{number}", number + 1
    taken.add(free.lower())
    return free


def _body(names: _Names, formula: Formula, node: int) -> str:
    if node in (FALSE, TRUE):
        return f'<constant value="{"true" if node == TRUE else "false"}"/>'
    if node in formula.names:
        return f'<basic-event name="{names.of[node]}"/>'
    inputs = formula.inputs[node]
    inside = "".join(f'<{"basic-event" if one in formula.names else "gate"} name="{names.of[one]}"/>' for one in inputs)
    least = formula.least[node]
    if least == 1:
        return f"<or>{inside}</or>"
    if least == len(inputs):
        return f"<and>{inside}</and>"
    return f'<atleast min="{least}">{inside}</atleast>'


def _events(names: _Names, formula: Formula, root: int, hazards: Hazards, hours: float) -> Iterator[str]:
    chances = hazards.chances(hours)
    rates = hazards.own_rates()
    for node in formula.below(root):
        if node not in formula.names:
            continue
        name = formula.names[node]
        yield f'    <define-basic-event name="{names.of[node]}">'
        yield f"      <label>{escape(name)}</label>"
        if name in rates:
            parts = f'<float value="{rates[name]!r}"/><float value="{hours!r}"/>'
            yield f"      <exponential>{parts}</exponential>"
        else:
            if name not in chances:
                yield "      <!-- no rate and no probability is known of it -->"
            yield f'      <float value="{chances.get(name, 0.0)!r}"/>'
        yield "    </define-basic-event>"
