"""What a change from one spec to another does to the modules that run: which go on untouched, and which do not.

`spec_change` compares two specs, with the configuration that runs before the change and the one that runs after it. A
module is known by its name. Its *definition* is all that its PE is told of it: image, modes in their order, what each
mode needs and gives, rates and budgets, the device, the process, restarts, the checkpoint, whether it is exclusive or
may move, the data that it reads and gives, and the identifiers that it sends. What only the planner reads is no part of
it: the worth of versions, the phases of an input, functions and their priorities, and PEs on which it does not run.

A module that runs on both sides has one fate:

    unchanged   the same definition, PE, mode and wires, and the wires carry the same identifiers: no step is missed
    rewired     it differs in its wires alone, or in the identifiers that these carry
    changed     another definition or another mode, on the same PE
    moved       on another PE; it may have another definition too

One that runs on one side alone has `started` or `stopped`. One that runs on neither is not listed.

An identifier *passes* if it belongs to another source in the new spec. Where the old source is sent before the change
and the new one after it, two PEs might drive the identifier while they change over: it is exclusive meanwhile
(`Passing.is_driven`). Both may be of one module, which changes in that case.

This file decides nothing: what must stop before what starts is the business of a transition.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, get_args

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.field_types import CRITICALITIES
from heronry_dg.gates import Expression, with_leaves
from heronry_dg.model import Bus, Device, Pe, Spec, Variable
from heronry_dg.situation import hosts_when_all_is_up
from heronry_dg.traffic import criticality_ranks, identifiers

Fate = Literal["unchanged", "rewired", "changed", "moved", "started", "stopped"]
FATES: tuple[Fate, ...] = get_args(Fate)
Source = tuple[str, str]  # producer, variable


@dataclass(frozen=True, slots=True)
class ModuleChange:
    """The fate of one module that runs before the change, after it, or both.

    differs: names of the parts of its definition that differ, as `definition` names them; empty where it is in one
        spec alone.
    """

    module: str
    fate: Fate
    before: Running | None
    after: Running | None
    differs: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class HardwareChange:
    """A PE, device, bus or gateway, as KIND:NAME, that joins, leaves, or stays with other properties.

    A gateway is a PE with two or more buses. It has its own line where a PE becomes one or ceases to be one, and
    where it joins other buses.
    """

    element: str
    change: Literal["joins", "leaves", "changes"]


@dataclass(frozen=True, slots=True)
class Passing:
    """An identifier that belongs to another source in the new spec.

    is_driven: the old source is sent before the change, and the new one after it.
    """

    identifier: int
    old: Source
    new: Source
    is_driven: bool


@dataclass(frozen=True, slots=True)
class SpecChange:
    """What a change of the spec does to running modules, to hardware, and to identifiers.

    Modules and hardware stand in the order of the old spec, then of the new; identifiers ascend.
    """

    modules: tuple[ModuleChange, ...]
    hardware: tuple[HardwareChange, ...]
    passing: tuple[Passing, ...]

    def with_fate(self, fate: Fate) -> tuple[str, ...]:
        """Names of the modules with one fate."""
        return tuple(one.module for one in self.modules if one.fate == fate)

    def document(self) -> dict[str, object]:
        """Return the change as plain data for JSON."""
        return {
            "modules": {fate: [_told(one) for one in self.modules if one.fate == fate] for fate in FATES},
            "hardware": {
                change: [one.element for one in self.hardware if one.change == change]
                for change in ("joins", "leaves", "changes")
            },
            "identifiers": [
                {
                    "identifier": one.identifier,
                    "old": {"module": one.old[0], "variable": one.old[1]},
                    "new": {"module": one.new[0], "variable": one.new[1]},
                    "is_driven": one.is_driven,
                }
                for one in self.passing
            ],
        }


def spec_change(old: Spec, before: Configuration, new: Spec, after: Configuration) -> SpecChange:
    """Compare what runs before a change of the spec with what runs after it.

    before: legal in `old`. after: legal in `new`. Raises WireError where a spec has more sources than identifiers.
    """
    sides = _Side(old, before), _Side(new, after)
    return SpecChange(tuple(_modules(*sides)), tuple(_hardware(old, new)), tuple(_passing(*sides)))


class _Side:
    """One spec with what runs, and what is computed once for all of its modules."""

    def __init__(self, spec: Spec, running: Configuration) -> None:
        self.spec, self.running = spec, running.modules
        self.identifiers = identifiers(spec)
        self.sources = {identifier: source for source, identifier in self.identifiers.items()}
        self._ranks = criticality_ranks(spec)
        self._exclusive = spec.exclusive_things()
        self._outputs = {output for function in spec.functions.values() for output in function.outputs}

    def definition(self, name: str) -> dict[str, object]:
        """Return all that a PE is told of a module, by part."""
        spec, module = self.spec, self.spec.modules[name]
        modes = module.modes.values()
        given = dict.fromkeys(variable for mode in modes for variable in mode.gives)
        read = dict.fromkeys(leaf.variable for mode in modes for _, leaf in mode.leaves())
        return {
            "image": module.image,
            "modes": tuple(module.modes),
            "needs": {mode.name: _as_told(mode.needs) for mode in modes},
            "gives": {mode.name: tuple(mode.gives.items()) for mode in modes},
            "rate": {mode.name: mode.rate_mhz for mode in modes},
            "cpu": {mode.name: mode.cpu_millis for mode in modes},
            "memory": ({mode.name: mode.ram for mode in modes}, module.flash),
            "device": _without_rates(spec.devices[module.device]) if module.device is not None else None,
            "process": module.partition or CRITICALITIES[self._ranks[name]],
            "restarts": module.restarts,
            "silence": (module.silent, name in self._outputs),
            "checkpoint": module.checkpoint,
            "exclusive": self._exclusive.get(name, ()),
            "may move": len(hosts_when_all_is_up(spec, module)) > 1,
            "data": {variable: _as_sent(spec.variables[variable]) for variable in (*given, *read)},
            "identifiers": {variable: self.identifiers[name, variable] for variable in given},
        }

    def wires(self, name: str) -> dict[str, tuple[Wire, int]]:
        """Return the wires of a running module, each with the identifier that it carries."""
        inputs = self.running[name].inputs
        return {path: (wire, self.identifiers[wire.producer, wire.variable]) for path, wire in inputs.items()}

    def is_sent(self, source: Source) -> bool:
        """Tell whether a running module gives a source in its mode, whether or not somebody reads it."""
        producer, variable = source
        running = self.running.get(producer)
        return running is not None and variable in self.spec.modules[producer].modes[running.mode].gives


def _modules(old: _Side, new: _Side) -> Iterator[ModuleChange]:
    for name in {**old.spec.modules, **new.spec.modules}:
        before, after = old.running.get(name), new.running.get(name)
        differs = tuple(_differing(old, new, name)) if name in old.spec.modules and name in new.spec.modules else ()
        if before is not None and after is not None:
            yield ModuleChange(name, _fate_of_one_that_runs(old, new, name, differs), before, after, differs)
        elif before is not None or after is not None:
            yield ModuleChange(name, "stopped" if after is None else "started", before, after, differs)


def _differing(old: _Side, new: _Side, name: str) -> Iterator[str]:
    becomes = new.definition(name)
    return (part for part, was in old.definition(name).items() if was != becomes[part])


def _fate_of_one_that_runs(old: _Side, new: _Side, name: str, differs: tuple[str, ...]) -> Fate:
    before, after = old.running[name], new.running[name]
    if before.pe != after.pe:
        return "moved"
    if differs or before.mode != after.mode:
        return "changed"
    return "unchanged" if old.wires(name) == new.wires(name) else "rewired"


def _hardware(old: Spec, new: Spec) -> Iterator[HardwareChange]:
    kinds: tuple[tuple[str, Mapping[str, object], Mapping[str, object]], ...] = (
        ("bus", _told_of(old.buses), _told_of(new.buses)),
        ("pe", _told_of(old.pes), _told_of(new.pes)),
        ("gateway", _gateways(old), _gateways(new)),
        ("device", _told_of(old.devices), _told_of(new.devices)),
    )
    for kind, was, becomes in kinds:
        for name in {**was, **becomes}:
            if name not in was:
                yield HardwareChange(f"{kind}:{name}", "joins")
            elif name not in becomes:
                yield HardwareChange(f"{kind}:{name}", "leaves")
            elif was[name] != becomes[name]:
                yield HardwareChange(f"{kind}:{name}", "changes")


def _told_of(elements: Mapping[str, Bus] | Mapping[str, Pe] | Mapping[str, Device]) -> dict[str, object]:
    return {name: _without_rates(element) for name, element in elements.items()}


def _gateways(spec: Spec) -> dict[str, object]:
    return {pe.name: frozenset(pe.buses) for pe in spec.pes.values() if len(pe.buses) > 1}


def _passing(old: _Side, new: _Side) -> Iterator[Passing]:
    for identifier in sorted(old.sources.keys() & new.sources.keys()):
        was, becomes = old.sources[identifier], new.sources[identifier]
        if was != becomes:
            yield Passing(identifier, was, becomes, old.is_sent(was) and new.is_sent(becomes))


def _without_rates(element: Bus | Pe | Device) -> object:
    """Return an element without what only analysis reads."""
    return replace(element, rate_per_h=None, probability=None)


def _as_told(needs: Expression | None) -> Expression | None:
    """Return what a mode needs without what only the planner reads of its leaves."""
    return None if needs is None else with_leaves(needs, lambda leaf: replace(leaf, worth=(), only_in=None))


def _as_sent(variable: Variable) -> Variable:
    """Return a datum without its deadline, which only the planner reads, and its identifier, which is the source's."""
    return replace(variable, deadline_ns=None, identifier=None)


def _told(one: ModuleChange) -> dict[str, object]:
    return {"module": one.module, "before": _place(one.before), "after": _place(one.after), "differs": one.differs}


def _place(running: Running | None) -> dict[str, str] | None:
    return None if running is None else {"pe": running.pe, "mode": running.mode}
