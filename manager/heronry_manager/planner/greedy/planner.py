"""The greedy planner: a legal plan for any situation, without a search or a solver, in pure Python.

The plan is not proven to be the best. The planner works in these steps:

    1. It repairs the configuration that ran before (`repairing`): it keeps what still works, serves lost functions
       where there is room, and makes room for the more important ones.
    2. A function of class A to D may still not be served, though no fault prevents it. Then the planner chooses and
       packs the modules for these functions anew (`packing`), in up to two ways. It repairs each result, and takes the
       best draft.
    3. It checks the deadlines (`punctuality`). If the draft would miss one, steps 1 and 2 are done once more, with a
       check of every message before the message is published.
    4. It supplies optional and better inputs (`supplying`).

A plan is legal by construction: every step of a draft keeps the limits of capacities, placement rules, gates and buses
(`draft`). The empty plan is always legal, so there is always a plan.

The planner uses no clock and no random source, and all its state follows from the spec. So the same situation and the
same running configuration always give the same plan.

    tables       the spec in integers, computed once
    scene        the part of the spec that a situation leaves
    draft        a configuration in the making; every change can be undone
    serving      one function at a time
    repairing    the order of the steps; which function gives way to which
    packing      when room is scarce
    supplying    optional inputs
    punctuality  deadlines
    report       from integers to a plan
"""

from heronry_dg.model import Spec
from heronry_dg.objective import CRITICAL_CLASSES, Placement
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation
from heronry_manager.planner.greedy.packing import packings
from heronry_manager.planner.greedy.punctuality import Punctuality
from heronry_manager.planner.greedy.repairing import Repair
from heronry_manager.planner.greedy.report import plan_of
from heronry_manager.planner.greedy.scene import Scene, Scenery
from heronry_manager.planner.greedy.serving import Before
from heronry_manager.planner.greedy.tables import tables_of
from heronry_manager.planner.greedy.wanted import Wanted


class Greedy:
    """The greedy planner of one spec."""

    def __init__(self, spec: Spec) -> None:
        """Compute everything that does not depend on faults, which takes some milliseconds or more."""
        closed = {phase: _closed(spec, phase) for phase in (None, *spec.phases)}
        phase_of = {inputs: phase for phase, inputs in closed.items()}
        prepared = {inputs: _Prepared(spec.in_phase(phase)) for inputs, phase in phase_of.items()}
        self._prepared = {phase: prepared[inputs] for phase, inputs in closed.items()}

    def plan(self, now: Situation, running: Placement | None = None) -> Plan:
        """Find a legal configuration, not proven to be the best.

        now: a situation of this spec.
        running: the running configuration. The plan keeps as much of it as possible without a loss for any function.
            None: the running configuration is not known.
        """
        return self._prepared[now.phase].plan(now, running)


def _closed(spec: Spec, phase: str | None) -> frozenset[tuple[str, str, str]]:
    """Return the inputs (module, mode, path) that must not be wired in a phase."""
    return frozenset(
        (module.name, mode.name, path)
        for module in spec.modules.values()
        for mode in module.modes.values()
        for path, leaf in mode.leaves()
        if not leaf.is_open_in(phase)
    )


class _Prepared:
    """The greedy planner for a group of phases: all phases in which the same inputs may be wired."""

    def __init__(self, spec: Spec) -> None:
        """Compute the tables for all phases in which the same inputs may be wired.

        spec: the spec without the inputs that must not be wired in these phases.
        """
        self._tables = tables_of(spec)
        self._scenery = Scenery(self._tables)
        self._punctuality = Punctuality(self._tables)

    def plan(self, now: Situation, running: Placement | None) -> Plan:
        """Plan as `Greedy.plan` does; the phase of `now` must be one of those for which this object was made."""
        scene = self._scenery.scene(now)
        wanted = self._tables.wanted(now)
        repair = self._repaired(wanted, scene, self._before(scene, running or {}))
        return plan_of(repair.draft, self._tables, wanted, now, running)

    def _before(self, scene: Scene, running: Placement) -> Before:
        tables = self._tables
        before = [(-1, -1)] * len(tables.numbers.modules)
        for name, (mode, pe) in running.items():
            number, place = tables.numbers.mode_number.get((name, mode), -1), tables.numbers.pe_number.get(pe, -1)
            if number >= 0:
                is_up = place >= 0 and scene.pes >> place & 1
                before[tables.numbers.module_of[number]] = (number, place if is_up else -1)
        return before

    def _repaired(self, wanted: Wanted, scene: Scene, before: Before) -> Repair:
        """Make a draft that meets its deadlines, with optional inputs; gives the `Repair` that holds the draft.

        If a message of the first draft would be late, another draft is made in which each message is checked.
        """
        repair = self._best(wanted, scene, before, None)
        if not self._punctuality.are_met(repair.draft):
            repair = self._best(wanted, scene, before, self._punctuality)
        repair.supply(self._punctuality)
        return repair

    def _best(self, wanted: Wanted, scene: Scene, before: Before, punctuality: Punctuality | None) -> Repair:
        """Return the draft that is best at levels 1 and 2, of those that are made here.

        The first draft is made from the configuration `before`. As long as the best draft leaves a critical function
        unserved, a further draft is made from places that `packings` proposes, until `packings` proposes no more.

        punctuality: if it is given, the drafts meet all deadlines; None: they may miss deadlines.
        """
        best = Repair(self._tables, wanted, scene, before)
        best.run(punctuality)
        anew = packings(self._tables, wanted, scene)
        while any(goal.rank < len(CRITICAL_CLASSES) for goal in best.unserved()):
            places = next(anew, None)
            if places is None:
                break
            other = Repair(self._tables, wanted, scene, places)
            other.run(punctuality)
            best = other if other.score() > best.score() else best
        return best
