"""Turns a draft of the greedy planner, which has only integers, into a plan with the names of the spec.

All levels of the objective but one are computed from the integers; the level *changes* needs the configuration.
"""

from heronry_dg.configuration import Configuration, Running
from heronry_dg.objective import Objective, Placement, changes
from heronry_dg.plan import Plan, level_reports
from heronry_dg.plan_report import Report
from heronry_dg.situation import Situation
from heronry_manager.planner.greedy.draft import Draft
from heronry_manager.planner.greedy.tables import Tables
from heronry_manager.planner.greedy.wanted import Wanted


def plan_of(draft: Draft, tables: Tables, wanted: Wanted, now: Situation, running: Placement | None) -> Plan:
    """Return the plan of a draft, in the names of the spec; the plan is not proven to be the best."""
    configuration = configuration_of(draft, tables)
    objective = _objective(draft, tables, wanted, configuration, running)
    return Plan(
        spec=tables.numbers.spec.digest,
        now=now,
        configuration=configuration,
        objective=objective,
        optimal=False,
        levels=level_reports(objective, None),
        report=Report(tables.numbers.spec, now, configuration),
    )


def configuration_of(draft: Draft, tables: Tables) -> Configuration:
    """Return the configuration of a draft in the names of the spec."""
    feeder, modes, numbers, leaves = draft.feeder, draft.mode, tables.numbers, tables.leaves
    running = {}
    for module, mode in enumerate(modes):
        if mode >= 0:
            inputs = {
                leaves.path[leaf]: leaves.wire[leaf][modes[feeder[leaf]]]
                for leaf in leaves.of_mode[mode]
                if feeder[leaf] >= 0
            }
            name = numbers.modules[module].name
            running[name] = Running(numbers.pes[draft.pe[module]].name, numbers.modes[mode][1].name, inputs)
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
        inputs=sum(tables.leaves.worth[leaf][modes[by]] for leaf, by in enumerate(draft.feeder) if by >= 0),
        changes=changes({name: (one.mode, one.pe) for name, one in configuration.modules.items()}, running),
        branches=sum(
            position for ends in tables.rules.demuxes for position, module in enumerate(ends) if modes[module] >= 0
        ),
        bus_mbit_per_s=sum(_loads(draft, tables)),
        cpu_millis=sum(tables.sizes.cpu[mode] for mode in modes if mode >= 0),
    )


def _loads(draft: Draft, tables: Tables) -> list[int]:
    """Return the load of each bus, by its number, in thousandths of a bit/s."""
    loads = [0] * len(tables.numbers.buses)
    for module, variable, bus in draft.published:
        loads[bus] += tables.routes.load[variable][draft.mode[module]]
    return loads
