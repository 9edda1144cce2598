"""Deadlines (semantics rule 9) for the greedy planner: bounds that cost microseconds, and the exact analysis.

The exact response-time analysis of `heronry_dg.response_times` takes longer than a greedy plan may take. So this file
first computes bounds. Only where the bounds do not decide, it calls the exact analysis, and remembers its verdicts. So
this check accepts exactly the drafts that the verifier accepts.

*The recurrence* of the exact analysis is

    w = B + sum of ceil((w + J + tau) / T) C        over all messages on the bus that are more urgent

Here w is the delay of a message before its transmission, B the blocking by a frame that is already being sent, and tau
one bit time. J is the jitter of a more urgent message, T its period, and C its transmission time.

*The first bound* of w has a closed form, with (w + J + tau) / T + 1 in place of the round-up:

    w = (B + sum of C (1 + (J + tau) / T)) / (1 - sum of C / T)

*The second bound* is computed if the message is too late by the first one: w by iteration of the recurrence.

With each bound, the response time is w plus J and C of the message itself. It is an upper bound of the exact response
time if it is within the message's own period. The reason: B is the longest frame that exists, so B also covers the case
that one instance of a message is blocked by the instance before it (Davis et al. 2007, section 3.4). The iterated
response time of the first instance alone is also a lower bound of the exact response time.

*Jitter.* Sources are checked in the order of their identifiers, each along its route, so that every jitter is known
when it is needed. The jitter of a message on its next bus is its response time on the bus before. A response time that
is used as a jitter is always iterated.

*Rounding.* The bounds are floating-point numbers, rounded to the safe side. A response time is used as a jitter only if
both directions of rounding give the same value.
"""

from math import ceil
from typing import Final

from heronry_dg.model import Foreign
from heronry_dg.response_times import MANAGER_FRAMES, ResponseTimes, blocking_bits
from heronry_dg.traffic import Hop
from heronry_manager.planner.greedy.draft import Draft, Publication
from heronry_manager.planner.greedy.tables import Tables
from heronry_wire.timing import WORST_BLOCKING_BITS

_NS_PER_S: Final = 1e9
_MILLIHERTZ_NS: Final = 1e12  # period of 1 mHz
_UP: Final = 1 + 1e-9  # far more than all rounding together
_DOWN: Final = 1 - 1e-9
_FULL: Final = 0.99  # share of a bus above which only the exact analysis gives a verdict
_REMEMBERED: Final = 512  # verdicts

Source = tuple[int, int]  # module and variable


class _Level:
    """How much one bus is loaded by the messages that are more urgent than the message to be checked next."""

    __slots__ = ("blocking", "demand", "frames", "load", "streams")

    def __init__(self, blocking_ns: float) -> None:
        self.blocking = self.demand = blocking_ns  # `demand`: numerator of the closed form
        self.frames = 0.0  # the part of the demand with one frame of each message
        self.load = 0.0
        self.streams: dict[tuple[float, float], float] = {}  # (period, lateness) -> transmission times, added up

    def copy(self) -> "_Level":
        one = _Level(self.blocking)
        one.demand, one.frames, one.load, one.streams = self.demand, self.frames, self.load, self.streams.copy()
        return one

    def add(self, frame: float, period: float, late: float) -> None:
        """Add a message to the load.

        frame: its transmission time in ns.
        period: its period in ns.
        late: the sum of its jitter and one bit time, in ns.
        """
        self.demand += frame * (1 + late / period)
        self.frames += frame
        self.load += frame / period
        self.streams[period, late] = self.streams.get((period, late), 0.0) + frame

    def delay(self, most_ns: float, rounding: float) -> float:
        """Compute the delay w of the next message, in ns, by iteration of the recurrence (head of this file).

        The iteration ends when w no longer changes. It also ends when w exceeds `most_ns`: then the value that is
        returned is above `most_ns`, but is not the final one. The iteration starts from the value without round-ups.
        This is below the result, and saves most steps.

        rounding: `_UP` gives an upper bound of w, `_DOWN` a lower bound.
        """
        before, delay = 0.0, (self.demand - self.frames) / (1 - self.load) * _DOWN
        while before < delay <= most_ns:
            before, delay = delay, self.blocking
            for (period, late), frames in self.streams.items():
                delay += frames * ceil((before + late) / period * rounding)
        return delay


