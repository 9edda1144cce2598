"""Writes a fault tree as a spec: one device for each basic event, and one module for each gate.

A gate of the tree is true when something has failed, and a module runs when its needs hold: so an OR of failures needs
all its inputs, an AND any one of them, and "at least k of n have failed" needs n - k + 1 that work. Then the command
`heronry cutsets SPEC FUNCTION --kinds device` has the cut sets of the tree.
"""

from collections.abc import Iterator, Mapping
from typing import Final

from heronry_tools.analysis.reliability.formula import FALSE, LEAF, TRUE, Formula
from heronry_tools.analysis.reliability.open_psa.reading import Tree
from heronry_tools.console.errors import UserError
from heronry_wire.identifiers import STANDARD_DATA_IDS

_MODULES_OF_A_PE: Final = 100
_MOST_NAME: Final = 64


def spec_text(tree: Tree, name: str) -> str:
    """Return the text of a spec with one function for each top gate of a tree; raises UserError if it is too large."""
    formula = tree.formula
    tops = {top: tree.gates[top] for top in tree.tops}
    nodes = sorted({node for top in tops.values() for node in formula.below(top)} - {FALSE, TRUE})
    names = _names(tree, nodes)
    if len(nodes) > len(STANDARD_DATA_IDS):
        raise UserError(f"the tree has {len(nodes)} events and gates, but a bus has only {len(STANDARD_DATA_IDS)} data")
    events = [node for node in nodes if formula.least[node] == LEAF]
    constants = [top for top, node in tops.items() if node in (FALSE, TRUE)]
    if constants:
        raise UserError(f"gate {constants[0]} does not depend on any basic event; there is nothing to analyse")
    pes = -(-(len(nodes) + len(tops)) // _MODULES_OF_A_PE)
    hosts = {node: f"pe_{index // _MODULES_OF_A_PE + 1}" for index, node in enumerate(nodes)}
    lines = ["dg: 1", f"name: {_word(name)}", "buses: {bus: {bitrate: 1000000}}", "pes:"]
    lines += [
        f"  pe_{n}: {{node_id: {91 + n}, buses: [bus], cpu: 1, ram: 1MiB, flash: 1MiB}}" for n in range(1, pes + 1)
    ]
    lines += ["devices:", *(f"  {names[one]}: {_device(tree, formula.names[one], hosts[one])}" for one in events)]
    lines += ["variables:"]
    lines += [
        f"  {names[one]}: {{type: NODATA, identifier: {identifier}}}"
        for one, identifier in zip(nodes, STANDARD_DATA_IDS, strict=False)
    ]
    lines += ["modules:", *(f"  {names[one]}: {_module(formula, names, one, hosts[one])}" for one in nodes)]
    taken = set(names.values())
    functions = {top: _free(f"{_word(top)}_works", taken) for top in tops}
    lines += [
        f"  {functions[top]}: {{needs: {names[node]}, runs_on: [pe_{pes}], cpu: 0.001, ram: 1, rate_hz: 1}}"
        for top, node in tops.items()
    ]
    lines += ["functions:", *(f"  {_word(top)}: {{output: {functions[top]}}}" for top in tops)]
    lines += list(_common(tree, {formula.names[one]: names[one] for one in events}))
    return "\n".join(lines) + "\n"


def _device(tree: Tree, event: str, pe: str) -> str:
    chance = ""
    if event in tree.rates:
        chance = f", rate_per_h: {tree.rates[event]!r}"
    elif event in tree.demands:
        chance = f", probability: {tree.demands[event]!r}"
    return f"{{kind: sensor, pe: {pe}{chance}}}"


def _module(formula: Formula, names: Mapping[int, str], node: int, pe: str) -> str:
    gives = f"gives: {{{names[node]}: 1}}, cpu: 0.001, ram: 1, rate_hz: 1"
    if formula.least[node] == LEAF:
        return f"{{device: {names[node]}, {gives}}}"
    inputs = formula.inputs[node]
    read = ", ".join(names[one] for one in inputs)
    working = len(inputs) - formula.least[node] + 1
    needs = f"{{and: [{read}]}}" if working == len(inputs) else f"{{or: {{k: {working}, of: [{read}]}}}}"
    return f"{{needs: {needs}, runs_on: [{pe}], {gives}}}"


def _common(tree: Tree, names: Mapping[str, str]) -> Iterator[str]:
    groups = [(tuple(one for one in members if one in names), beta) for members, beta in tree.common]
    groups = [(members, beta) for members, beta in groups if len(members) > 1]
    if groups:
        yield "common_cause:"
    for members, beta in groups:
        yield f"  - {{elements: [{', '.join(f'device:{names[one]}' for one in members)}], beta: {beta!r}}}"


def _names(tree: Tree, nodes: list[int]) -> dict[int, str]:
    called = {node: gate for gate, node in tree.gates.items()} | tree.formula.names
    taken: set[str] = set()
    return {node: _free(_word(called.get(node, f"gate_{node}")), taken) for node in nodes}


def _word(text: str) -> str:
    word = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in text)
    return (word if word[:1].isalpha() else f"x{word}")[: _MOST_NAME - 8]


def _free(word: str, taken: set[str]) -> str:
    free, number = word, 2
    while free in taken:
        free, number = f"{word}_{number}", number + 1
    taken.add(free)
    return free
