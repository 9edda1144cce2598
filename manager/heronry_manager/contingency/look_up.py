"""The look-up of a plan that was made ahead for the present faults: in microseconds, without a solver.

A plan made ahead was verified when it was made, and again when its file was checked. In flight the look-up only checks
three preconditions of the plan:

    faults           the elements that are down have the same effect as the plan's fault set. Elements that are down as
                     a consequence make no difference: a PE behind a dead gateway, a device on a dead PE, a module
                     without a working PE
    phase            the phase is that of the plan
    configuration    the fault-free configuration of the phase runs, module by module. At the start, when nothing is
                     down, the running configuration need not be known, since changes cost nothing then

If a precondition is not met, the planner must answer. For example, while another configuration runs, a plan made ahead
would be legal, but not the plan with the fewest changes.

*Safe mode.* The safe mode of a phase serves the critical functions of the phase. It is a plan of last resort for any
situation in which it is legal (`safe_mode`).

The file holds configurations. A look-up makes a plan with its report from a configuration, and keeps the plan. This
takes longer than a look-up may, so for single faults the plans are made at the start.
"""

from heronry_dg.losses import lost_of
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, placement, score
from heronry_dg.plan import Plan, make_plan
from heronry_dg.situation import Situation, elements, places, survivors
from heronry_dg.verify import verify
from heronry_manager.contingency.contingencies import Contingencies, Made
from heronry_manager.planner.sweep import FaultSet, Phase


class ContingencyTable:
    """Looks up the contingencies of one spec."""

    def __init__(self, spec: Spec, made: Contingencies) -> None:
        self._spec, self._contingencies = spec, made
        self._made = {(phase, down): plan for phase, down, plan in made.entries()}
        self._running: dict[Phase, Placement] = {
            phase: placement(made.configuration(self._made[phase, frozenset()].number)) for phase in made.scope.phases
        }
        named = [*elements(spec), *(place for module in spec.modules for place in places(spec, module))]
        self._implied = {element: _implied(spec, element) for element in named}
        self._plans: dict[tuple[Phase, FaultSet], Plan] = {}
        for phase, down in self._made:
            plan = self.plan(down, phase, self._running[phase]) if len(down) <= 1 else None
            if plan is not None:
                plan.report.work_out()

    def find(self, down: FaultSet, phase: Phase, running: Placement | None) -> Made | None:
        """Find the plan made ahead for these faults, this phase and this running configuration.

        None: no plan was made for these faults in this phase, or the running configuration is not known to be
        the one that the plan requires; the head of this file says which one that is.
        """
        found = self._made.get((phase, self._named_once(down)))
        if found is None or (running is None and down):
            return None
        return found if running is None or running == self._running[phase] else None

    def plan(self, down: FaultSet, phase: Phase, running: Placement | None) -> Plan | None:
        """Return what `find` gives, as a whole plan with its report; None: `find` gives None."""
        found = self.find(down, phase, running)
        if found is None:
            return None
        known = self._plans.get((phase, down))
        if known is None:
            configuration = self._contingencies.configuration(found.number)
            now = Situation(down, {}, phase)
            known = make_plan(self._spec, now, configuration, found.objective, optimal=found.optimal)
            self._plans[phase, down] = known
        return known

    def safe_mode(self, now: Situation, running: Placement | None) -> Plan | None:
        """Return the safe mode of the present phase as a plan; None: it is not legal in the situation `now`."""
        table = next((table for table in self._contingencies.phases if table.phase == now.phase), None)
        if table is None:
            return None
        configuration = self._contingencies.configuration(table.safe_mode)
        if verify(self._spec, now, configuration):
            return None
        return make_plan(self._spec, now, configuration, score(self._spec, now, configuration, running), optimal=False)

    def _named_once(self, down: FaultSet) -> FaultSet:
        """Leave out the elements that count as down only because another element of the set is down."""
        if len(down) < 2:
            return down
        return frozenset(one for one in down if not any(one in self._implied[other] for other in down))


def _implied(spec: Spec, element: str) -> frozenset[str]:
    """Return the elements that count as down while `element` is down; no two elements imply each other."""
    left = survivors(spec, Situation(frozenset({element})))
    hosts = {module.name: left.hosts(module) for module in spec.modules.values()}
    homeless = (f"module:{name}" for name, pes in hosts.items() if not pes)
    lost = (place for name, pes in hosts.items() for place in places(spec, name) if place.partition("@")[2] not in pes)
    return (lost_of(left) | frozenset((*homeless, *lost))) - {element}
