"""Loads a spec: from bytes to a checked `model.Spec`, or to a `SpecError` with all findings.

The stages, each with the files that do it:

    yaml_source                      reads the bytes into a tree of values with their places in the file
    draft, schema, quantities        read elements and their fields, in exact numbers
    reference_rules                  checks names and numbers against one another
    expression_reader, gate_rules    read gates, replace the name of a gate by its expression, and check the gates
    this file                        builds the model, but only if no finding stops the spec from being loaded
    meaning                          names the model by its digest
    demux_paths                      checks the paths behind DEMUXes in the model
"""

import gc
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from heronry_dg import schema, yaml_source
from heronry_dg.demux_paths import check_demux_paths
from heronry_dg.draft import Draft, Element, ModuleElement, read_draft
from heronry_dg.field_types import DEFAULT_PHASE, NAME_PATTERN
from heronry_dg.findings import Findings, Place
from heronry_dg.gate_rules import Gates, read_gates
from heronry_dg.meaning import with_digest
from heronry_dg.misspelt import blame_declarations
from heronry_dg.model import (
    Bus,
    Contingency,
    Demux,
    Device,
    Function,
    Manager,
    Mode,
    Module,
    Pe,
    Phase,
    Plant,
    Spec,
    Variable,
    When,
)
from heronry_dg.reference_rules import check_references, initial_value
from heronry_dg.rules import file as file_rules
from heronry_dg.schema import Form

SUFFIX = ".dg.yaml"

F = TypeVar("F", bound=Form)
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
    header = _of(draft.header)
    contingency = _of(draft.contingency.form)
    buses = {name: _bus(name, form) for name, form in _forms(draft.buses)}
    demuxes = {
        name: Demux(name, form.demux, gates.branches[name], tuple(form.to)) for name, form in _forms(draft.demuxes)
    }
    return Spec(
        name=header.name or file_name,
        digest="",
        buses=buses,
        manager=_manager(_of(draft.manager.form), buses),
        pes={name: _pe(name, form) for name, form in _forms(draft.pes)},
        devices={name: Device(name, form.kind, form.pe, form.rate_per_h) for name, form in _forms(draft.devices)},
        variables={name: _variable(name, form) for name, form in _forms(draft.variables)},
        demuxes=demuxes,
        shorthands=gates.shorthands,
        modules={name: _module(module, gates) for name, module in draft.modules.items()},
        functions={name: _function(name, form, demuxes) for name, form in _forms(draft.functions)},
        phases={name: _phase(name, form, list(draft.phases)) for name, form in _forms(draft.phases)},
        separate=tuple(tuple(group) for group in header.separate),
        together=tuple(tuple(group) for group in header.together),
        contingency=Contingency(contingency.faults, _optional_tuple(contingency.phases)),
        plants={name: _plant(name, form) for name, form in _forms(draft.plants)},
    )


def _bus(name: str, form: schema.BusForm) -> Bus:
    return Bus(
        name=name,
        bitrate=form.bitrate,
        max_load=form.max_load,
        reserve=form.reserve,
        kind=form.kind,
        channels=form.channels,
        heartbeat_ns=form.heartbeat_ns,
        misses=form.misses,
        rate_per_h=form.rate_per_h,
    )


def _manager(form: schema.ManagerForm, buses: Mapping[str, Bus]) -> Manager:
    first_wired = next((bus.name for bus in buses.values() if bus.kind == "wired"), None)
    return Manager(_of(form.bus or first_wired), form.without_manager)


def _pe(name: str, form: schema.PeForm) -> Pe:
    return Pe(
        name=name,
        node_id=form.node_id,
        buses=tuple(form.buses),
        cpu_millis=form.cpu_millis,
        ram=form.ram,
        flash=form.flash,
        features=frozenset(form.features),
        table_bytes=form.table_bytes,
        rate_per_h=form.rate_per_h,
    )


def _variable(name: str, form: schema.VariableForm) -> Variable:
    return Variable(
        name=name,
        type=form.type,
        unit=form.unit,
        versions=form.versions,
        identifier=form.identifier,
        initial=initial_value(form.initial, form.type),
        deadline_ns=form.deadline_ns,
    )


def _module(module: ModuleElement, gates: Gates) -> Module:
    form = _of(module.form)
    return Module(
        name=module.name,
        image=form.image or module.name,
        modes={name: _mode(module.name, name, mode, gates) for name, mode in _forms(module.modes)},
        device=form.device,
        runs_on=_optional_tuple(form.runs_on),
        requires=frozenset(form.requires),
        flash=form.flash,
        partition=form.partition,
        restarts=form.restarts,
        checkpoint=form.checkpoint,
        rate_per_h=form.rate_per_h,
    )


def _mode(module: str, name: str, form: schema.ModeForm, gates: Gates) -> Mode:
    return Mode(
        name=name,
        needs=gates.needs[module, name],
        gives=form.gives,
        cpu_millis=form.cpu_millis,
        ram=form.ram,
        rate_mhz=form.rate_mhz,
    )


def _function(name: str, form: schema.FunctionForm, demuxes: Mapping[str, Demux]) -> Function:
    return Function(
        name=name,
        output=form.output,
        outputs=demuxes[form.output].ends if form.output in demuxes else (form.output,),
        criticality=_by_phase(form.criticality),
        priority=_by_phase(form.priority),
        value=_optional_tuple(form.value),
        priority_range=form.priority_range,
    )


def _plant(name: str, form: schema.PlantForm) -> Plant:
    return Plant(name, tuple(form.moved_by), tuple(form.seen_by), tuple(form.affects), form.criticality)


def _phase(name: str, form: schema.PhaseForm, order: list[str]) -> Phase:
    if form.when is None:
        return Phase(name)
    rule, origins = form.when, form.when.origins or order[: order.index(name)]
    return Phase(name, When(rule.variable, rule.above, rule.below, rule.hold_ns, tuple(origins)))


def _by_phase(values: Mapping[str, V]) -> dict[str | None, V]:
    """Convert the keys of a map by phase: `default`, which stands for all phases without a key, becomes None."""
    return {None if phase == DEFAULT_PHASE else phase: value for phase, value in values.items()}


def _optional_tuple(items: list[V] | None) -> tuple[V, ...] | None:
    return None if items is None else tuple(items)


def _forms(elements: Mapping[str, Element[F]]) -> list[tuple[str, F]]:
    return [(name, _of(element.form)) for name, element in elements.items()]


def _of(value: V | None) -> V:
    """Return `value`; raises AssertionError for None, which can occur only in a spec with findings."""
    if value is None:
        raise AssertionError("a field of the spec has no value, although the check found no mistake")
    return value
