"""A plan: a configuration with its situation, its objective, the proof that it is optimal, and a report.

The report (`plan_report`: functions, PEs, buses) follows from the other parts, and is computed when it is read.
`heronry plan` writes a plan as a JSON file. These functions read such a file:

    read_plan            the whole plan, which heronry must have written; objective and report are computed anew
    read_situation       phase, faults, limits and changed priorities; what the file lacks is taken from a healthy
                         system in the first phase, with the priorities of the spec
    read_configuration   only `modules`, since a plan to be verified may come from any planner
    read_running         only `pe` and `mode` of each module: the placement that runs now

A malformed file raises PlanError, whose sentence names the place in the file.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from fractions import Fraction
from typing import TypeVar

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.model import Spec
from heronry_dg.objective import CRITICAL_CLASSES, Objective, Placement, score
from heronry_dg.plan_document import Json, ObjectiveDocument, PlanDocument, in_order_of_inputs, plain_object
from heronry_dg.plan_report import BusReport, FunctionReport, LevelReport, PeReport, Report
from heronry_dg.situation import Situation, UnknownElementError, situation
from heronry_wire.errors import HeronryError

Bounds = Sequence[int | None]
"""For each of the ten integers of `Objective.key` an upper bound (None: not known).

A bound holds for all legal configurations that are no worse than the plan on all levels above.
"""

LEVELS = (
    *(f"critical {criticality}" for criticality in CRITICAL_CLASSES),
    "utility",
    "inputs",
    "changes",
    "branches",
    "bus_bits_per_s",
    "cpu_millis",
)
_COSTS = ("changes", "branches", "bus_bits_per_s", "cpu_millis")  # fewer is better
_T = TypeVar("_T")


class PlanError(HeronryError, ValueError):
    """A plan file cannot be used; the message is one sentence that names the place and the mistake."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A configuration with its situation, objective and report, and with what was proven of each level."""

    spec: str  # digest of the spec's file: SHA-256, hexadecimal
    now: Situation
    configuration: Configuration
    objective: Objective
    optimal: bool  # proven to be the best legal configuration
    levels: Sequence[LevelReport]  # most important first
    report: Report = field(compare=False, repr=False)  # follows from the rest

    @property
    def functions(self) -> Mapping[str, FunctionReport]:
        """How each function is served, or why it is not."""
        return self.report.functions

    @property
    def pes(self) -> Mapping[str, PeReport]:
        """CPU, RAM and flash used on each PE."""
        return self.report.pes

    @property
    def buses(self) -> Mapping[str, BusReport]:
        """Bandwidth used on each bus."""
        return self.report.buses

    def told(self) -> PlanDocument:
        """Return the plan as others read it; the report is computed now."""
        return PlanDocument(
            spec=self.spec,
            phase=self.now.phase,
            down=tuple(sorted(self.now.down)),
            limits={element: _percent(share) for element, share in sorted(self.now.limits.items())},
            priorities=dict(sorted(self.now.priorities.items())),
            objective=_objective_document(self.objective),
            optimal=self.optimal,
            levels=tuple(self.levels),
            modules=in_order_of_inputs(self.configuration),
            functions=self.functions,
            pes=self.pes,
            buses=self.buses,
        )

    def document(self) -> Json:
        """Return the plan as plain data: what `to_json` writes."""
        return plain_object(self.told())

    def to_json(self) -> str:
        """Write the plan; the same plan gives the same bytes."""
        return json.dumps(self.document(), indent=2, ensure_ascii=False) + "\n"


def make_plan(
    spec: Spec,
    now: Situation,
    configuration: Configuration,
    objective: Objective,
    *,
    optimal: bool,
    bounds: Bounds | None = None,
    reasons: Mapping[str, str] | None = None,
) -> Plan:
    """Make a plan; its report is computed when it is first read.

    configuration: every name in it must exist in the spec
    bounds: the best possible value of each level. If it is None, the bounds of an optimal plan are its own values, and
        the bounds of any other plan are not known
    reasons: why functions are not served, where the planner knows more than `why_not`
    """
    in_order = Configuration(
        {name: configuration.modules[name] for name in spec.modules if name in configuration.modules}
    )
    return Plan(
        spec=spec.digest,
        now=now,
        configuration=in_order,
        objective=objective,
        optimal=optimal,
        levels=level_reports(objective, bounds or (objective.key() if optimal else None)),
        report=Report(spec, now, in_order, reasons),
    )


def plan_with_bounds(
    spec: Spec, now: Situation, configuration: Configuration, objective: Objective, bounds: Sequence[int]
) -> Plan:
    """Make a plan from the result of a search; the plan is optimal if each level equals its bound."""
    optimal = tuple(bounds) == objective.key()
    return make_plan(spec, now, configuration, objective, optimal=optimal, bounds=bounds)


def level_reports(objective: Objective, bounds: Bounds | None) -> tuple[LevelReport, ...]:
    """Return value and bound of each level; without `bounds` the bounds are not known."""
    bounds = bounds or (None,) * len(LEVELS)
    return tuple(
        LevelReport(
            level=level,
            value=_reported(level, value),
            bound=None if bound is None else _reported(level, bound),
            proven=value == bound,
        )
        for level, value, bound in zip(LEVELS, objective.key(), bounds, strict=True)
    )


