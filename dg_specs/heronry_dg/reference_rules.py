"""Checks between the elements of a spec, except in gates: every name refers to an element, and numbers fit together.

Each check reads the draft of the spec (`draft`) and adds findings. A check skips every element with a mistake in its
fields, since that mistake already has a finding. A reference to such an element counts as correct, since the element
exists.

Source: docs/semantics.md, section 1; heronry_wire defines the ranges of node-IDs and of standard identifiers.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from decimal import Decimal
from typing import Final, TypeVar

from heronry_dg import yaml_source
from heronry_dg.draft import Draft, Element, ModuleElement
from heronry_dg.field_types import DEFAULT_PHASE
from heronry_dg.findings import Findings, Place, listed, shown
from heronry_dg.model import (
    LAST_11_BIT_ID,
    LAST_29_BIT_ID,
    THRESHOLDS,
    Bus,
    Foreign,
    Function,
    Mode,
    Module,
    Phase,
    Variable,
    When,
)
from heronry_dg.rules import graph
from heronry_dg.rules import schema as rules
from heronry_wire.canaerospace import DataType, Datum, encode_data
from heronry_wire.frame import WireError

FASTEST_WIRE_BITS_PER_S: Final = 1_000_000  # ISO 11898-1, without CAN FD's second rate
_NUMERIC: Final = ("FLOAT", "LONG", "ULONG", "BLONG", "SHORT", "USHORT", "BSHORT", "CHAR", "UCHAR", "BCHAR")
_TYPE_NAMES: Final = tuple(DataType.__members__)
_NOT_NUMERIC: Final = frozenset(_TYPE_NAMES) - frozenset(_NUMERIC)
_A_KIND: Final = {"sensor": "a sensor", "actuator": "an actuator"}

E = TypeVar("E")


def check_references(draft: Draft, findings: Findings) -> None:
    """Check all elements of a draft against one another, and add a finding for each mistake."""
    assess = _ReferenceRules(draft, findings)
    assess.buses()
    assess.pes()
    assess.manager()
    assess.devices()
    assess.variables()
    assess.modules()
    assess.functions()
    assess.phases()
    assess.placement()
    assess.plants()
    assess.common_causes()


class _ReferenceRules:
    def __init__(self, draft: Draft, findings: Findings) -> None:
        self._draft = draft
        self._findings = findings

    def buses(self) -> None:
        """Check that each bus leaves some bandwidth to data, and that no wired bus is faster than CAN can be."""
        for bus, form in _whole(self._draft.buses):
            if form.max_load <= form.reserve:
                sentence = f"'reserve' of bus '{bus.name}' leaves nothing of its 'max_load' to data"
                self._findings.add(
                    rules.NOTHING_LEFT, _value_place(bus, "reserve"), sentence, "make max_load larger than reserve"
                )
            if form.kind == "wired" and form.bitrate > FASTEST_WIRE_BITS_PER_S:
                sentence = f"bus '{bus.name}' is wired and faster than CAN: {form.bitrate} bit/s"
                hint = f"at most {FASTEST_WIRE_BITS_PER_S}"
                self._findings.add(rules.TOO_FAST_A_WIRE, _value_place(bus, "bitrate"), sentence, hint)
            for number, foreign in enumerate(form.foreign):
                self._foreign(bus, number, foreign)

    def _foreign(self, bus: Element[Bus], number: int, foreign: Foreign) -> None:
        """Check that foreign frames have one identifier or one range, and that it fits 11 or 29 bits."""
        if (foreign.identifier is None) == (foreign.span is None):
            sentence = f"entry {number + 1} of 'foreign' of bus '{bus.name}' must have 'identifier' or 'range'"
            hint = "write identifier: 1793, or range: [1800, 1815]"
            self._findings.add(rules.FOREIGN_IDENTIFIERS, _value_place(bus, "foreign", number), sentence, hint)
            return
        last, bits = (LAST_29_BIT_ID, 29) if foreign.extended else (LAST_11_BIT_ID, 11)
        if foreign.last > last:
            sentence = f"identifier {foreign.last} has more than {bits} bits"
            hint = f"write {last} or less" if foreign.extended else f"write {last} or less, or extended: true"
            key = "identifier" if foreign.span is None else "range"
            self._findings.add(rules.OUT_OF_RANGE, _value_place(bus, "foreign", number, key), sentence, hint)

    def pes(self) -> None:
        """Check that the buses of PEs exist and form a forest, and that node-IDs differ."""
        nodes: dict[int, str] = {}
        network = _Forest()
        for pe, form in _whole(self._draft.pes):
            other = nodes.setdefault(form.node_id, pe.name)
            if other != pe.name:
                sentence = f"pe '{pe.name}' has the node_id of pe '{other}', {form.node_id}"
                self._findings.add(
                    graph.NODE_ID_TWICE, _value_place(pe, "node_id"), sentence, "give every PE a node_id of its own"
                )
            self._names(pe, "buses", form.buses, "bus", self._draft.buses)
            for index, bus in enumerate(form.buses):
                if bus in self._draft.buses and not network.join(f"pe:{pe.name}", f"bus:{bus}"):
                    sentence = f"bus '{bus}' gives pe '{pe.name}' a second route to where its other buses lead"
                    hint = "buses must form a forest: between two PEs there is at most one route"
                    self._findings.add(graph.SECOND_ROUTE, _value_place(pe, "buses", index), sentence, hint)

    def manager(self) -> None:
        """Check that the manager's bus exists; if the spec has a wired bus, check that the manager's bus is wired."""
        manager, form = self._draft.manager, self._draft.manager.form
        if form is None or any(bus.form is None for bus in self._draft.buses.values()):
            return
        if self._draft.header is None:
            return  # a section with a misspelt name may be the one that is missing
        wired = [bus.name for bus, form in _whole(self._draft.buses) if form.kind == "wired"]
        place = _value_place(manager, "bus")
        given = not yaml_source.is_nothing(_child(manager.node, "bus")) and manager.node is not _child(
            manager.node, "bus"
        )
        if not self._draft.buses:
            place = yaml_source.key_place(self._draft.root, "buses")
            self._findings.add(graph.MANAGER_BUS, place, "there is no bus", "write buses: {can0: {bitrate: 1000000}}")
        elif not given and not wired:
            place = yaml_source.key_place(self._draft.root, "buses")
            sentence = "no bus is wired, and no bus is given for the manager"
            self._findings.add(graph.MANAGER_BUS, place, sentence, "write manager: {bus: NAME}")
        elif given and form.bus not in self._draft.buses:
            self._findings.unknown(graph.UNKNOWN_NAME, place, "bus", form.bus, self._draft.buses.keys())
        elif given and wired and form.bus not in wired:
            sentence = f"the manager is on bus '{form.bus}', which is wireless"
            self._findings.add(
                graph.MANAGER_BUS, place, sentence, f"put the manager on a wired bus, such as {wired[0]}"
            )

    def common_causes(self) -> None:
        """Check that the elements of each common cause exist; a channel or a place has no rate, so it is none here."""
        sections = {"pe": self._draft.pes, "device": self._draft.devices, "module": self._draft.modules}
        sections["bus"] = self._draft.buses
        known = [f"{kind}:{name}" for kind, section in sections.items() for name in section]
        for number, cause in enumerate(self._draft.header.common_cause if self._draft.header is not None else ()):
            for index, element in enumerate(cause.elements):
                if element not in known:
                    place = yaml_source.place_at(self._draft.root, ("common_cause", number, "elements", index))
                    self._findings.unknown(graph.UNKNOWN_NAME, place, "element", element, known)

    def plants(self) -> None:
        """Check that `moved_by` of each plant names actuators, `seen_by` names sensors, and `affects` names plants."""
        for plant, form in _whole(self._draft.plants):
            self._names(plant, "affects", form.affects, "plant", self._draft.plants)
            for field, names, kind in (("moved_by", form.moved_by, "actuator"), ("seen_by", form.seen_by, "sensor")):
                self._names(plant, field, names, "device", self._draft.devices)
                for index, name in enumerate(names):
                    device = self._draft.devices.get(name)
                    if device is not None and device.form is not None and device.form.kind != kind:
                        sentence = f"plant '{plant.name}' is {field.replace('_', ' ')} '{name}', which is no {kind}"
                        hint = "a plant is moved by actuators and seen by sensors"
                        self._findings.add(graph.WRONG_DEVICE, _value_place(plant, field, index), sentence, hint)

    def devices(self) -> None:
        """Check that the PEs of devices exist, and that no device has a key of the other kind."""
        for device, form in _whole(self._draft.devices):
            self._name(_value_place(device, "pe"), "pe", form.pe, self._draft.pes)
            foreign = (
                {"limits": form.limits, "rate_limit": form.rate_limit, "safe": form.safe}
                if form.kind == "sensor"
                else {"range": form.span, "stale_ms": form.stale_ns}
            )
            for key, value in foreign.items():
                if value is not None:
                    other = "an actuator" if form.kind == "sensor" else "a sensor"
                    sentence = f"device '{device.name}' is {_A_KIND[form.kind]}, and '{key}' is a key of {other}"
                    self._findings.add(rules.OTHER_KINDS_KEY, _value_place(device, key), sentence, f"remove '{key}'")

    def variables(self) -> None:
        """Check that types exist, identifiers differ, initial values fit, and no gate has a variable's name."""
        holders: dict[int, str] = {}
        for variable, form in _whole(self._draft.variables):
            if form.type not in DataType.__members__:
                hint = self._findings.suggestion(form.type, _TYPE_NAMES) or f"there is {listed(_TYPE_NAMES)}"
                sentence = f"no data type is named {shown(form.type)}"
                self._findings.add(rules.UNKNOWN_TYPE, _value_place(variable, "type"), sentence, hint)
            elif form.initial is not None and not yaml_source.has_refused(_child(variable.node, "initial")):
                self._initial(variable, form)
            other = holders.setdefault(form.identifier, variable.name) if form.identifier is not None else variable.name
            if other != variable.name:
                sentence = f"variable '{variable.name}' has the identifier of '{other}', {form.identifier}"
                hint = "leave 'identifier' out: then heronry allocates an identifier"
                self._findings.add(graph.IDENTIFIER_TWICE, _value_place(variable, "identifier"), sentence, hint)
        for name, place in self._gate_names():
            if name in self._draft.variables:
                sentence = f"{shown(name)} is the name of a gate and of a variable"
                self._findings.add(
                    graph.GATE_AND_VARIABLE,
                    place,
                    sentence,
                    "rename the gate: in an expression the name could mean the gate or the variable",
                )

    def modules(self) -> None:
        """Check that every element exists that modules, their modes and DEMUXes name, except for names in gates.

        If a mode gives a version of a variable, the variable must have this version. If a module has a device,
        `runs_on` must allow the device's PE.
        """
        for module in self._draft.modules.values():
            if module.form is not None:
                self._module_place(module, module.form)
            for mode, form in _whole(module.modes):
                for variable, version in form.gives.items():
                    self._gives(mode, variable, version)
        for demux, demux_form in _whole(self._draft.demuxes):
            self._names(demux, "to", demux_form.to, "module", self._draft.modules)

    def functions(self) -> None:
        """Check that the outputs and phases that functions name exist."""
        outputs = {**self._draft.modules, **self._draft.demuxes}
        for function, form in _whole(self._draft.functions):
            place = _value_place(function, "output")
            if form.output in self._draft.shorthands:
                sentence = f"gate '{form.output}' is no DEMUX, so it cannot be the output of a function"
                self._findings.add(graph.BAD_OUTPUT, place, sentence, "name a module or a DEMUX as the output")
            elif form.output in self._draft.modules and form.output in self._draft.demuxes:
                sentence = f"'{form.output}' is the name of a module and of a DEMUX"
                self._findings.add(graph.BAD_OUTPUT, place, sentence, "rename one of them")
            elif form.output not in outputs:
                self._findings.unknown(graph.UNKNOWN_NAME, place, "module or DEMUX", form.output, outputs.keys())
            for field, by_phase in (("criticality", form.criticality), ("priority", form.priority)):
                self._phase_keys(function, field, by_phase)

    def phases(self) -> None:
        """Check the names and rules of the phases, and the phases for which contingencies are to be made.

        - No phase may be named `default`: in a map by phase, this key stands for all phases that have no key.
        - A phase rule must compare one number with one threshold.
        - Each phase that the section of contingencies names must exist.
        """
        for phase, form in _whole(self._draft.phases):
            if phase.name == DEFAULT_PHASE:
                sentence = f"a phase cannot be named '{phase.name}'"
                hint = "in the maps by phase this name means all other phases"
                self._findings.add(rules.PHASE_NAMED_DEFAULT, phase.place, sentence, hint)
            if form.when is not None:
                self._when(phase, form.when)
        contingency = self._draft.contingency
        if contingency.form is not None and contingency.form.phases is not None:
            self._names(contingency, "phases", contingency.form.phases, "phase", self._draft.phases)

    def placement(self) -> None:
        """Check that the modules that placement rules name exist."""
        if self._draft.header is None:
            return
        for rule, groups in (("separate", self._draft.header.separate), ("together", self._draft.header.together)):
            for group, names in enumerate(groups):
                for index, name in enumerate(names):
                    place = yaml_source.place_at(self._draft.root, (rule, group, index))
                    self._name(place, "module", name, self._draft.modules)

    def _initial(self, variable: Element[Variable], form: Variable) -> None:
        try:
            value = initial_value(form.initial, form.type)
            if isinstance(value, tuple) and form.type in _NUMERIC:
                raise TypeError(f"{form.type} takes one number")  # noqa: TRY301 - as the encoder does
            encode_data(0, Datum(0, DataType[form.type], 0, 0, value))
        except (WireError, TypeError) as misfit:
            sentence = f"'initial' of variable '{variable.name}' does not fit: {misfit}"
            hint = f"write a value that {form.type} takes, or take another type"
            self._findings.add(rules.BAD_INITIAL, _value_place(variable, "initial"), sentence, hint)

    def _module_place(self, module: ModuleElement, form: Module) -> None:
        self._names(module, "runs_on", form.runs_on or (), "pe", self._draft.pes)
        if form.device is None:
            return
        place = _value_place(module, "device")
        self._name(place, "device", form.device, self._draft.devices)
        device = self._draft.devices.get(form.device)
        if device is None or device.form is None or form.runs_on is None:
            return
        if device.form.pe in self._draft.pes and device.form.pe not in form.runs_on:
            sentence = f"module '{module.name}' can run nowhere: '{form.device}' is on pe '{device.form.pe}'"
            hint = "'runs_on' must allow that PE, or be left out"
            self._findings.add(graph.RUNS_NOWHERE, yaml_source.key_place(module.node, "runs_on"), sentence, hint)

    def _gives(self, mode: Element[Mode], name: str, version: int) -> None:
        place = yaml_source.key_place(_child(mode.node, "gives"), name)
        self._name(place, "variable", name, self._draft.variables)
        variable = self._draft.variables.get(name)
        if variable is not None and variable.form is not None and version > variable.form.versions:
            most = variable.form.versions
            there = "version 1 alone" if most == 1 else f"versions 1 to {most}"
            sentence = f"version {version} of '{name}' does not exist"
            place = _value_place(mode, "gives", name)
            self._findings.add(graph.VERSION_OUT_OF_RANGE, place, sentence, f"'{name}' has {there}")

    def _phase_keys(self, function: Element[Function], field: str, by_phase: Mapping[str | None, object]) -> None:
        for phase in by_phase:
            if phase is not None:
                place = yaml_source.key_place(_child(function.node, field), phase)
                self._name(place, "phase", phase, self._draft.phases)

    def _when(self, phase: Element[Phase], when: When) -> None:
        self._name(_value_place(phase, "when", "variable"), "variable", when.variable, self._draft.variables)
        for index, origin in enumerate(when.origins):
            self._name(_value_place(phase, "when", "from", index), "phase", origin, self._draft.phases)
        variable = self._draft.variables.get(when.variable)
        if variable is not None and variable.form is not None and variable.form.type in _NOT_NUMERIC:
            sentence = f"'{when.variable}' is no single number, but of type {shown(variable.form.type)}"
            place = _value_place(phase, "when", "variable")
            self._findings.add(graph.NOT_A_NUMBER_TO_WATCH, place, sentence, "watch a number")
        if len(when.thresholds()) != 1:
            names = [f"'{name}'" for name in THRESHOLDS]
            sentence = f"'when' of phase '{phase.name}' must have exactly one of {listed(names)}"
            place = yaml_source.key_place(phase.node, "when")
            self._findings.add(rules.ONE_THRESHOLD, place, sentence, f"write {listed(names, 'or')}")

    def _names(
        self, element: Element[object], field: str, names: Iterable[str], kind: str, known: Collection[str]
    ) -> None:
        for index, name in enumerate(names):
            self._name(_value_place(element, field, index), kind, name, known)

    def _name(self, place: Place, kind: str, name: str, known: Collection[str]) -> None:
        if name not in known:
            self._findings.unknown(graph.UNKNOWN_NAME, place, kind, name, known)

    def _gate_names(self) -> Iterator[tuple[str, Place]]:
        yield from ((gate.name, gate.place) for gate in self._draft.demuxes.values())
        yield from ((name, entry.place) for name, entry in self._draft.shorthands.items())


