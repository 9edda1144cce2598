"""A rate limiter: the output follows the input, by `most_per_s` a second at most.

The output starts at the input. While the input is missing the module gives nothing, and the reader's own rule for a
missing datum applies; afterwards the output goes on from its last value, so that a gap does not bypass the limit.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number

_NS_PER_S = 1_000_000_000


class RateLimiter(Module):
    """Limits the rate of one variable; a subclass sets the attributes."""

    source: ClassVar[str]
    output: ClassVar[str]
    most_per_s: ClassVar[float]

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._last: float | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Give the last output, moved towards the input by one step's share of `most_per_s` at most."""
        wanted = number(inputs, self.source)
        if wanted is None:
            return {}
        last = wanted if self._last is None else self._last
        self._last = last + held(wanted - last, self.most_per_s * self.ctx.period_ns / _NS_PER_S)
        return {self.output: self._last}