def _reported(level: str, key: int) -> int:
    """Convert an integer of `Objective.key` to the value of this level in a report."""
    # in a key more is better
    quantity = -key if level in _COSTS else key
    # thousandths of a bit/s, rounded down
    return quantity // 1000 if level == "bus_bits_per_s" else quantity


def _objective_document(objective: Objective) -> ObjectiveDocument:
    return ObjectiveDocument(
        critical=dict(zip(CRITICAL_CLASSES, objective.critical, strict=True)),
        utility=objective.utility,
        inputs=objective.inputs,
        changes=objective.changes,
        branches=objective.branches,
        bus_bits_per_s=objective.bus_bits_per_s,
        cpu_millis=objective.cpu_millis,
    )


def modules_json(configuration: Configuration) -> Json:
    """Return a configuration as the object `modules` of a plan file."""
    return {name: plain_object(running) for name, running in in_order_of_inputs(configuration).items()}


def _percent(share: Fraction) -> str:
    """Write a share as an exact percentage: a user can write a limit only as a finite decimal."""
    percent = Decimal(share.numerator * 100) / share.denominator
    return f"{percent.normalize():f}%"


def read_plan(text: str, spec: Spec) -> Plan:
    """Read a plan that `to_json` wrote.

    Raises PlanError if the text is no such plan, if the plan was made for another spec, or if its objective or
    its levels do not fit its configuration.
    """
    document = _document(text)
    if _field(document, "spec", str, "the plan") != spec.digest:
        raise PlanError(f"the plan was made for another spec, or another version of spec {spec.name}: make a new plan")
    now = read_situation(text, spec)
    configuration = read_configuration(text)
    check_names(spec, configuration)
    claimed = _object(document, "objective", "the plan")
    changed = _field(claimed, "changes", int, "objective")
    objective = replace(score(spec, now, configuration, running=None), changes=changed)
    if claimed != plain_object(_objective_document(objective)):
        raise PlanError("the plan's objective does not fit its configuration: make a new plan")
    optimal = _field(document, "optimal", bool, "the plan")
    made = make_plan(spec, now, configuration, objective, optimal=optimal, reasons=_reasons(document))
    return replace(made, levels=_claimed_levels(document, made.levels)) if "levels" in document else made


def _claimed_levels(document: Json, known: Sequence[LevelReport]) -> tuple[LevelReport, ...]:
    """Read the levels of a plan, with their bounds.

    known: the levels as computed from the plan's objective. Raises PlanError if the plan's levels have other values, or
    if its field `optimal` does not agree with the bounds.
    """
    claimed: list[object] = _field(document, "levels", list, "the plan")
    levels = tuple(_claimed_level(fields, f"levels.{number}") for number, fields in enumerate(claimed))
    if [(one.level, one.value) for one in levels] != [(one.level, one.value) for one in known]:
        raise PlanError("the plan's 'levels' and 'objective' contradict each other: make a new plan")
    if _field(document, "optimal", bool, "the plan") != all(one.proven for one in levels):
        raise PlanError("the plan's field 'optimal' does not agree with its field 'levels': make a new plan")
    return levels


def _claimed_level(fields: object, place: str) -> LevelReport:
    if not isinstance(fields, dict):
        raise PlanError(f"{place} is {_shown(fields)} and must be an object")
    return LevelReport(
        level=_field(fields, "level", str, place),
        value=_field(fields, "value", int, place),
        bound=None if fields.get("bound") is None else _field(fields, "bound", int, place),
        proven=_field(fields, "proven", bool, place),
    )


def read_situation(text: str, spec: Spec) -> Situation:
    """Read the situation of a plan file; raises PlanError.

    What the file lacks is taken from a healthy system in the first phase.
    """
    document = _document(text)
    phase = document.get("phase")
    if phase is not None and not isinstance(phase, str):
        raise PlanError(f"the plan's 'phase' is {_shown(phase)} and must be a string or null")
    down: list[object] = _field({"down": [], **document}, "down", list, "the plan")
    limits = _object({"limits": {}, **document}, "limits", "the plan")
    priorities = _object({"priorities": {}, **document}, "priorities", "the plan")
    names = [element for element in down if isinstance(element, str)]
    if len(names) != len(down):
        raise PlanError(f"the plan's 'down' is {_shown(down)} and must be a list of strings")
    try:
        return situation(
            spec,
            names,
            [f"{e}={_field(limits, e, str, 'limits')}" for e in limits],
            phase,
            [f"{f}={_field(priorities, f, int, 'priorities')}" for f in priorities],
        )
    except UnknownElementError as error:
        other = document.get("spec")
        is_of_another = isinstance(other, str) and other != spec.digest
        raise PlanError(
            f"the plan is of another spec than {spec.name}: {error}" if is_of_another else str(error)
        ) from None


