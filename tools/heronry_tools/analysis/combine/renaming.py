"""Where a spec names its elements: each place is edited where a name changes.

Kinds of names: those of `joining`. Variables and named gates share one kind, since an expression may name either. A
feature, a process, an image, a phase, a mode and an option of a device are no names of elements, and stay.
"""

from collections.abc import Iterator, Mapping
from typing import Final

from heronry_tools.analysis.combine.joining import BUS, DATUM, DEVICE, FUNCTION, MODULE, PE, PLANT
from heronry_tools.analysis.combine.spec_text import Document, Edits, Node, fields, scalars

_DECLARED: Final = {  # by section, the kind of the names that it declares
    "buses": BUS,
    "pes": PE,
    "devices": DEVICE,
    "variables": DATUM,
    "gates": DATUM,
    "modules": MODULE,
    "functions": FUNCTION,
    "plants": PLANT,
}
_NAMED: Final = (  # section, key of an element, kind of the names under this key: one name, or lists of names
    ("pes", "buses", BUS),
    ("devices", "pe", PE),
    ("modules", "runs_on", PE),
    ("modules", "device", DEVICE),
    ("gates", "to", MODULE),
    ("plants", "moved_by", DEVICE),
    ("plants", "seen_by", DEVICE),
    ("plants", "affects", PLANT),
)
_OF_ELEMENTS: Final = {"bus": BUS, "pe": PE, "device": DEVICE, "module": MODULE}

Use = tuple[str, str, Node]  # kind, name, and the scalar in which the name stands


def uses(document: Document) -> Iterator[Use]:
    """Yield every name of an element in a spec, where it is declared and where it is used."""
    for section, kind in _DECLARED.items():
        for name, (key, _) in document.elements(section).items():
            yield kind, name, key
    for section, key, kind in _NAMED:
        for _, element in document.elements(section).values():
            if key in fields(element):
                yield from _all(kind, fields(element)[key][1])
    for _, gate in document.elements("gates").values():
        yield from _of_expression(fields(gate)["demux"][1] if "demux" in fields(gate) else gate)
    for _, module in document.elements("modules").values():
        modes = fields(fields(module)["modes"][1]) if "modes" in fields(module) else {}
        for body in (module, *(mode for _, mode in modes.values())):
            yield from _of_mode(body)
    for _, phase in document.elements("phases").values():
        for key, when in fields(phase).values():
            if key.value == "when" and "variable" in fields(when):
                yield from _all(DATUM, fields(when)["variable"][1])
    yield from _of_functions(document)
    yield from _of_the_head(document)


def rename(edits: Edits, renames: Mapping[str, Mapping[str, str]]) -> None:
    """Write new names at all places where a spec has the old ones."""
    document = edits.document
    for kind, name, node in uses(document):
        new = renames.get(kind, {}).get(name)
        if new is not None:
            begin, end = document.begin(node), document.end(node)
            text, value = document.text[begin:end], str(node.value)
            at = text.find(name, text.find(":") + 1)
            if at >= 0:
                edits.replace(begin + at, begin + at + len(name), new)
            else:  # it is written with escapes
                kind_end = value.find(":") + 1
                edits.replace(begin, end, f'"{value[:kind_end]}{value[kind_end:].replace(name, new, 1)}"')


def _all(kind: str, node: Node) -> Iterator[Use]:
    return ((kind, str(one.value), one) for one in scalars(node))


def _of_mode(body: Node) -> Iterator[Use]:
    found = fields(body)
    if "needs" in found:
        yield from _of_expression(found["needs"][1])
    if "gives" in found:
        yield from ((DATUM, name, key) for name, (key, _) in fields(found["gives"][1]).items())


def _of_expression(node: Node) -> Iterator[Use]:
    """Yield the names in a gate expression; its operators, numbers, points and phases are none."""
    found = fields(node)
    if found:
        for key in ("var",) if "var" in found else ("and", "or", "xor", "of"):
            if key in found:
                yield from _of_expression(found[key][1])
    elif isinstance(node.value, str):
        yield DATUM, node.value.partition("@")[0], node
    else:
        for item in node.value:
            yield from _of_expression(item)


def _of_functions(document: Document) -> Iterator[Use]:
    gates = document.elements("gates")
    for _, function in document.elements("functions").values():
        if "output" in fields(function):
            node = fields(function)["output"][1]
            yield DATUM if node.value in gates else MODULE, str(node.value), node


def _of_the_head(document: Document) -> Iterator[Use]:
    head = document.sections()
    if "manager" in head and "bus" in fields(head["manager"][1]):
        yield from _all(BUS, fields(head["manager"][1])["bus"][1])
    for key in ("separate", "together"):
        if key in head:
            yield from _all(MODULE, head[key][1])
    if "common_cause" in head:
        for cause in head["common_cause"][1].value:
            for one in scalars(fields(cause)["elements"][1]):
                element, _, name = str(one.value).partition(":")
                yield _OF_ELEMENTS[element], name, one
