"""Voters: one value out of several that should be the same, with a report of a channel that differs.

    median    the median of the channels that are present: no single wrong channel decides. Of two that differ, the one
              nearer to the last output
    majority  the mean of the largest group that agrees, if it is more than half of all channels; else nothing is given,
              and the spec says what the reader does without it

A channel is reported that is further than `tolerance` from the output while more than two are present. Of two that
differ either may be right.
"""

import statistics
from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import number

_BLAMING = 3  # channels that must be present for a report


class Voter(Module):
    """Base of the two voters; a subclass of one of them sets the attributes."""

    channels: ClassVar[Mapping[str, str]]  # variable -> the element to report for it
    output: ClassVar[str]
    tolerance: ClassVar[float]
    patience_ns: ClassVar[int] = 1_000_000_000

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._odd = {channel: Lasting(self.patience_ns, ctx.period_ns) for channel in self.channels}
        self.last: float | None = None

    def choose(self, heard: list[float]) -> float | None:
        """Give the output for one or more values; None where they do not agree."""
        raise NotImplementedError

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Vote; gives nothing while no channel is present, or there is no agreement."""
        heard = {channel: value for channel in self.channels if (value := number(inputs, channel)) is not None}
        chosen = self.choose(list(heard.values())) if heard else None
        for channel, odd in self._odd.items():
            is_odd = chosen is not None and channel in heard and abs(heard[channel] - chosen) > self.tolerance
            if odd.is_due(is_odd and len(heard) >= _BLAMING):
                self.ctx.report_failed(self.channels[channel])
        self.last = chosen
        return {} if chosen is None else {self.output: chosen}


class MedianVoter(Voter):
    """Gives the median of the channels."""

    def choose(self, heard: list[float]) -> float:
        """Give the median, or of two that differ the one nearer to the last value."""
        last = self.last
        if len(heard) != 2 or last is None or abs(heard[0] - heard[1]) <= self.tolerance:
            return statistics.median(heard)
        return min(heard, key=lambda value: abs(value - last))


class MajorityVoter(Voter):
    """Gives the value on which more than half of all channels agree."""

    def choose(self, heard: list[float]) -> float | None:
        """Give the mean of the largest group within the tolerance of one of them, if it is a majority."""
        groups = ([other for other in heard if abs(other - one) <= self.tolerance] for one in heard)
        largest = max(groups, key=len)
        return statistics.fmean(largest) if 2 * len(largest) > len(self.channels) else None
