"""The parts of a snapshot that follow from the running configuration in the present situation.

These are the functions and modules, the budgets of the PEs, the planned loads of the buses, and the graph.
"""

import re
from dataclasses import dataclass, field, replace
from fractions import Fraction

from heronry_dg import model
from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.plan_document import PlanDocument
from heronry_dg.plan_report import PeReport
from heronry_dg.shortfalls import shortfalls
from heronry_dg.situation import Situation
from heronry_pcs.control_paths import control_paths
from heronry_tools.watch.graph_marks import LiveGraphs, is_degraded
from heronry_tools.watch.snapshot import Budget, Bus, Function, Module, Pe, Place, Plant, Snapshot, Wire

_NOTHING = "nothing runs yet"
_PERCENT = re.compile(r"(?P<percent>\d{1,3}(\.\d{1,3})?)%", re.ASCII)
_UNUSED = PeReport(0, 0, 0)
_UNAVAILABLE = frozenset({"down", "returning"})


@dataclass(frozen=True, slots=True)
class RunningPlan:
    """A configuration, with the plan that it is of; None: it is not known what runs."""

    configuration: Configuration = field(default_factory=Configuration)
    plan: PlanDocument | None = None

    @classmethod
    def of(cls, spec: Spec, plan: PlanDocument | None) -> "RunningPlan":
        """Make a running plan; `plan` is None where it is not known what runs, so that there is no module.

        A module is left out if the spec lacks the module, its mode or its PE.
        """
        if plan is None:
            return NOTHING_RUNS
        known = {
            name: running
            for name, running in plan.modules.items()
            if name in spec.modules and running.mode in spec.modules[name].modes and running.pe in spec.pes
        }
        return cls(Configuration({name: known[name] for name in spec.modules if name in known}), plan)

    def places(self) -> dict[str, Place]:
        """Return the PE and mode of each module."""
        return {name: Place(running.pe, running.mode) for name, running in self.configuration.modules.items()}


NOTHING_RUNS = RunningPlan()


