"""Deadlines (semantics rule 9), added to the solver's model when a solution has missed one.

Almost no message is ever late, so the model has no deadlines at first. Each solution is analysed. Late messages of
a solution are ruled out in two ways. Neither way excludes a legal plan.

*In time* is a condition on one message. It is added once, and holds for every set of other messages. The message
has a *window*: the time from its release until the latest moment at which its transmission may begin. Its first
instance leaves in time if and only if the bus is free for it at some moment t in the window:

    B + sum of ceil((t + 1) / T) x C  <=  t          all in bit times

    B   the longest blocking by a frame that is already being sent
    T   period of a more urgent message; the sum is over all these messages
    C   length of that message

The sum grows only just after the moments t = k x T - 1. So only these moments, and the end of the window, have to be
examined. The model has one literal for each of them. If the message is published, one of its literals must hold. A
message that comes over a gateway needs a moment on each of the two buses, and both waits together must fit its
deadline. So it has one literal for each pair of moments; if there are too many pairs, only the second bus is
considered.

If the deadline is far away, there may be too many moments; then the condition is not added. The condition is
necessary, but not sufficient: it leaves out the jitter of the more urgent messages, and later instances of the
message.

*Not together* is a set of messages that must not all be published: a cut. It is added if a message is late although
the solution meets its condition *in time*, or if the model does not have this condition. The analysis names all
messages on which the late message depends. Messages are taken out of this set, one after the other, as long as the
late message stays late: the smaller the set, the more plans the cut rules out. A message that is late in a set is
late in every larger set, since a further message makes no message earlier. It is also late if another message of the
set comes over more buses, since that message then has more jitter.
"""

from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import count
from math import ceil, floor

from heronry_dg.response_times import Late, ResponseTimes
from heronry_dg.traffic import Hop
from heronry_manager.planner.cp_sat import CpModel, IntVar
from heronry_manager.planner.placing import Terms, weighted
from heronry_manager.planner.publishing import MessageKey, Publishing
from heronry_wire.timing import Message

MOST_MOMENTS = 200  # a message of 1 Hz beside others of up to 100 Hz has about as many


class PlannerDefectError(RuntimeError):
    """The planner has found a defect in itself; the message says which."""


Demand = dict[MessageKey, int]


@dataclass(frozen=True, slots=True)
class _Room:
    """A linear condition: the sum of `demand` over the published messages must not exceed `most`."""

    demand: Demand
    most: int

    def holds(self, published: Set[MessageKey]) -> bool:
        """Tell whether this condition holds if exactly these messages are published."""
        return sum(taken for key, taken in self.demand.items() if key in published) <= self.most


@dataclass(frozen=True, slots=True)
class _Moment:
    """A moment at which a message could leave, if the bits of all more urgent messages were sent before.

    end: the moment, in bit times of the bus.
    always: bits that are sent before `end` in any case.
    demand: for each other message, the bits that are sent before `end` if that message is published.
    """

    end: int
    always: int
    demand: Demand

    def room(self) -> _Room:
        """Return the condition under which the message can leave at this moment.

        The condition holds if all more urgent bits have been sent by then.
        """
        return _Room(self.demand, self.end - self.always)


Way = tuple[_Room, ...]
"""One way in which a message can be in time: all these conditions hold."""


