"""Loads a spec: from bytes to a checked `model.Spec`, or to a `SpecError` with all findings.

The stages, each with the files that do it:

    yaml_source                      reads the bytes into a tree of values with their places in the file
    draft, schema, quantities        read elements and their keys, which `model` declares, in exact numbers
    reference_rules                  checks names and numbers against one another
    expression_reader, gate_rules    read gates, replace the name of a gate by its expression, and check the gates
    this file                        fills in what elements decide for one another, if no finding stops it
    meaning                          names the model by its digest
    demux_paths                      checks the paths behind DEMUXes in the model
"""

import gc
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from heronry_dg import yaml_source
from heronry_dg.demux_paths import check_demux_paths
from heronry_dg.draft import Draft, Element, ModuleElement, read_draft
from heronry_dg.field_types import NAME_PATTERN
from heronry_dg.findings import Findings, Place
from heronry_dg.gate_rules import Gates, read_gates
from heronry_dg.gates import leaves
from heronry_dg.keys import keys_of
from heronry_dg.meaning import with_digest
from heronry_dg.misspelt import blame_declarations
from heronry_dg.model import Bus, Demux, Function, Header, Manager, Module, Phase, Spec, Variable
from heronry_dg.reference_rules import check_references, initial_value
from heronry_dg.rules import file as file_rules

SUFFIX = ".dg.yaml"

V = TypeVar("V")


@dataclass(frozen=True, slots=True)
class Loaded:
    """A spec, with the draft and the gates from which it was built.

    The draft and the gates also hold the place of each part in the file.
    """

    draft: Draft
    gates: Gates
    spec: Spec


def load(path: str | Path) -> Spec:
    """Load the spec in a file; raises SpecError, also for a file that cannot be read."""
    findings = Findings(str(path))
    data = read_file(Path(path), findings)
    return _spec_of(data, str(path), findings)


def loads(text: str, name: str) -> Spec:
    """Load a spec from text; `name` stands for the file in messages. Raises SpecError."""
    return load_bytes(text.encode("utf-8", "surrogatepass"), name)


def load_bytes(data: bytes, name: str) -> Spec:
    """Load a spec from the bytes of a file that is called `name` in messages; raises SpecError."""
    return _spec_of(data, name, Findings(name))


def read_file(path: Path, findings: Findings) -> bytes | None:
    """Read a file, at most one byte more than a spec may have; gives None, and adds a finding, on an error."""
    try:
        with path.open("rb") as file:
            return file.read(yaml_source.MOST_BYTES + 1)
    except OSError as failure:
        sentence = f"the file cannot be read: {failure.strerror or failure}"
        findings.add(
            file_rules.UNREADABLE, Place(1, 1), sentence, "check the path and the permissions of the spec's file"
        )
        return None


def read(data: bytes, file: str, findings: Findings) -> Loaded | None:
    """Read a spec from bytes; gives None where a finding stops the spec from being loaded."""
    with collector_at_rest():
        return _read(data, file, findings)


def _read(data: bytes, file: str, findings: Findings) -> Loaded | None:
    root = yaml_source.read_tree(data, findings)
    draft = read_draft(root, findings) if root is not None else None
    if draft is None or not draft.readable:
        return None  # if a section cannot be read, every name that it declares would look unknown
    check_references(draft, findings)
    gates = read_gates(draft, findings)
    if findings:
        blame_declarations(draft, findings)
        return None
    spec = with_digest(_built(draft, gates, _name_of(file)))
    check_demux_paths(draft, spec, findings)
    return Loaded(draft, gates, spec) if not findings else None


@contextmanager
def collector_at_rest() -> Iterator[None]:
    """Switch Python's garbage collector off while a spec is loaded.

    Loading leaves no cyclic garbage, and repeated searches for garbage would take quadratic time.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _spec_of(data: bytes | None, file: str, findings: Findings) -> Spec:
    loaded = read(data, file, findings) if data is not None else None
    if loaded is None:
        raise findings.error()
    return loaded.spec


def _name_of(file: str) -> str:
    name = re.sub(r"\W", "_", Path(file).name.removesuffix(SUFFIX), flags=re.ASCII)
    return name if re.fullmatch(NAME_PATTERN, name) else "spec"


def _built(draft: Draft, gates: Gates, file_name: str) -> Spec:
    """Build the model of a draft without findings: what other elements decide is filled in."""
    header = _of(draft.header)
    buses = _forms(draft.buses)
    demuxes = {name: _demux(demux, gates) for name, demux in _forms(draft.demuxes).items()}
    given: dict[str, Any] = {one.field: getattr(header, one.field) for one in keys_of(Header)}
    return Spec(
        **{**given, "name": header.name or file_name},
        digest="",
        buses=buses,
        pes=_forms(draft.pes),
        devices=_forms(draft.devices),
        variables={name: _variable(variable) for name, variable in _forms(draft.variables).items()},
        manager=_manager(_of(draft.manager.form), buses),
        demuxes=demuxes,
        shorthands=gates.shorthands,
        modules={name: _module(module, gates) for name, module in draft.modules.items()},
        functions={name: _function(function, demuxes) for name, function in _forms(draft.functions).items()},
        phases={name: _phase(phase, list(draft.phases)) for name, phase in _forms(draft.phases).items()},
        plants=_forms(draft.plants),
        contingency=_of(draft.contingency.form),
    )


def _manager(manager: Manager, buses: Mapping[str, Bus]) -> Manager:
    first_wired = next((bus.name for bus in buses.values() if bus.kind == "wired"), None)
    return replace(manager, bus=_of(manager.bus or first_wired))


def _variable(variable: Variable) -> Variable:
    if variable.initial is None:
        return variable
    return replace(variable, initial=initial_value(variable.initial, variable.type))


def _demux(demux: Demux, gates: Gates) -> Demux:
    needs = gates.demuxes[demux.name]
    variable = next(leaf.variable for _, leaf in leaves(needs))
    return replace(demux, variable=variable, branches=gates.branches[demux.name], needs=needs)


def _module(module: ModuleElement, gates: Gates) -> Module:
    form = _of(module.form)
    modes = {
        name: mode if (needs := gates.needs[module.name, name]) is None else replace(mode, needs=needs)
        for name, mode in _forms(module.modes).items()
    }
    return replace(form, image=form.image or module.name, modes=modes)


def _function(function: Function, demuxes: Mapping[str, Demux]) -> Function:
    output = function.output
    return replace(function, outputs=demuxes[output].ends if output in demuxes else (output,))


def _phase(phase: Phase, order: list[str]) -> Phase:
    if phase.when is None or phase.when.origins:
        return phase
    return replace(phase, when=replace(phase.when, origins=tuple(order[: order.index(phase.name)])))


def _forms(elements: Mapping[str, Element[V]]) -> dict[str, V]:
    return {name: _of(element.form) for name, element in elements.items()}


def _of(value: V | None) -> V:
    """Return `value`; raises AssertionError for None, which can occur only in a spec with findings."""
    if value is None:
        raise AssertionError("a field of the spec has no value, although the check found no mistake")
    return value
