"""Comparators: modules that compare two versions of one variable, computed by two different programs.

If the two versions differ, either may be right. So a comparator reports no element as failed. (With three versions or
more, a voter can tell which one is wrong.) A difference beyond `limit` that has lasted for `patience_ns` is a
*disagreement*. The disagreement ends when the versions have agreed for `patience_ns`. While it lasts, the comparator
reports it repeatedly. The manager tells the operator of it, and changes no plan. The output during a disagreement
depends on the kind of comparator:

    ComparatorBetter    the better version, as without a disagreement
    ComparatorSafer     the value nearer to `safe`
    ComparatorNone      no value; the spec decides what the modules that read the output do without a value

While the versions agree, the better one is the output. If only one version is present, this version is the output.

If the two modules that compute the versions had the same image, they would make the same mistakes. So give these
modules different images, and put them on different PEs (`separate` in the spec).
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import is_finite

_MOST_DETAIL = 0xFFFF


class Comparator(Module):
    """Base class of the three comparators in this file; not to be used directly."""

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
        """Return the output while the two versions disagree; None: no output.

        better, worse: the value of the better version, and the value of the other version.
        """
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compare the two best versions, and return the output.

        The step gives no output if no version is present, or if `goes_on` returns None.
        """
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
    """Gives the better of the two best versions of a variable, also while the two disagree.

    A subclass sets `variable`, `output` and `limit`.
    """

    def goes_on(self, better: float, worse: float) -> float:  # noqa: ARG002 - the other one is not wanted
        """Return the value of the better version."""
        return better


class ComparatorSafer(Comparator):
    """Gives, while the two versions disagree, the value that is nearer to `safe`.

    A subclass sets `variable`, `output` and `limit`, and `safe` if it is not 0.
    """

    safe: ClassVar[float] = 0.0

    def goes_on(self, better: float, worse: float) -> float:
        """Return the one of the two values that is nearer to `safe`."""
        return min(better, worse, key=lambda value: abs(value - self.safe))


class ComparatorNone(Comparator):
    """Gives the better of two versions, but no value while they disagree.

    A subclass sets `variable`, `output` and `limit`.
    """

    def goes_on(self, better: float, worse: float) -> None:
        """Return None: while the versions disagree there is no output."""
