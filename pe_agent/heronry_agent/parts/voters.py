"""Voters: modules that compute one value from several variables that should be equal, and report a wrong one.

Each of these variables is called a *channel* here.

    MedianVoter    gives the median of the channels that are present, so that a single wrong channel does not decide. If
                   only two channels are present, and they differ by more than `tolerance`, the voter gives the value
                   that is nearer to its last output
    MajorityVoter  gives the mean of the largest group of channels that agree, if this group has more than half of all
                   channels. Otherwise the voter gives no value; the spec says what its readers do without a value

A voter reports a channel that differs from the output by more than `tolerance`, while more than two channels are
present. If only two channels are present, and they differ, either may be right. So none is reported.
"""

import statistics
from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import number

_BLAMING = 3  # channels that must be present for a report


class Voter(Module):
    """Base class of the voters in this file; not to be used directly."""

    channels: ClassVar[Mapping[str, str]]  # variable -> the element to report for it
    output: ClassVar[str]
    tolerance: ClassVar[float]
    patience_ns: ClassVar[int] = 1_000_000_000

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._odd = {channel: Lasting(self.patience_ns, ctx.period_ns) for channel in self.channels}
        self.last: float | None = None

    def choose(self, heard: list[float]) -> float | None:
        """Return the output, from the values of the channels that are present; None if they do not agree."""
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Vote, and return the output.

        There is no output if no input channel has a value, or if the values of the channels do not agree.
        """
        heard = {channel: value for channel in self.channels if (value := number(inputs, channel)) is not None}
        chosen = self.choose(list(heard.values())) if heard else None
        for channel, odd in self._odd.items():
            is_odd = chosen is not None and channel in heard and abs(heard[channel] - chosen) > self.tolerance
            if odd.is_due(is_odd and len(heard) >= _BLAMING):
                self.ctx.report_failed(self.channels[channel])
        self.last = chosen
        return {} if chosen is None else {self.output: chosen}


class MedianVoter(Voter):
    """Gives the median of its input channels.

    A subclass sets `channels`, `output` and `tolerance`, and may set `patience_ns`.
    """

    def choose(self, heard: list[float]) -> float:
        """Return the median of the values that are present.

        Of two values that differ by more than `tolerance`, return the value nearer to the last output.
        """
        last = self.last
        if len(heard) != 2 or last is None or abs(heard[0] - heard[1]) <= self.tolerance:
            return statistics.median(heard)
        return min(heard, key=lambda value: abs(value - last))


class MajorityVoter(Voter):
    """Gives the value on which more than half of its input channels agree.

    A subclass sets the attributes `channels`, `output` and `tolerance`, and may set `patience_ns`.
    """

    def choose(self, heard: list[float]) -> float | None:
        """Return the mean of the largest group of values that agree within `tolerance`.

        Returns None if this group has no more than half of all channels.
        """
        groups = ([other for other in heard if abs(other - one) <= self.tolerance] for one in heard)
        largest = max(groups, key=len)
        return statistics.fmean(largest) if 2 * len(largest) > len(self.channels) else None
