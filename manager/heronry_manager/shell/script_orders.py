"""The operator's order `script`: converts its text to a configuration, since the core does not use component graphs.

The script is applied to the plan of the core's last epoch, in the situation as the core knows it. The manager's loop
waits meanwhile. So, for modules for which the script names no PE, at most `MOST_PLACEMENTS` combinations of PEs are
tried. If there are more combinations, each of these modules gets its first possible PE in the spec's order.
"""

from dataclasses import dataclass
from typing import Final

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.vocabulary import FlyTarget, OperatorSaid
from heronry_manager.shell.control_protocol import FlyScript, Reload
from heronry_pcs.plan_script import apply_to_plan

MOST_PLACEMENTS: Final = 100  # few, since the manager's loop waits for the result


@dataclass(frozen=True, slots=True)
class ReloadSaid:
    """The order `reload` of a client, with the number of its request (`spec_reloads`)."""

    number: int
    order: Reload


@dataclass(frozen=True, slots=True)
class ScriptSaid:
    """The order `script` of a client, with the number of its request; the reply carries the same number."""

    number: int
    order: FlyScript

    def target(self, spec: Spec, core: ManagerCore) -> OperatorSaid:
        """Return the order for the core, in which the configuration that the script makes replaces the script.

        If the script cannot be applied, the order gives the reason instead.
        """
        return OperatorSaid(self.number, target_of(self.order.text, spec, core))


def target_of(text: str, spec: Spec, core: ManagerCore) -> FlyTarget:
    """Apply a script to the configuration of the manager's last plan.

    If the script cannot be applied, the result gives the first error as its `problem`.
    """
    if core.plan is None:
        return FlyTarget(None, "no epoch of this manager runs yet")
    return target_in(text, spec, core.now, core.plan.configuration)


def target_in(text: str, spec: Spec, now: Situation, running: Configuration) -> FlyTarget:
    """Apply a script to the configuration `running` in the situation `now`, and return the result.

    In two cases the result gives a reason as its `problem` instead: the script cannot be applied, or one of its
    edges does not lead from an output of a module to an unwired input for the same variable.
    """
    outcome = apply_to_plan(text, spec, now, running, MOST_PLACEMENTS)
    if outcome.errors:
        first, more = outcome.errors[0], len(outcome.errors) - 1
        place = f"line {first.line}: {first.code}: {first.sentence}"
        return FlyTarget(None, f"{place}, and {more} more" if more else place)
    for start, end in outcome.no_wires:
        return FlyTarget(
            None, f"{start} -> {end} does not lead from an output of a module to an unwired input for the same variable"
        )
    return FlyTarget(outcome.configuration)