class Situations:
    """Adds to the snapshots of one spec what the running configuration shows.

    It shows, for example, which functions are served, which modules run, and what is in use in the graph.
    """

    def __init__(self, spec: Spec) -> None:
        self._spec, self._graphs = spec, LiveGraphs(spec)

    def first(self, snapshot: Snapshot) -> Snapshot:
        """Return the snapshot with every PE, bus, function and module of the spec; nothing is known of them yet."""
        spec = self._spec
        return replace(
            snapshot,
            pes={pe.name: Pe(pe.node_id) for pe in spec.pes.values()},
            buses={
                bus.name: Bus(bus.bitrate, float(bus.max_load), channels=_channels(bus)) for bus in spec.buses.values()
            },
            functions={
                one.name: Function(wanted=False, criticality=one.criticality_in(None), priority=0)
                for one in spec.functions.values()
            },
            modules={name: Module() for name in spec.modules},
        )

    def shown(self, snapshot: Snapshot, running: RunningPlan) -> Snapshot:
        """Return the snapshot with all that follows from its situation and from the running configuration.

        This is: what is down; the state of functions, modules, PEs and plants; the planned loads of buses; and
        the graph.
        """
        now = self._situation(snapshot)
        loads = {} if running.plan is None else running.plan.buses
        return replace(
            snapshot,
            down=tuple(sorted(now.down)),
            functions=self._functions(snapshot, now, running),
            modules=self._modules(snapshot, now, running),
            pes=self._pes(snapshot, running),
            buses={
                name: replace(bus, planned=loads[name].load if name in loads else None)
                for name, bus in snapshot.buses.items()
            },
            graph=self._graphs.graph(now, running.configuration),
            plants=self._plants(running),
        )

    def _situation(self, snapshot: Snapshot) -> Situation:
        """Return the situation as far as it is known; a PE that was never heard counts as available."""
        missing = {f"pe:{name}" for name, pe in snapshot.pes.items() if pe.standing in _UNAVAILABLE}
        down = (missing | {fault.element for fault in snapshot.faults}) - {f"bus:{self._spec.manager.bus}"}
        limits = {f"bus:{name}": _share(bus.link) for name, bus in snapshot.buses.items() if bus.link is not None}
        return Situation(frozenset(down), limits, snapshot.phase, snapshot.priorities)

    def _functions(self, snapshot: Snapshot, now: Situation, running: RunningPlan) -> dict[str, Function]:
        report = {} if running.plan is None else running.plan.functions
        unknown = snapshot.unknown_epoch
        why = _NOTHING if unknown is None else f"the configuration of epoch {unknown}, which runs, is not known"
        found = {}
        for name, function in self._spec.functions.items():
            before, told, wanted = snapshot.functions[name], report.get(name), now.priority_of(function) > 0
            served = told.served if told is not None else None if unknown is not None else False
            serving = next((one for one in function.outputs if one in running.configuration.modules), None)
            is_missing = wanted and served is False
            found[name] = replace(
                before,
                wanted=wanted,
                criticality=function.criticality_in(now.phase),
                priority=now.priority_of(function),
                served=served,
                degraded=bool(served and serving and is_degraded(self._spec, running.configuration, serving)),
                mode=None if told is None else told.mode,
                value=0 if told is None and served is False else None if told is None else told.value,
                why_not=why if told is None else told.why_not,
                shortfalls=shortfalls(self._spec, running.configuration, serving, now.phase)
                if served and serving
                else (),
                not_since_ns=(before.not_since_ns or snapshot.t_ns) if is_missing else None,
            )
        return found

    def _modules(self, snapshot: Snapshot, now: Situation, running: RunningPlan) -> dict[str, Module]:
        modules = running.configuration.modules
        feasible = self._graphs.feasible(now)
        return {
            name: replace(
                snapshot.modules[name],
                pe=modules[name].pe if name in modules else None,
                mode=modules[name].mode if name in modules else None,
                degraded=name in modules and is_degraded(self._spec, running.configuration, name),
                wires={
                    path: Wire(wire.producer, wire.variable, wire.version)
                    for path, wire in sorted(modules[name].inputs.items())
                }
                if name in modules
                else {},
                can_run=feasible.can_run(module),
            )
            for name, module in self._spec.modules.items()
        }

    def _pes(self, snapshot: Snapshot, running: RunningPlan) -> dict[str, Pe]:
        used = {} if running.plan is None else running.plan.pes
        found = {}
        for name, pe in self._spec.pes.items():
            here = used.get(name, _UNUSED)
            found[name] = replace(
                snapshot.pes[name],
                cpu=Budget(here.cpu_millis, pe.cpu_millis),
                ram=Budget(here.ram, pe.ram),
                flash=Budget(here.flash, pe.flash),
                modules=tuple(m for m, runs in running.configuration.modules.items() if runs.pe == name),
            )
        return found

    def _plants(self, running: RunningPlan) -> dict[str, Plant]:
        """Tell for each plant whether its control loop is closed.

        If it is not known what runs, the state of each plant is None.
        """
        if running is NOTHING_RUNS:
            return {name: Plant() for name in self._spec.plants}
        paths = control_paths(self._spec, running.configuration) if self._spec.plants else {}
        return {name: Plant(path.state.value, path.why) for name, path in paths.items()}


def _channels(bus: model.Bus) -> dict[str, tuple[str, ...]]:
    return {f"{bus.name}.{number}": () for number in range(1, bus.channels + 1)} if bus.channels > 1 else {}


def _share(link: str | None) -> Fraction:
    """Read the usable share of a radio's bandwidth; a text that is none, of a damaged recording, limits nothing."""
    if link == "gone" or link is None:
        return Fraction(0)
    percent = _PERCENT.fullmatch(link)
    return Fraction(1) if percent is None else min(Fraction(1), Fraction(percent["percent"]) / 100)
