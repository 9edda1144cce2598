"""Parts whose state is worth keeping: a first-order filter and an integrator, with `save` and `restore`.

    LowPass     follows its input with a time constant. Started anew, its output jumps to the input, with all its noise
    Integrator  adds up its input over time, within limits. Started anew, it has forgotten all of it

Give their modules a `checkpoint` of 8 bytes in the spec. Then the output goes on from the last state that was saved; it
jumps by what the state has changed since, at most. The time without steps is not made up for: nobody knows what the
input was. Without a checkpoint the parts work, too, and start anew.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.reading import number

_NS_PER_S = 1_000_000_000


class LowPass(Module):
    """A first-order low-pass filter.

    A subclass sets `source` (the input), `output`, and `lag_s`, the time in which the output covers 63 % of a step of
    the input.
    """

    source: ClassVar[str]
    output: ClassVar[str]
    lag_s: ClassVar[float]

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._level: float | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Return the output, moved towards the input; the first output is the input. While it is absent, nothing."""
        given = number(inputs, self.source)
        if given is None:
            return {}
        level = given if self._level is None else self._level
        period_s = self.ctx.period_ns / _NS_PER_S
        self._level = level + (given - level) * period_s / (self.lag_s + period_s)
        return {self.output: self._level}

    def save(self) -> tuple[float, ...]:
        """Return the last output; nothing before the first one."""
        return () if self._level is None else (self._level,)

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:  # noqa: ARG002 - an old level is the best known
        """Go on from the output that was saved."""
        (self._level,) = state


class Integrator(Module):
    """Adds up `gain_per_s` times its input over time, from 0, and within the limits.

    A subclass sets `source` (the input), `output`, `gain_per_s`, `least` and `most`.
    """

    source: ClassVar[str]
    output: ClassVar[str]
    gain_per_s: ClassVar[float]
    least: ClassVar[float]
    most: ClassVar[float]

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._sum = 0.0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Return the sum; while the input is absent, the sum stays as it is."""
        given = number(inputs, self.source)
        if given is not None:
            more = self.gain_per_s * given * self.ctx.period_ns / _NS_PER_S
            self._sum = min(max(self._sum + more, self.least), self.most)
        return {self.output: self._sum}

    def save(self) -> tuple[float, ...]:
        """Return the sum."""
        return (self._sum,)

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:  # noqa: ARG002 - see the head of this file
        """Go on from the sum that was saved."""
        (total,) = state
        self._sum = min(max(total, self.least), self.most)
