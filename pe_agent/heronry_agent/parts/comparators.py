"""Comparators: modules that compare two versions of one datum, which programs with different images give.

With two versions that differ, either may be right, so no element is reported as failed (a voter does that, from three
versions on). A difference beyond `limit` that has lasted for `patience_ns` is a *disagreement*. The comparator reports
it as such, again and again while it lasts, and the subclass chooses the output. The disagreement ends when the versions
have agreed for as long.

    ComparatorBetter    gives the better version, and only reports the disagreement
    ComparatorSafer     gives the value nearer to `safe`
    ComparatorNone      gives no value, and the spec decides what its readers do without one

While the versions agree, or only one of them is present, the better one is given: with one there is nothing to compare.
Two versions of the same image would share its mistakes. So give the two modules different images, and put them on
different PEs (`separate`). The manager reports a disagreement to the operator and changes no plan.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import is_finite

_MOST_DETAIL = 0xFFFF


class Comparator(Module):
    """Base of the three comparators; a subclass of one of them sets the attributes."""

    variable: ClassVar[str]
    output: ClassVar[str]
    limit: ClassVar[float]  # in the unit of the variable
    patience_ns: ClassVar[int] = 1_000_000_000

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._differs = Lasting(self.patience_ns, ctx.period_ns)
        self._agrees = Lasting(self.patience_ns, ctx.period_ns)
        self.disagree = False

    def goes_on(self, better: float, worse: float) -> float | None:
        """Choose the output while the versions disagree; None: no value."""
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compare the two best versions; no value while none is present, or where a disagreement stops it."""
        heard = [datum.number() for datum in inputs.every(self.variable) if datum.valid and is_finite(datum.value)]
        if len(heard) < 2:
            self._differs.is_due(False)
            return {self.output: heard[0]} if heard else {}
        better, worse, *_ = heard
        difference = abs(better - worse)
        if self._differs.is_due(difference > self.limit):
            self.disagree = True
            self.ctx.report_disagreement(min(round(100 * difference / self.limit), _MOST_DETAIL))
        if self._agrees.is_due(difference <= self.limit):
            self.disagree = False
        chosen = self.goes_on(better, worse) if self.disagree else better
        return {} if chosen is None else {self.output: chosen}


class ComparatorBetter(Comparator):
    """Gives the better version, also while the two disagree; a subclass sets the attributes."""

    def goes_on(self, better: float, worse: float) -> float:  # noqa: ARG002 - the other one is not wanted
        """Choose the better version."""
        return better


class ComparatorSafer(Comparator):
    """Gives the value nearer to `safe` while the two disagree; a subclass sets the attributes."""

    safe: ClassVar[float] = 0.0

    def goes_on(self, better: float, worse: float) -> float:
        """Choose the value that is nearer to the safe one."""
        return min(better, worse, key=lambda value: abs(value - self.safe))


class ComparatorNone(Comparator):
    """Gives no value while the two disagree; a subclass sets the attributes."""

    def goes_on(self, better: float, worse: float) -> None:
        """Choose none."""
