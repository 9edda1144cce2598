"""Deadlines (semantics.md rule 9), stated in the model where a solution has missed one.

Almost no message is ever late, so the model has no deadlines at first. Each solution is analysed, and what is late in
it is ruled out, in one of two ways.

*In time.* The first instance of a message leaves in time iff the bus has been free for it at some moment t of its
window: by then B + sum of ceil((t + 1) / T) x C over everything more urgent is at most t (all in bit times). Demand
only jumps just after multiples of the periods T, so few moments count: those, and the end of the window. One literal
for each, and one of them must hold where the message is published. What comes over a gateway needs a moment on either
bus, and both waits together must fit its deadline: one literal for each pair. This is stated once for a message, and
holds for every set of others; it is not stated where the deadline is so far away that there are too many moments. The
condition is necessary, not sufficient: the jitter of the others and later instances of the message are left out.

*Not together.* What is late all the same gets a cut: these messages must not all be published. The analysis names all
that a late message depends on; the set is shrunk, one message after the other, to one that is still late, since the
smaller the set, the more plans its cut rules out. Leaving a message out makes no other one later, so what is late in a
set is late in every larger one (a message that comes from farther away counts as larger, too: it brings more jitter).

Neither way excludes a legal plan.
"""

from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import count
from math import ceil, floor

from ortools.sat.python.cp_model import CpModel, IntVar

from heronry_dg.response_times import Late, ResponseTimes
from heronry_dg.traffic import Hop
from heronry_manager.planner.placing import Terms, weighted
from heronry_manager.planner.publishing import MessageKey, Publishing
from heronry_wire.timing import WORST_BLOCKING_BITS, Message

MOST_MOMENTS = 200  # a message of 1 Hz beside others of up to 100 Hz has about as many


class PlannerDefectError(RuntimeError):
    """The planner has found a defect of its own; the message says which."""


Demand = dict[MessageKey, int]


@dataclass(frozen=True, slots=True)
class _Room:
    """What messages take, each if it is published, must not exceed `most`."""

    demand: Demand
    most: int

    def holds(self, published: Set[MessageKey]) -> bool:
        """Tell whether the sum stays within `most` when these are published."""
        return sum(taken for key, taken in self.demand.items() if key in published) <= self.most


@dataclass(frozen=True, slots=True)
class _Moment:
    """A moment at which a message could leave; what goes before it by then, in bits, and the part that always does."""

    end: int
    always: int
    demand: Demand

    def room(self) -> _Room:
        """Return the condition that the bus has been free by then."""
        return _Room(self.demand, self.end - self.always)


Way = tuple[_Room, ...]
"""How a message can be in time: all of these hold."""


class Deadlines:
    """The deadlines that are stated in a model so far."""

    def __init__(self, model: CpModel, publishing: Publishing, times: ResponseTimes) -> None:
        self._model, self._publishing, self._times = model, publishing, times
        self._punctual: list[frozenset[Hop]] = []  # published together, these meet all deadlines
        self._stated: set[Hop] = set()  # messages whose moments are stated in the model
        self._forbidden: set[frozenset[Hop]] = set()

    def are_met(self, published: frozenset[Hop]) -> bool:
        """Tell whether these hops meet all deadlines; if not, forbid them in the model."""
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
        """Remember that these hops meet all deadlines."""
        self._punctual.append(published)

    def _state(self, hop: Hop, published: Iterable[Hop]) -> bool:
        """State in the model when a message leaves in time; tell whether that rules out what is published."""
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
        """Return every way in which a message can be in time; None: there are too many."""
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
        """Return the condition that a message has time to cross two buses beside more urgent ones: ns, rounded down."""
        left_ns = self._times.message(hop).deadline / self._times.bits_per_ns(hop.bus)
        demand: Demand = {}
        for one, moment in ((before, first), (hop, then)):
            ns_per_bit = 1 / self._times.bits_per_ns(one.bus)
            left_ns -= (moment.always + self._times.message(one).bits) * ns_per_bit
            demand |= {key: floor(bits * ns_per_bit) for key, bits in moment.demand.items()}
        return _Room(demand, floor(left_ns))

    def _moments(self, hop: Hop, jitter: Fraction) -> list[_Moment] | None:
        """Return every moment at which a message could leave in time, the earliest first; None: there are too many.

        jitter: bit times of its bus that the message may have taken to come there.
        """
        own = self._times.message(hop)
        window = own.deadline - own.bits - jitter
        above = self._times.management[hop.bus]
        rivals = {
            key: self._times.message(one) for key, one in self._publishing.more_urgent(hop, self._times.identifiers)
        }
        periods = {Fraction(message.period) for message in (*above, *rivals.values())}
        if sum(window // period for period in periods) > MOST_MOMENTS:
            return None
        ends = {end for period in periods for end in _jumps(period, window)}
        moments = []
        for end in sorted(ends | {window} if window > 0 else ends):
            always = WORST_BLOCKING_BITS + sum(_demand(message, end) for message in above)
            if always <= floor(end):
                demand = {key: _demand(message, end) for key, message in rivals.items()}
                moments.append(_Moment(floor(end), always, demand))
        return moments

    def _least_jitter(self, hop: Hop) -> Fraction:
        """Least jitter that a message brings from the bus before: the jitter it would have if it were alone there."""
        if hop.after is None:
            return Fraction(0)
        alone = self._times.responses([replace(hop, bus=hop.after, after=None)])
        bounded = (one.response_ns for one in alone if one.response_ns is not None)
        return max(0, next(bounded, 1) - 1) * self._times.bits_per_ns(hop.bus)  # it is rounded up

    def _forbid(self, late: Late) -> frozenset[Hop]:
        """Forbid the set that makes a message late; raises PlannerDefectError where that set was forbidden before."""
        messages = shrunk(self._times, late)
        if messages in self._forbidden:
            raise PlannerDefectError(
                f"these were forbidden together and are planned again: {sorted(map(str, messages))}"
            )
        self._forbidden.add(messages)
        self._publishing.forbid_together(messages)
        return messages


def deadline_conflicts(times: ResponseTimes, published: Iterable[Hop]) -> list[frozenset[Hop]]:
    """Return sets of published hops that miss a deadline together; none when all deadlines are met."""
    conflicts: list[frozenset[Hop]] = []
    for late in times.late(published):
        if not any(known <= late.causes for known in conflicts):
            conflicts.append(shrunk(times, late))
    return conflicts


def shrunk(times: ResponseTimes, late: Late) -> frozenset[Hop]:
    """Shrink a late set: leave out source after source, the least urgent first, as long as the message stays late."""
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
    """Moments in a window just after which one more instance of a message counts."""
    end = period - 1
    while end < window:
        yield end
        end += period


def _demand(message: Message, end: Fraction) -> int:
    """Bits of all instances of a message that count at a moment."""
    return ceil((end + 1) / message.period) * message.bits
