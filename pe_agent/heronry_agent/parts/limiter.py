"""A rate limiter: the output follows the input, by so much a second at most.

It starts where the input is. While the input is missing it gives nothing, and the consumer's own rule for a missing
datum holds; it goes on from what it gave last, so that a gap is no way around the limit.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number

_NS_PER_S = 1_000_000_000


class RateLimiter(Module):
    """A subclass sets the attributes."""

    source: ClassVar[str]
    output: ClassVar[str]
    most_per_s: ClassVar[float]

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._last: float | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Go towards the input."""
        wanted = number(inputs, self.source)
        if wanted is None:
            return {}
        last = wanted if self._last is None else self._last
        self._last = last + held(wanted - last, self.most_per_s * self.ctx.period_ns / _NS_PER_S)
        return {self.output: self._last}