def read_configuration(text: str) -> Configuration:
    """Read the configuration from `modules` of a plan; other keys are ignored, and names are not checked."""
    return configuration_of(_document(text))


def configuration_of(document: Json) -> Configuration:
    """Read the configuration from a parsed plan file, as `read_configuration` does."""
    return Configuration({name: _running(fields, f"modules.{name}") for name, fields in _modules(document)})


def read_running(text: str, spec: Spec) -> Placement:
    """Read mode and PE of each module of a plan; other keys are ignored.

    Raises PlanError also for a module, mode or PE that the spec does not have.
    """
    running = {
        name: (_field(fields, "mode", str, f"modules.{name}"), _field(fields, "pe", str, f"modules.{name}"))
        for name, fields in _modules(_document(text))
    }
    for name, (mode, pe) in running.items():
        _check_place(spec, name, mode, pe)
    return running


def _modules(document: Json) -> Iterator[tuple[str, Json]]:
    modules = _field(document, "modules", dict, "the plan")
    for name in modules:
        yield name, _object(modules, name, "modules")


def _running(fields: Json, place: str) -> Running:
    inputs = _object(fields, "inputs", place)
    return Running(
        pe=_field(fields, "pe", str, place),
        mode=_field(fields, "mode", str, place),
        inputs={leaf: _wire(_object(inputs, leaf, f"{place}.inputs"), f'{place}.inputs["{leaf}"]') for leaf in inputs},
    )


def _wire(fields: Json, place: str) -> Wire:
    return Wire(
        producer=_field(fields, "producer", str, place),
        variable=_field(fields, "variable", str, place),
        version=_field(fields, "version", int, place),
    )


def _reasons(document: Json) -> dict[str, str]:
    functions = _object(document, "functions", "the plan")
    reports = {name: _object(functions, name, "functions") for name in functions}
    said = {name: report.get("why_not") for name, report in reports.items()}
    return {name: reason for name, reason in said.items() if isinstance(reason, str)}


def _check_place(spec: Spec, name: str, mode: str, pe: str) -> None:
    if name not in spec.modules:
        raise PlanError(f"modules.{name}: the spec has no module '{name}'")
    if mode not in spec.modules[name].modes:
        raise PlanError(f"modules.{name}.mode: the module has no mode '{mode}'")
    if pe not in spec.pes:
        raise PlanError(f"modules.{name}.pe: the spec has no PE '{pe}'")


def check_names(spec: Spec, configuration: Configuration) -> None:
    """Raise PlanError for names that the spec does not have; `verify` checks whether the configuration is legal."""
    for name, running in configuration.modules.items():
        _check_place(spec, name, running.mode, running.pe)
        leaves = dict(configuration.mode(spec, name).leaves())
        for path, wire in running.inputs.items():
            leaf = leaves.get(path)
            if leaf is None or leaf.variable != wire.variable or not leaf.accepts(wire.version):
                raise PlanError(
                    f'modules.{name}.inputs["{path}"]: mode {running.mode} has no such input, or the input does not '
                    f"accept {wire.variable} in version {wire.version}: make a new plan"
                )


def _document(text: str) -> Json:
    try:
        document = json.loads(text, object_pairs_hook=_fields, parse_constant=_no_constant)
    except json.JSONDecodeError as error:
        is_spec = text.lstrip().startswith(("dg:", "#"))
        hint = "; if this file is the spec, name it before the plan on the command line" if is_spec else ""
        raise PlanError(f"line {error.lineno}, column {error.colno}: this is not JSON ({error.msg}){hint}") from None
    except RecursionError:
        raise PlanError("the file is nested too deeply to be a plan") from None
    except PlanError:
        raise
    except ValueError:
        raise PlanError("the file holds a number too long for a plan") from None
    if not isinstance(document, dict):
        raise PlanError(f"the plan is {_shown(document)} and must be an object")
    return document


def _fields(pairs: list[tuple[str, object]]) -> Json:
    fields: Json = {}
    for key, value in pairs:
        if key in fields:
            raise PlanError(f"{_shown(key)} is given twice in one JSON object")
        if not all(text.isprintable() for text in (key, value) if isinstance(text, str)):
            raise PlanError(
                f"the key {_shown(key)} or its value {_shown(value)} has characters that cannot be printed: "
                "make a new plan"
            )
        fields[key] = value
    return fields


def _no_constant(name: str) -> object:
    raise PlanError(f"the file holds {name}, which is no JSON number: make a new plan")


_NAMES: Mapping[type, str] = {
    str: "a string",
    int: "an integer",
    bool: "true or false",
    dict: "an object",
    list: "a list",
}


def _field(fields: Mapping[str, object], key: str, kind: type[_T], place: str) -> _T:
    if key not in fields:
        raise PlanError(f"{place} has no '{key}'")
    value = fields[key]
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise PlanError(f"{place}: '{key}' is {_shown(value)} and must be {_NAMES[kind]}")
    return value


def _object(fields: Mapping[str, object], key: str, place: str) -> Json:
    found: Json = _field(fields, key, dict, place)
    return found


def _shown(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
