"""Deadlines (rule 9) for the greedy planner: bounds that cost microseconds, and the truth behind them.

The exact response-time analysis of `heronry_dg.response_times` takes longer than a greedy plan may. So its recurrence

    w = B + sum of ceil((w + J + tau) / T) C        over all messages on the bus that are more urgent

is asked for less. First in closed form, with (w + J + tau) / T + 1 in place of the round-up:

    w = (B + sum of C (1 + (J + tau) / T)) / (1 - sum of C / T)

then, where that is too late, by iteration. Either gives a response J + w + C that is no less than the exact one, as
long as it is within the message's own period: B is the longest frame there is, so it covers what one instance of a
message may push in front of the next (Davis et al. 2007, section 3.4). And as the first instance alone, it is a lower
bound of the exact one. Sources are looked at in the order of their identifiers, each along its route, so that every
jitter is known when it is needed; what becomes a jitter is always iterated.

All of that is floating point, rounded away from the answer that it gives, and a jitter counts only if rounding does not
change it. What is between the bounds is for the exact analysis, whose verdicts are remembered. So what is accepted here
is what the judge accepts, whatever the rounding.
"""

from collections.abc import Iterable
from math import ceil
from typing import Final

from heronry_dg.response_times import MANAGER_FRAMES, ResponseTimes
from heronry_dg.traffic import Hop
from heronry_manager.planner.greedy.draft import Draft, Publication
from heronry_manager.planner.greedy.tables import Tables
from heronry_wire.timing import WORST_BLOCKING_BITS

_NS_PER_S: Final = 1e9
_MILLIHERTZ_NS: Final = 1e12  # period of 1 mHz
_UP: Final = 1 + 1e-9  # far more than all rounding together
_DOWN: Final = 1 - 1e-9
_FULL: Final = 0.99  # share of a bus above which only the exact analysis says anything
_REMEMBERED: Final = 512  # verdicts

_Stream = tuple[float, float, float]  # frame, period, jitter plus one bit time: ns


class _Level:
    """What is on a bus above the next message."""

    __slots__ = ("blocking", "demand", "load", "streams")

    def __init__(self, blocking_ns: float) -> None:
        self.blocking = self.demand = blocking_ns  # `demand`: numerator of the closed form
        self.load = 0.0
        self.streams: list[_Stream] = []

    def copy(self) -> "_Level":
        one = _Level(self.blocking)
        one.demand, one.load, one.streams = self.demand, self.load, self.streams.copy()
        return one

    def add(self, frame: float, period: float, late: float) -> None:
        """Add a message; `late` is its jitter and one bit time."""
        self.demand += frame * (1 + late / period)
        self.load += frame / period
        self.streams.append((frame, period, late))

    def delay(self, most_ns: float, rounding: float) -> float:
        """Iterate the recurrence until it stands, or is beyond `most_ns`."""
        before, delay = 0.0, self.blocking
        while before < delay <= most_ns:
            before, delay = delay, self.blocking
            for frame, period, late in self.streams:
                delay += frame * ceil((before + late) / period * rounding)
        return delay


