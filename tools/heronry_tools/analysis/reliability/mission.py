"""How reliable one function is over a mission: probability of loss, importance of elements, R(t), mean time to failure.

All of this is about the logic of the graph (`failure`): resources are without limit. Every number is exact if it is
known of each element that can lose the function how likely it fails, and no diagram was too large; if not,
probabilities of loss are lower bounds, and R(t) and the mean time to failure are upper bounds. Of a diagram that was
too large there is a proven bound on the other side, too (`truncating`).
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from math import exp, inf
from typing import Final

from heronry_dg.model import Spec
from heronry_tools.analysis.reliability.chances import Hazards
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.failure import Failure, failure
from heronry_tools.analysis.reliability.spec_hazards import mission_hours

_STEPS: Final = (16, 32, 64, 128)  # of the integral, per unit of its variable
_WIDTH: Final = 5.5
_EXACT: Final = 1e-10
_USUAL: Final = 0.01  # probability of an element, where none is known, when nodes to truncate are chosen


@dataclass(frozen=True, slots=True)
class Importance:
    """Two importances of an element.

    birnbaum: by how much the probability of loss grows if the element surely fails instead of never.
    fussell_vesely: the share of the probability of loss that would be gone if the element never failed.
    """

    birnbaum: float
    fussell_vesely: float


class Reliability:
    """The reliability of one function, by the logic of the graph."""

    def __init__(self, spec: Spec, function: str, elements: Collection[str], hazards: Hazards) -> None:
        """Solve the failure of a function if only these elements can fail.

        A diagram that is too large is truncated. Raises TooLargeError if the formula itself is too large.
        """
        self.failure: Failure = failure(spec, function, elements)
        self.hazards = hazards.among(elements)
        self._hours = mission_hours(spec)
        self.sets = self._solved(self.failure.root)

    @cached_property
    def _with_causes(self) -> Solution:
        if not self.hazards.common:
            return self.sets
        return self._solved(self.hazards.with_causes(self.failure.formula, self.failure.root))

    def _solved(self, root: int) -> Solution:
        """Solve a node; what must be truncated is most exact at the end of the mission."""
        formula = self.failure.formula
        likely = dict.fromkeys(formula.events, _USUAL) | self.hazards.chances(self._hours)
        return Solution(formula, root, truncate=likely)

    @property
    def exact(self) -> bool:
        """Tell whether no diagram was truncated."""
        return self._with_causes.exact

    @property
    def unknown(self) -> list[str]:
        """Elements that can lose the function, and of which it is not known how likely they fail."""
        known = self.hazards.known()
        return [one for one in self.sets.support() if one not in known]

    def loss(self, hours: float) -> float:
        """Return the probability that the function is lost within so many hours; a lower bound if it is not `exact`."""
        return self._with_causes.probability(self.hazards.chances(hours))

    def loss_at_most(self, hours: float) -> float:
        """Return an upper bound of that probability; the probability itself if it is `exact`."""
        return self._with_causes.at_most(self.hazards.chances(hours))

    def survival(self, hours: float) -> float:
        """Return R(t): the probability that the function is not lost within so many hours."""
        return self._with_causes.survival(self.hazards.chances(hours))

    def curve(self, hours: float, points: int) -> list[tuple[float, float]]:
        """Return (t, R(t)) at `points` + 1 times from 0 to `hours`, in equal steps."""
        return [(t, self.survival(t)) for t in (hours * number / points for number in range(points + 1))]

    def importance(self, hours: float) -> dict[str, Importance]:
        """Return the importance of each event that can lose the function, common causes, too; the greatest first."""
        chances = self.hazards.chances(hours)
        whole = self._with_causes.probability(chances)
        slopes = self._with_causes.birnbaum(chances)
        found = {
            name: Importance(slope, slope * chances.get(name, 0.0) / whole if whole else 0.0)
            for name, slope in slopes.items()
        }
        return dict(sorted(found.items(), key=lambda item: (-item[1].fussell_vesely, -item[1].birnbaum, item[0])))

    def mean_time_to_failure(self) -> float:
        """Return the mean time until the function is lost, in hours: the integral of R(t); infinite if it may last.

        The integral is taken by the trapezoidal rule after t = exp(u - exp(-u)), which converges as fast as the digits
        of its terms last (Takahashi and Mori); the steps are halved until nothing changes.
        """
        fastest = max(self.hazards.rates.values(), default=0.0)
        if fastest <= 0.0 or self._with_causes.survival(self.hazards.chances(inf)) > 0.0:
            return 0.0 if self.survival(0.0) == 0.0 else inf
        scale = self._scale(1.0 / fastest)
        found = 0.0
        for steps in _STEPS:
            before, found = found, self._integral(scale, steps)
            if abs(found - before) <= _EXACT * found:
                break
        return found

    def _scale(self, hours: float) -> float:
        """Return a time at which R(t) has fallen to about a third of its value at the beginning."""
        first = self.survival(0.0)
        while self.survival(hours) > first / 3.0:
            hours *= 2.0
        return hours

    def _integral(self, scale: float, steps: int) -> float:
        total = 0.0
        for number in range(-int(_WIDTH * steps), int(_WIDTH * steps) + 1):
            u = number / steps
            inner = exp(-u)
            t = exp(u - inner)
            total += self.survival(scale * t) * t * (1.0 + inner)
        return total * scale / steps
