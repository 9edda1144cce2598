"""Requirements that a campaign checks: `A after 1`, `elevator after 2`, `B after 1 in glide`.

The form is WHAT after N [in PHASE]. Every function of class WHAT (or the function WHAT) that the phase wants is to be
served after every set of up to N faults. A requirement without a phase is about every phase that the campaign covers.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from heronry_dg.field_types import CRITICALITIES
from heronry_dg.model import Function, Spec
from heronry_manager.planner.sweep import FaultSet, Outcome, Phase
from heronry_tools.analysis.campaign.minimal import minimal
from heronry_tools.console.errors import UserError

_FORM: Final = re.compile(r"(?P<what>\S+) after (?P<faults>\d{1,2})( in (?P<phase>\S+))?")


@dataclass(frozen=True, slots=True)
class Requirement:
    """One requirement on the functions that survive faults."""

    text: str
    what: str  # WHAT: a class or a function
    faults: int
    phase: Phase  # None: every phase of the campaign

    def covers(self, function: Function, phase: Phase) -> bool:
        """Tell whether a function must be served in a phase."""
        if function.priority_in(phase) == 0 or (self.phase is not None and phase != self.phase):
            return False
        return self.what == function.name or (
            self.what in CRITICALITIES and function.criticality_in(phase) == self.what
        )


@dataclass(frozen=True, slots=True)
class Offence:
    """A smallest set of faults after which a required function is not served."""

    phase: Phase
    down: FaultSet
    functions: tuple[str, ...]


def read_requirement(spec: Spec, text: str) -> Requirement:
    """Read a requirement; raises UserError."""
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise UserError(
            f"--require '{text}': write WHAT after N [in PHASE], for example 'A after 1' or 'elevator after 2 in glide'"
        )
    what, phase = match["what"], match["phase"]
    if what not in CRITICALITIES and what not in spec.functions:
        raise UserError(f"--require '{text}': '{what}' is neither a class (A to E) nor a function of {spec.name}")
    if phase is not None and phase not in spec.phases:
        raise UserError(
            f"--require '{text}': no phase is named '{phase}'; the spec has {', '.join(spec.phases) or 'none'}"
        )
    return Requirement(text.strip(), what, int(match["faults"]), phase)


def offences(spec: Spec, requirement: Requirement, outcomes: Mapping[tuple[Phase, FaultSet], Outcome]) -> list[Offence]:
    """Find, for each phase, the minimal fault sets that break a requirement.

    A fault set is minimal if no smaller part of it breaks the requirement in this phase.
    """
    broken: dict[Phase, dict[FaultSet, tuple[str, ...]]] = {}
    for (phase, down), outcome in outcomes.items():
        if len(down) <= requirement.faults:
            missing = tuple(
                function.name
                for function in spec.functions.values()
                if requirement.covers(function, phase)
                and not any(output in outcome.configuration.modules for output in function.outputs)
            )
            if missing:
                broken.setdefault(phase, {})[down] = missing
    return [Offence(phase, down, sets[down]) for phase, sets in broken.items() for down in minimal(sets)]
