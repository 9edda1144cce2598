"""Computes how late a datum can arrive, by response-time analysis of every bus (semantics rule 9).

The analysis itself is `heronry_wire.timing`. Its input is the list of frames on a wired bus, by priority; this file
makes the list:

    1. the management frames: in each heartbeat period one 8-byte frame for each PE of the bus and two frames of the
       manager. A PE that is down counts, too, since it may come back
    2. the data and the foreign frames, by identifier
    3. one 8-byte frame of lower priority that has just started; it has 29 bits of identifier if any foreign frame has

The delay of a datum on one bus is its jitter on the next bus, so a response time counts from the source. A wireless bus
is not analysed and adds no delay. Some data may cross two buses in one direction, and other data in the opposite
direction. So the analysis of all buses is repeated until no jitter changes. The repetition ends, because only data with
smaller identifiers delay a datum, and a datum has the same identifier on every bus.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import ceil

from heronry_dg.model import Bus, Foreign, Spec
from heronry_dg.traffic import Hop, frame_bits, identifiers
from heronry_wire.frame import MAX_DATA_BYTES
from heronry_wire.timing import WORST_BLOCKING_BITS, Message, analyse, worst_bits

_NS_PER_S = 1_000_000_000
_NONE = Fraction(0)
MANAGER_FRAMES = 2  # LEASE and ALIVE, in each heartbeat period


@dataclass(frozen=True, slots=True)
class Response:
    """The longest time from when a datum is due at its source until its last bit is sent on a bus."""

    hop: Hop
    response_ns: int | None  # rounded up; None: unbounded
    deadline_ns: int  # rounded down
    meets_deadline: bool


@dataclass(frozen=True, slots=True)
class Late:
    """A hop whose datum can miss its deadline, and all hops (this one included) on which its response time depends.

    As long as all of these hops are published, the datum can be late, whatever else is published.
    response_ns: the longest response time, rounded up; None: it has no bound.
    """

    hop: Hop
    response_ns: int | None
    deadline_ns: int
    causes: frozenset[Hop]


class ResponseTimes:
    """Response times of any set of hops of one spec."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        self.identifiers = identifiers(spec)
        self.management = {bus.name: _management(spec, bus) for bus in spec.buses.values()}
        self.blocking_bits = {bus.name: blocking_bits(bus) for bus in spec.buses.values()}
        self._foreign = {
            bus.name: [(one, _foreign_message(bus, one)) for one in bus.foreign] for bus in spec.buses.values()
        }
        self._punctual: dict[Hop, Message] = {}  # messages without jitter, computed so far

    def responses(self, published: Iterable[Hop]) -> list[Response]:
        """Compute the response time of every hop on a wired bus.

        The result is in the order of buses in the spec, and on each bus in order of priority.
        """
        by_bus = self._by_bus(published)
        delays = self._delays_ns(by_bus)
        return [
            self._response(hop, delays[_key(hop)])
            for bus, hops_there in by_bus.items()
            if self.spec.buses[bus].kind == "wired"
            for hop in hops_there
        ]

    def late(self, published: Iterable[Hop]) -> list[Late]:
        """Find every hop that can miss its deadline, with the hops that make it late, in the order of `responses`."""
        published = tuple(published)
        missed = [response for response in self.responses(published) if not response.meets_deadline]
        by_bus = self._by_bus(published)
        return [Late(r.hop, r.response_ns, r.deadline_ns, self._causes(r.hop, by_bus)) for r in missed]

    def _by_bus(self, published: Iterable[Hop]) -> dict[str, list[Hop]]:
        by_bus: dict[str, list[Hop]] = {bus: [] for bus in self.spec.buses}
        for hop in published:
            by_bus[hop.bus].append(hop)
        for hops_there in by_bus.values():
            hops_there.sort(key=lambda hop: self.identifiers[hop.producer, hop.variable])
        return by_bus

    def _delays_ns(self, by_bus: Mapping[str, list[Hop]]) -> dict[tuple[str, str, str], Fraction | None]:
        """Compute the exact delay of each hop in ns, by (module, variable, bus).

        The delay counts from when the datum is due at its source until its last bit is sent on the bus of the
        hop; a wireless bus adds nothing to it. None: the delay is unbounded.

        by_bus: the hops on each bus, in order of priority.
        """
        delays: dict[tuple[str, str, str], Fraction | None] = {}
        analysed: dict[str, list[Fraction | None]] = {}  # bus -> the jitters from which its delays were computed
        while True:
            changed = False
            for bus, hops_there in by_bus.items():
                jitters = [
                    _NONE if hop.after is None else delays.get((hop.producer, hop.variable, hop.after), _NONE)
                    for hop in hops_there
                ]
                if analysed.get(bus) == jitters:
                    continue
                analysed[bus], changed = jitters, True
                wired = self.spec.buses[bus].kind == "wired"
                found = self._cross(self.spec.buses[bus], hops_there, jitters) if wired else jitters
                delays.update(zip(map(_key, hops_there), found, strict=True))
            if not changed:
                return delays

    def _cross(self, bus: Bus, hops_there: list[Hop], jitters: list[Fraction | None]) -> list[Fraction | None]:
        """Compute the delay in ns with which each datum leaves a wired bus; None: the delay is unbounded.

        If the delay of one datum is unbounded, so are the delays of all data with a lower priority.

        hops_there: the hops on the bus, in order of priority; `jitters` and the result have the same order.
        jitters: the delay in ns with which each datum comes to the bus; None: the delay is unbounded.
        """
        bounded = jitters.index(None) if None in jitters else len(jitters)
        queued, places, left = list(self.management[bus.name]), [], self._foreign[bus.name]
        for hop, jitter in zip(hops_there[:bounded], jitters[:bounded], strict=True):
            identifier = self.identifiers[hop.producer, hop.variable]
            if left:
                queued += [message for foreign, message in left if foreign.outranks(identifier)]
                left = [one for one in left if not one[0].outranks(identifier)]
            places.append(len(queued))
            queued.append(self.message(hop, jitter or _NONE))
        responses = analyse(queued, blocking_bits=self.blocking_bits[bus.name])
        bits = [responses[place].bits for place in places]
        delays = [None if one is None else one * _NS_PER_S / bus.bitrate for one in bits]
        return delays + [None] * (len(jitters) - bounded)

    def always_above(self, hop: Hop) -> list[Message]:
        """Return the messages that are more urgent than a hop whatever the plan: management, and foreign frames."""
        identifier = self.identifiers[hop.producer, hop.variable]
        foreign = [message for one, message in self._foreign[hop.bus] if one.outranks(identifier)]
        return [*self.management[hop.bus], *foreign]

    def bits_per_ns(self, bus: str) -> Fraction:
        """Number of bit times of a bus in one nanosecond."""
        return Fraction(self.spec.buses[bus].bitrate, _NS_PER_S)

    def message(self, hop: Hop, jitter_ns: Fraction = _NONE) -> Message:
        """Return the message that stands for a hop in the analysis of its bus, with all times in bit times."""
        bits_per_ns = self.bits_per_ns(hop.bus)
        punctual = self._punctual.get(hop)
        if punctual is None:
            punctual = self._punctual[hop] = Message(
                name=f"{hop.variable} from {hop.producer}",
                bits=frame_bits(self.spec, hop.variable),
                period=_period_ns(self.spec, hop) * bits_per_ns,
                jitter=0,
                deadline=_deadline_ns(self.spec, hop) * bits_per_ns,
            )
        return punctual._replace(jitter=jitter_ns * bits_per_ns) if jitter_ns else punctual

    def _response(self, hop: Hop, delay_ns: Fraction | None) -> Response:
        deadline_ns = _deadline_ns(self.spec, hop)
        return Response(
            hop=hop,
            response_ns=None if delay_ns is None else ceil(delay_ns),
            deadline_ns=int(deadline_ns),
            meets_deadline=delay_ns is not None and delay_ns <= deadline_ns,
        )

    def _causes(self, hop: Hop, by_bus: Mapping[str, list[Hop]]) -> frozenset[Hop]:
        found: set[Hop] = set()
        frontier = [hop]
        while frontier:
            one = frontier.pop()
            if one not in found:
                found.add(one)
                frontier.extend(self._delaying(one, by_bus))
        return frozenset(found)

    def _delaying(self, hop: Hop, by_bus: Mapping[str, list[Hop]]) -> Iterator[Hop]:
        """Yield the hops that delay `hop` directly.

        On a wired bus, these are the more urgent hops on the bus of `hop`. On any bus, it is also the hop by which
        the data of the same source come to this bus, if there is one.
        """
        if self.spec.buses[hop.bus].kind == "wired":
            there = by_bus[hop.bus]
            yield from there[: there.index(hop)]
        if hop.after is not None:
            yield from (one for one in by_bus[hop.after] if _key(one)[:2] == _key(hop)[:2])