class _Forest:
    """Disjoint sets of names (union-find): two names are in the same set if they are connected."""

    def __init__(self) -> None:
        self._parents: dict[str, str] = {}

    def join(self, one: str, other: str) -> bool:
        """Connect two names; False if they were already connected."""
        a, b = self._root(one), self._root(other)
        self._parents[a] = b
        return a != b

    def _root(self, thing: str) -> str:
        while (parent := self._parents.setdefault(thing, thing)) != thing:
            self._parents[thing] = self._parents[parent]
            thing = parent
        return thing


def initial_value(value: object, data_type: str) -> int | float | str | tuple[int, ...] | None:
    """Convert an `initial` value of the file to the model; raises TypeError if no data type can carry the value.

    data_type: of a FLOAT the value is a float, however it is written.
    """
    match value:
        case int() if data_type == "FLOAT" and not isinstance(value, bool):
            return float(value)
        case bool() | dict():
            raise TypeError(f"no data type can carry {shown(value)}")
        case list() if all(isinstance(item, int) and not isinstance(item, bool) for item in value):
            return tuple(value)
        case Decimal():
            return float(value)
        case None | int() | str():
            return value
        case _:
            raise TypeError("a list may contain only whole numbers")


def _whole(elements: Mapping[str, Element[E]]) -> Iterator[tuple[Element[E], E]]:
    """Return the elements whose fields have no mistake, each with its fields."""
    return ((element, element.form) for element in elements.values() if element.form is not None)


def _value_place(element: Element[object], *path: str | int) -> Place:
    """Place of a value in the file, or of the element's name where the value is missing."""
    place = yaml_source.place_at(element.node, path)
    return element.place if place == element.node.place else place


def _is_given(node: yaml_source.Node, key: str) -> bool:
    """Tell whether an element of the file has a key with a value."""
    entries = node.entries if isinstance(node, yaml_source.Mapping) else {}
    return key in entries and not yaml_source.is_nothing(entries[key].node)


def _child(node: yaml_source.Node, key: str) -> yaml_source.Node:
    return node.entries[key].node if isinstance(node, yaml_source.Mapping) and key in node.entries else node
