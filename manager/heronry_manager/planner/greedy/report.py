"""From the integers of a draft to a plan in the words of everybody else.

A draft knows what it is worth, so nothing of that is worked out again from the configuration. What a plan says about
functions that are not served takes longer to find out than the plan took; it is found out when somebody reads it.
"""

from collections.abc import Iterator, Mapping
from functools import cached_property

from heronry_dg.configuration import Configuration, Running
from heronry_dg.model import Spec
from heronry_dg.objective import Objective, Placement, changes
from heronry_dg.plan import BusReport, FunctionReport, PeReport, Plan, level_reports
from heronry_dg.situation import Situation
from heronry_dg.why_not import feasible, why_not
from heronry_manager.planner.greedy.draft import Draft
from heronry_manager.planner.greedy.tables import Tables, Wanted


class FunctionReports(Mapping[str, FunctionReport]):
    """What became of each function; the reasons are found at the first look at a function that is not served."""

    def __init__(self, spec: Spec, now: Situation, served: Mapping[str, FunctionReport]) -> None:
        """`served`: the reports of those that are."""
        self._spec, self._now, self._served = spec, now, served

    def __getitem__(self, name: str) -> FunctionReport:
        return self._served.get(name) or self._unserved[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._spec.functions)

    def __len__(self) -> int:
        return len(self._spec.functions)

    def __repr__(self) -> str:
        return repr(dict(self))

    @cached_property
    def _unserved(self) -> dict[str, FunctionReport]:
        found = feasible(self._spec, self._now)
        return {
            name: FunctionReport(served=False, mode=None, value=0, why_not=why_not(found, function))
            for name, function in self._spec.functions.items()
            if name not in self._served
        }


def plan_of(draft: Draft, tables: Tables, wanted: Wanted, now: Situation, running: Placement | None) -> Plan:
    """Write a draft down as a plan."""
    configuration = configuration_of(draft, tables)
    objective = _objective(draft, tables, wanted, configuration, running)
    return Plan(
        spec=tables.spec.digest,
        now=now,
        configuration=configuration,
        objective=objective,
        optimal=False,
        levels=level_reports(objective, None),
        functions=FunctionReports(tables.spec, now, _served(configuration, tables.spec)),
        pes={
            pe.name: PeReport(
                cpu_millis=sum(tables.cpu[mode] for mode in modes),
                ram=sum(tables.ram[mode] for mode in modes),
                flash=sum(tables.flash[tables.module_of[mode]] for mode in modes),
            )
            for pe, modes in zip(tables.pes, _by_pe(draft), strict=True)
        },
        buses={
            bus.name: BusReport(bits_per_s=load // 1000, load=load / (1000 * bus.bitrate))
            for bus, load in zip(tables.buses, _loads(draft, tables), strict=True)
        },
    )


def configuration_of(draft: Draft, tables: Tables) -> Configuration:
    """Write down what runs, and how it is wired."""
    feeder, modes = draft.feeder, draft.mode
    running = {}
    for module, mode in enumerate(modes):
        if mode >= 0:
            inputs = {
                tables.leaf_path[leaf]: tables.wire[leaf][modes[feeder[leaf]]]
                for leaf in tables.leaves_of[mode]
                if feeder[leaf] >= 0
            }
            name = tables.modules[module].name
            running[name] = Running(tables.pes[draft.pe[module]].name, tables.modes[mode][1].name, inputs)
    return Configuration(running)


def _objective(
    draft: Draft, tables: Tables, wanted: Wanted, configuration: Configuration, running: Placement | None
) -> Objective:
    served = [goal for goal in wanted.goals if any(draft.mode[module] >= 0 for module in goal.outputs)]
    a, b, c, d = (sum(goal.priority for goal in served if goal.rank == rank) for rank in range(4))
    modes = draft.mode
    return Objective(
        critical=(a, b, c, d),
        utility=wanted.score(modes) % wanted.utility_bound,
        inputs=sum(tables.worth[leaf][modes[by]] for leaf, by in enumerate(draft.feeder) if by >= 0),
        changes=changes({name: (one.mode, one.pe) for name, one in configuration.modules.items()}, running),
        branches=sum(
            position for branches in tables.demuxes for position, module in enumerate(branches) if modes[module] >= 0
        ),
        bus_mbit_per_s=sum(_loads(draft, tables)),
        cpu_millis=sum(tables.cpu[mode] for mode in modes if mode >= 0),
    )


def _by_pe(draft: Draft) -> list[list[int]]:
    """Modes that run on each PE."""
    by_pe: list[list[int]] = [[] for _ in draft.on]
    for mode, pe in zip(draft.mode, draft.pe, strict=True):
        if mode >= 0:
            by_pe[pe].append(mode)
    return by_pe


def _loads(draft: Draft, tables: Tables) -> list[int]:
    """Thousandths of a bit/s on each bus."""
    loads = [0] * len(tables.buses)
    for module, variable, bus in draft.published:
        loads[bus] += tables.load[variable][draft.mode[module]]
    return loads


def _served(configuration: Configuration, spec: Spec) -> dict[str, FunctionReport]:
    reports = {}
    for name, function in spec.functions.items():
        output = next((module for module in function.outputs if module in configuration.modules), None)
        if output is not None:
            mode, modes = configuration.modules[output].mode, spec.modules[output].modes
            value = function.value_of(list(modes).index(mode), len(modes))
            reports[name] = FunctionReport(served=True, mode=mode, value=value, why_not=None)
    return reports