class Watch:
    """Checks, before further messages are published, that the draft then still meets all deadlines.

    The checks have a budget. Once it is used up, no further message may be published.
    """

    def __init__(self, punctuality: "Punctuality", budget: int) -> None:
        """Begin with a budget: how many messages all checks together may have before them."""
        self._punctuality, self._budget = punctuality, budget

    def may_publish(self, draft: Draft, more: list[Publication]) -> bool:
        """Tell whether a draft that meets its deadlines also meets them with the messages `more` added.

        False, too, once the budget of this `Watch` for checks is used up. `Draft` calls this method.
        """
        self._budget -= len(draft.published)
        return self._budget >= 0 and self._punctuality.stay_met(draft, more)


class Punctuality:
    """Checks whether the messages of a draft meet their deadlines."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables
        self._times = ResponseTimes(tables.numbers.spec)
        self._urgency = {
            (tables.numbers.module_number[module], tables.numbers.variable_number[variable]): identifier
            for (module, variable), identifier in self._times.identifiers.items()
        }
        self._steps = [_steps(routes) for routes in tables.routes.route]
        self._wired = [bus.kind == "wired" for bus in tables.numbers.buses]
        self._bit_ns = [_NS_PER_S / bus.bitrate for bus in tables.numbers.buses]
        self._foreign = [(number, one) for number, bus in enumerate(tables.numbers.buses) for one in bus.foreign]
        self._management = [self._above_data(number) for number in range(len(tables.numbers.buses))]
        self._period_ns = [_MILLIHERTZ_NS / mode.rate_mhz for _, mode in tables.numbers.modes]
        self._deadline_ns = [tables.numbers.spec.variables[name].deadline_ns for name in tables.numbers.variables]
        self._verdicts: dict[frozenset[Hop], bool] = {}

    def are_met(self, draft: Draft) -> bool:
        """Tell whether all messages of a draft meet their deadlines."""
        messages = list(draft.published)
        verdict = self._bounded(draft, messages, since=0)
        return self._exactly(draft, messages) if verdict is None else verdict

    def stay_met(self, draft: Draft, more: list[Publication]) -> bool:
        """Tell whether a draft that meets its deadlines also meets them with the messages `more` added."""
        messages = [*draft.published, *more]
        since = min(self._urgency[module, variable] for module, variable, _ in more)
        verdict = self._bounded(draft, messages, since)
        return self._exactly(draft, messages) if verdict is None else verdict

    def _above_data(self, bus: int) -> _Level:
        element, bit_ns = self._tables.numbers.buses[bus], self._bit_ns[bus]
        level = _Level(blocking_bits(element) * bit_ns)
        for _ in range(sum(element.name in pe.buses for pe in self._tables.numbers.pes) + MANAGER_FRAMES):
            level.add(WORST_BLOCKING_BITS * bit_ns, element.heartbeat_ns, bit_ns)
        return level

    def _bounded(self, draft: Draft, messages: list[Publication], since: int) -> bool | None:
        """Decide by bounds of the response times whether all messages meet their deadlines.

        None: the bounds do not decide it.

        since: an identifier; all messages that are more urgent than this identifier are known to be in time.
        """
        buses: dict[Source, list[int]] = {}
        for module, variable, bus in messages:
            buses.setdefault((module, variable), []).append(bus)
        above = [level.copy() for level in self._management]
        foreign = self._foreign
        for source in sorted(buses, key=self._urgency.__getitem__):
            on = buses[source]
            if foreign:
                foreign = self._joined(foreign, self._urgency[source], above)
            if self._urgency[source] < since and len(on) == 1:
                self._add(draft, source, on[0], 0.0, above)
                continue
            verdict = self._one_source(draft, source, on, above)
            if not verdict:
                return verdict
        return True

    def _joined(
        self, foreign: list[tuple[int, Foreign]], identifier: int, above: list[_Level]
    ) -> list[tuple[int, Foreign]]:
        """Add the foreign frames that outrank an identifier to the loads of their buses; give those that are left.

        foreign: the number of the bus, and the frames.
        """
        for bus, one in foreign:
            if one.outranks(identifier):
                bit_ns = self._bit_ns[bus]
                above[bus].add(one.bits * bit_ns, one.period_ns, bit_ns)
        return [(bus, one) for bus, one in foreign if not one.outranks(identifier)]

    def _one_source(self, draft: Draft, source: Source, buses: list[int], above: list[_Level]) -> bool | None:
        """Tell whether a source meets its deadline on each bus of its route.

        Returns None if the bounds of its response time do not decide this. If the source meets its deadline, its
        load has been added to `above` for each of these buses.

        buses: numbers of the buses on which the source is published.
        above: by number of a bus, the load of all messages that are more urgent than this source.
        """
        steps = self._steps[draft.pe[source[0]]]
        if len(buses) > 1:
            buses.sort(key=lambda bus: steps[bus][0])
        responses: dict[int, float] = {-1: 0.0}
        for bus in buses:
            jitter = responses[bus] = responses[steps[bus][1]]
            if self._wired[bus]:
                response = self._response(draft, source, above[bus], bus, jitter, is_jitter=len(buses) > 1)
                if not response:
                    return None if response is None else False
                responses[bus] = response
            self._add(draft, source, bus, jitter, above)
        return True

    def _response(
        self, draft: Draft, source: Source, level: _Level, bus: int, jitter: float, *, is_jitter: bool
    ) -> float | None:
        """Return the response time of a source on one bus in ns: an upper bound or, with `is_jitter`, the exact value.

        0: the source is late. None in three cases:

        - the load is too high for the bounds
        - the bounds do not decide whether the source is late
        - `is_jitter` is set, and the bounds do not give the exact value

        level: the load of all messages on the bus that are more urgent than the source.
        jitter: the jitter of the source on this bus, in ns.
        is_jitter: whether the source is sent on several buses, so that its response time on one bus is its
            jitter on the next.
        """
        if level.load > _FULL:
            return None
        period, given = self._period_ns[draft.mode[source[0]]], self._deadline_ns[source[1]]
        deadline = period if given is None else given
        limit = min(period, deadline)
        sent = jitter + self._tables.routes.bits[source[1]] * self._bit_ns[bus]
        response = sent + level.demand / (1 - level.load)
        if response * _UP <= limit and not is_jitter:
            return response
        most = sent + level.delay(deadline, _UP)
        if most * _UP <= limit and not is_jitter:
            return most
        least = sent + level.delay(deadline, _DOWN)
        if least * _DOWN > deadline:
            return 0.0
        return most if most == least and most * _UP <= limit else None

    def _add(self, draft: Draft, source: Source, bus: int, jitter: float, above: list[_Level]) -> None:
        module, variable = source
        bit_ns = self._bit_ns[bus]
        above[bus].add(
            self._tables.routes.bits[variable] * bit_ns, self._period_ns[draft.mode[module]], jitter + bit_ns
        )

    def _exactly(self, draft: Draft, messages: list[Publication]) -> bool:
        published = frozenset(self._hop(draft, message) for message in messages)
        if published not in self._verdicts:
            if len(self._verdicts) >= _REMEMBERED:
                self._verdicts.clear()
            responses = self._times.responses(sorted(published, key=str))
            self._verdicts[published] = all(response.meets_deadline for response in responses)
        return self._verdicts[published]

    def _hop(self, draft: Draft, message: Publication) -> Hop:
        """Convert a message of the draft to a `Hop`, for the exact response-time analysis."""
        module, variable, bus = message
        tables = self._tables
        after = self._steps[draft.pe[module]][bus][1]
        return Hop(
            producer=tables.numbers.modules[module].name,
            variable=tables.numbers.variables[variable],
            mode=tables.numbers.modes[draft.mode[module]][1].name,
            bus=tables.numbers.buses[bus].name,
            after=None if after < 0 else tables.numbers.buses[after].name,
        )


def _steps(routes: list[tuple[int, ...]]) -> dict[int, tuple[int, int]]:
    """Return, for each bus on one PE's routes, how many buses come before it, and which one just before; -1: none."""
    return {bus: (depth, route[depth - 1] if depth else -1) for route in routes for depth, bus in enumerate(route)}