class Deadlines:
    """Adds to the solver's model the deadlines that solutions of the model have missed."""

    def __init__(self, model: CpModel, publishing: Publishing, times: ResponseTimes) -> None:
        self._model, self._publishing, self._times = model, publishing, times
        self._punctual: list[frozenset[Hop]] = []  # sets of hops that meet all deadlines
        self._stated: set[Hop] = set()  # messages whose moments are in the model
        self._forbidden: set[frozenset[Hop]] = set()

    def are_met(self, published: frozenset[Hop]) -> bool:
        """Tell whether these hops meet all deadlines if they are published; if not, exclude this set from the model."""
        if any(published <= known for known in self._punctual):
            return True
        late = self._times.late(published)
        if not late:
            self._punctual.append(published)
            return True
        met_with: list[frozenset[Hop]] = []
        for one in late:
            if not self._state(one.hop, published) and not any(known <= one.causes for known in met_with):
                met_with.append(self._forbid(one))
        return False

    def know(self, published: frozenset[Hop]) -> None:
        """Remember that all deadlines are met if these hops are published."""
        self._punctual.append(published)

    def _state(self, hop: Hop, published: Iterable[Hop]) -> bool:
        """Add to the model the condition that the message of `hop` leaves in time.

        Tells whether the messages in `published` violate this condition.

        Returns False, and adds nothing, in two cases: this was called for this hop before; the condition would
        have more than MOST_MOMENTS moments.
        """
        if hop in self._stated:
            return False
        self._stated.add(hop)
        ways = self._ways(hop)
        if ways is None:
            return False
        names = (f"{hop.producer}:{hop.variable} is in time on {hop.bus}, {number}" for number in count())
        self._publishing.one_of(list(map(self._literal_of, ways, names)), hop)
        taken = {self._publishing.key(one) for one in published}
        return not any(all(room.holds(taken) for room in way) for way in ways)

    def _literal_of(self, way: Way, name: str) -> IntVar:
        literal = self._model.new_bool_var(name)
        for room in way:
            if sum(room.demand.values()) > room.most:
                terms: Terms = [(self._publishing.messages[key], taken) for key, taken in room.demand.items()]
                self._model.add(weighted(terms) <= room.most).only_enforce_if(literal)
        return literal

    def _ways(self, hop: Hop) -> list[Way] | None:
        """Return the ways in which a message can be in time, each a list of conditions.

        None: there are too many moments at which the message could leave its bus in time (`_moments`).
        """
        moments = self._moments(hop, self._least_jitter(hop))
        if moments is None:
            return None
        on_one_bus: list[Way] = [(moment.room(),) for moment in moments]
        if hop.after is None:
            return on_one_bus
        before = replace(hop, bus=hop.after, after=None)
        earlier = self._moments(before, Fraction(0))
        if earlier is None or len(earlier) * len(moments) > MOST_MOMENTS:
            return on_one_bus
        both = ((first, then, self._together(before, first, hop, then)) for first in earlier for then in moments)
        return [(first.room(), then.room(), together) for first, then, together in both if together.most >= 0]

    def _together(self, before: Hop, first: _Moment, hop: Hop, then: _Moment) -> _Room:
        """Return the condition under which a message that takes two buses, one after the other, meets its deadline.

        In this condition all times are in ns. Its demand is the time for which more urgent messages keep the two
        buses busy before the message leaves.

        before: the hop on the first bus. first: the moment at which the message leaves the first bus.
        hop: the hop on the second bus. then: the moment at which the message leaves the second bus.
        """
        left_ns = self._times.message(hop).deadline / self._times.bits_per_ns(hop.bus)
        demand: Demand = {}
        for one, moment in ((before, first), (hop, then)):
            ns_per_bit = 1 / self._times.bits_per_ns(one.bus)
            left_ns -= (moment.always + self._times.message(one).bits) * ns_per_bit
            demand |= {key: floor(bits * ns_per_bit) for key, bits in moment.demand.items()}
        return _Room(demand, floor(left_ns))

    def _moments(self, hop: Hop, jitter: Fraction) -> list[_Moment] | None:
        """List the moments at which a message could start to leave and still meet its deadline, the earliest first.

        None: there may be more than MOST_MOMENTS of them.

        jitter: how late after its release the message may come to this bus, in bit times of this bus.
        """
        own = self._times.message(hop)
        window = own.deadline - own.bits - jitter
        above = self._times.always_above(hop)
        rivals = {
            key: self._times.message(one) for key, one in self._publishing.more_urgent(hop, self._times.identifiers)
        }
        periods = {Fraction(message.period) for message in (*above, *rivals.values())}
        if sum(window // period for period in periods) > MOST_MOMENTS:
            return None
        ends = {end for period in periods for end in _jumps(period, window)}
        moments = []
        for end in sorted(ends | {window} if window > 0 else ends):
            always = self._times.blocking_bits[hop.bus] + sum(_demand(message, end) for message in above)
            if always <= floor(end):
                demand = {key: _demand(message, end) for key, message in rivals.items()}
                moments.append(_Moment(floor(end), always, demand))
        return moments

    def _least_jitter(self, hop: Hop) -> Fraction:
        """Return a lower bound, in bit times, of the jitter that a message has from the previous bus of its route.

        For this bound, the message is taken to be the only data on that bus.
        """
        if hop.after is None:
            return Fraction(0)
        alone = self._times.responses([replace(hop, bus=hop.after, after=None)])
        bounded = (one.response_ns for one in alone if one.response_ns is not None)
        return max(0, next(bounded, 1) - 1) * self._times.bits_per_ns(hop.bus)  # the response time is rounded up

    def _forbid(self, late: Late) -> frozenset[Hop]:
        """Exclude from the model a set of hops that makes a message late.

        Raises PlannerDefectError if this set was excluded before.
        """
        messages = shrunk(self._times, late)
        if messages in self._forbidden:
            raise PlannerDefectError(
                f"the search combined messages that exclude each other: {sorted(map(str, messages))}"
            )
        self._forbidden.add(messages)
        self._publishing.forbid_together(messages)
        return messages


def deadline_conflicts(times: ResponseTimes, published: Iterable[Hop]) -> list[frozenset[Hop]]:
    """Return small sets of published hops such that the hops of one set together make a message late.

    The list is empty if all deadlines are met. There is one set for each late message. But a message adds no set if
    it depends (`Late.causes`) on all hops of a set that is already in the list.
    """
    conflicts: list[frozenset[Hop]] = []
    for late in times.late(published):
        if not any(known <= late.causes for known in conflicts):
            conflicts.append(shrunk(times, late))
    return conflicts


def shrunk(times: ResponseTimes, late: Late) -> frozenset[Hop]:
    """Return a small subset of `late.causes` that makes the same message late.

    Sources are left out one after another, the least urgent first, if the message is still late without them.
    """
    kept = late.causes
    urgency = {hop: times.identifiers[hop.producer, hop.variable] for hop in kept}
    sources = dict.fromkeys((hop.producer, hop.variable) for hop in sorted(kept, key=lambda hop: -urgency[hop]))
    sources.pop((late.hop.producer, late.hop.variable))
    for source in sources:
        fewer = frozenset(hop for hop in kept if (hop.producer, hop.variable) != source)
        if any(still.hop == late.hop for still in times.late(fewer)):
            kept = fewer
    return kept


def _jumps(period: Fraction, window: Fraction) -> Iterator[Fraction]:
    """Yield each moment just after which one more instance of a message with this period takes bus time.

    Moments are in bit times after the beginning of a window. `window`: the end of the window.
    """
    end = period - 1
    while end < window:
        yield end
        end += period


def _demand(message: Message, end: Fraction) -> int:
    """Return the bits of all instances of a message released up to `end` (bit times after a window begins)."""
    return ceil((end + 1) / message.period) * message.bits