class Punctuality:
    """Says whether a draft's messages meet their deadlines."""

    def __init__(self, tables: Tables) -> None:
        """Work out what does not depend on the draft."""
        self._tables = tables
        self._times = ResponseTimes(tables.spec)
        self._urgency = {
            (tables.module_number[module], tables.variable_number[variable]): identifier
            for (module, variable), identifier in self._times.identifiers.items()
        }
        self._steps = [_steps(routes) for routes in tables.route]
        self._wired = [bus.kind == "wired" for bus in tables.buses]
        self._bit_ns = [_NS_PER_S / bus.bitrate for bus in tables.buses]
        self._management = [self._above_data(number) for number in range(len(tables.buses))]
        self._period_ns = [_MILLIHERTZ_NS / mode.rate_mhz for _, mode in tables.modes]
        self._deadline_ns = [tables.spec.variables[name].deadline_ns for name in tables.variables]
        self._verdicts: dict[frozenset[Hop], bool] = {}

    def are_met(self, draft: Draft, more: Iterable[Publication] = ()) -> bool:
        """Tell whether all that a draft publishes is in time, and `more` beside it."""
        messages = [*draft.published, *more]
        verdict = self._bounded(draft, messages)
        return self._exactly(draft, messages) if verdict is None else verdict

    def _above_data(self, bus: int) -> _Level:
        element, bit_ns = self._tables.buses[bus], self._bit_ns[bus]
        level = _Level(WORST_BLOCKING_BITS * bit_ns)
        for _ in range(sum(element.name in pe.buses for pe in self._tables.pes) + MANAGER_FRAMES):
            level.add(WORST_BLOCKING_BITS * bit_ns, element.heartbeat_ns, bit_ns)
        return level

    def _bounded(self, draft: Draft, messages: list[Publication]) -> bool | None:
        """Give the verdict as far as the bounds go; None: they say nothing."""
        buses: dict[tuple[int, int], list[int]] = {}
        for module, variable, bus in messages:
            buses.setdefault((module, variable), []).append(bus)
        above = [level.copy() for level in self._management]
        for source in sorted(buses, key=self._urgency.__getitem__):
            verdict = self._one_source(draft, source, buses[source], above)
            if not verdict:
                return verdict
        return True

    def _one_source(self, draft: Draft, source: tuple[int, int], buses: list[int], above: list[_Level]) -> bool | None:
        """Bound the response times of a source along its route, and add it to what is above the others."""
        module, variable = source
        steps, period = self._steps[draft.pe[module]], self._period_ns[draft.mode[module]]
        given = self._deadline_ns[variable]
        deadline = period if given is None else given
        if len(buses) > 1:
            buses.sort(key=lambda bus: steps[bus][0])
        responses = {-1: 0.0}
        for bus in buses:
            jitter = responses[bus] = responses[steps[bus][1]]
            if not self._wired[bus]:
                continue
            level, bit_ns = above[bus], self._bit_ns[bus]
            frame = self._tables.bits[variable] * bit_ns
            if level.load > _FULL:
                return None
            response = jitter + level.demand / (1 - level.load) + frame
            if len(buses) > 1 or response * _UP > min(period, deadline):
                most, least = (jitter + frame + level.delay(deadline, rounding) for rounding in (_UP, _DOWN))
                if least * _DOWN > deadline:
                    return False
                if most * _UP > min(period, deadline) or (len(buses) > 1 and most != least):
                    return None
                response = most
            responses[bus] = response
            level.add(frame, period, jitter + bit_ns)
        return True

    def _exactly(self, draft: Draft, messages: list[Publication]) -> bool:
        published = frozenset(self._hop(draft, message) for message in messages)
        if published not in self._verdicts:
            if len(self._verdicts) >= _REMEMBERED:
                self._verdicts.clear()
            responses = self._times.responses(sorted(published, key=str))
            self._verdicts[published] = all(response.meets_deadline for response in responses)
        return self._verdicts[published]

    def _hop(self, draft: Draft, message: Publication) -> Hop:
        """Give a publication in the words of the judge."""
        module, variable, bus = message
        tables = self._tables
        after = self._steps[draft.pe[module]][bus][1]
        return Hop(
            producer=tables.modules[module].name,
            variable=tables.variables[variable],
            mode=tables.modes[draft.mode[module]][1].name,
            bus=tables.buses[bus].name,
            after=None if after < 0 else tables.buses[after].name,
        )


def _steps(routes: list[tuple[int, ...]]) -> dict[int, tuple[int, int]]:
    """For each bus on a way from one PE: how many come before it, and which one is the last of those (-1: none)."""
    return {bus: (depth, route[depth - 1] if depth else -1) for route in routes for depth, bus in enumerate(route)}
