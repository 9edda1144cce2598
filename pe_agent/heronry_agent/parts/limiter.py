"""A rate limiter: a module whose output follows its input, but changes by at most `most_per_s` per second.

The first output equals the input. While the input is missing the module gives no output. Afterwards the output
continues from its last value, so that a gap in the input cannot cause a jump.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import held, number

_NS_PER_S = 1_000_000_000


class RateLimiter(Module):
    """Limits how fast a variable changes.

    A subclass sets `source` (the input), `output`, and `most_per_s`, the largest change in one second.
    """

    source: ClassVar[str]
    output: ClassVar[str]
    most_per_s: ClassVar[float]

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._last: float | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Return the last output, moved towards the input by no more than the limit allows in one period.

        The first output is the input itself. While the input is absent, nothing is returned.
        """
        wanted = number(inputs, self.source)
        if wanted is None:
            return {}
        last = wanted if self._last is None else self._last
        self._last = last + held(wanted - last, self.most_per_s * self.ctx.period_ns / _NS_PER_S)
        return {self.output: self._last}
