"""Fail-over and N-version: modules that choose one of several values of different quality.

FailOver   gives the first of `sources` that is present. If a better source than the one in use comes back, FailOver
           changes to the better source only after it was present for `patience_ns`, so that an intermittent source does
           not make the output jump
NVersion   compares programs that were written independently. Each program gives the same variable, in a version of its
           own. NVersion gives the best version that is not outvoted. With three or more versions, a version is outvoted
           if it is not within `tolerance` of their median, and the element that gave it is reported. With two versions,
           none is outvoted, and NVersion gives the better one
"""

import statistics
from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import is_finite, number

_BLAMING = 3  # versions that must be present for a report


class FailOver(Module):
    """Gives the value of the first of several variables that is present.

    A subclass sets `sources` (the variables, the best first) and `output`. It may set `patience_ns`: how long
    a better source must have been present before the output changes to it.
    """

    sources: ClassVar[tuple[str, ...]]  # variables, the best first
    output: ClassVar[str]
    patience_ns: ClassVar[int] = 1_000_000_000

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._present = dict.fromkeys(self.sources, 0)
        self._taken: str | None = None
        self._enough = max(1, -(-self.patience_ns // ctx.period_ns))

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Return the value of the source in use; no value if no source is present.

        If the source in use is absent, the best present one replaces it at once. A better source than the one
        in use replaces it after having been present for `patience_ns`.
        """
        heard = {source: value for source in self.sources if (value := number(inputs, source)) is not None}
        self._present = {source: self._present[source] + 1 if source in heard else 0 for source in self.sources}
        if self._taken not in heard:
            self._taken = next(iter(heard), None)
        else:
            self._taken = next(s for s in heard if s == self._taken or self._present[s] >= self._enough)
        return {} if self._taken is None else {self.output: heard[self._taken]}


class NVersion(Module):
    """Gives the value of one variable, chosen among its versions: the best version that the others do not outvote.

    A subclass sets `variable`, `authors` (for each version, the element to report if the version is wrong),
    `output` and `tolerance`, and may set `patience_ns`.
    """

    variable: ClassVar[str]
    authors: ClassVar[Mapping[int, str]]  # version -> the element that gives it
    output: ClassVar[str]
    tolerance: ClassVar[float]
    patience_ns: ClassVar[int] = 1_000_000_000

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._odd = {version: Lasting(self.patience_ns, ctx.period_ns) for version in self.authors}

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Return the best version that is not outvoted; the median if all are outvoted; nothing if none is present."""
        heard = {d.version: d.number() for d in inputs.every(self.variable) if d.valid and is_finite(d.value)}
        if not heard:
            return {}
        middle = statistics.median(heard.values())
        outvoted = {v for v, value in heard.items() if len(heard) >= _BLAMING and abs(value - middle) > self.tolerance}
        for version, odd in self._odd.items():
            if odd.is_due(version in outvoted):
                self.ctx.report_failed(self.authors[version])
        best = min(heard.keys() - outvoted, default=None)
        return {self.output: middle if best is None else heard[best]}