def _key(hop: Hop) -> tuple[str, str, str]:
    return hop.producer, hop.variable, hop.bus


def _management(spec: Spec, bus: Bus) -> list[Message]:
    """Return the state of each PE and the frames of the manager, which are more urgent than all data of a bus."""
    period = Fraction(bus.heartbeat_ns * bus.bitrate, _NS_PER_S)
    senders = sum(bus.name in pe.buses for pe in spec.pes.values()) + MANAGER_FRAMES
    return [Message("management", WORST_BLOCKING_BITS, period, 0, period)] * senders


def blocking_bits(bus: Bus) -> int:
    """Return the length in bits of the longest frame of lower priority that may have just started on a bus."""
    extended = any(one.extended for one in bus.foreign)
    return worst_bits(MAX_DATA_BYTES, extended=True) if extended else WORST_BLOCKING_BITS


def _foreign_message(bus: Bus, foreign: Foreign) -> Message:
    period = Fraction(foreign.period_ns * bus.bitrate, _NS_PER_S)
    return Message("foreign", foreign.bits, period, 0, period)


def _period_ns(spec: Spec, hop: Hop) -> Fraction:
    return Fraction(1000 * _NS_PER_S, spec.modules[hop.producer].modes[hop.mode].rate_mhz)


def _deadline_ns(spec: Spec, hop: Hop) -> Fraction:
    """Deadline of a datum in ns from when it is due: its period, unless the spec gives another."""
    given = spec.variables[hop.variable].deadline_ns
    return _period_ns(spec, hop) if given is None else Fraction(given)
