"""Every regular message on a bus, with its identifier and its worst-case response time.

The regular messages of a bus are, in the order of their priority:

    management   LEASE and ALIVE of a manager, the state of each PE on the bus, or beyond a gateway that forwards it,
                 and the reports of gateways on their radios
    data         everything that modules publish on the bus
    foreign      what other equipment sends, as the spec declares it; its place is that of its identifier
    heartbeat    the CANopen heartbeats, once a second
    echo         the echoes of the outputs that run, as often as the tables of the PEs say (`echo_rates`)
    checkpoint   the states of modules, each as one message of all frames of a round; its response time is that of the
                 last frame, which holds for every configuration (`checkpoints`)

A foreign frame with a range of identifiers stands at the first of them, and has the response time of the last.

Response times of data are those of semantics rule 9 (`response_times`). This rule does not count heartbeats one by one:
one 8-byte frame that has just started stands for all frames with a lower priority than data.

A response time counts from the moment at which a message is due at its source. So the response time of a datum on its
second bus includes the response time on its first bus.

Messages that are not regular are not listed: PREPARE, SLICE, ACTIVATE, PING, EMCY, CONTROL and SDO use the bandwidth of
the reserve that the regular ones leave.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil

from heronry_dg.checkpoints import carried, late_ns, period_ns
from heronry_dg.configuration import Configuration
from heronry_dg.echo_rates import EchoRates, outputs_of
from heronry_dg.model import Bus, Spec
from heronry_dg.response_times import Response, ResponseTimes, blocking_bits
from heronry_dg.situation import Situation, Survivors, survivors
from heronry_dg.traffic import Hop, bus_loads_mbit_per_s, frame_bits, hops
from heronry_dg.uplinks import radios
from heronry_wire.canaerospace import HEADER_BYTES, DataType
from heronry_wire.checkpoint_frames import frame_count
from heronry_wire.frame import MAX_DATA_BYTES
from heronry_wire.identifiers import (
    FIRST_MANAGER,
    Command,
    actuator_echo_id,
    checkpoint_id,
    heartbeat_id,
    management_id,
    state_id,
)
from heronry_wire.protocol_times import CANOPEN_HEARTBEAT_NS
from heronry_wire.timing import WORST_BLOCKING_BITS, Message, analyse, worst_bits

_NS_PER_S = 1_000_000_000
_LOWER_BITS = 18  # of a 29-bit identifier
_NOT_OF_THE_RESERVE = frozenset(("data", "foreign", "checkpoint"))  # kinds


@dataclass(frozen=True, slots=True)
class ScheduledMessage:
    """One message on one bus; times are in nanoseconds, and worst cases are rounded up."""

    identifier: int  # the first of a range
    kind: str  # management | data | foreign | heartbeat | echo | checkpoint
    name: str  # name of the variable, or of the management frame
    producer: str | None  # the module that gives the variable, or whose output is echoed, or whose state it is
    node: str  # the PE that sends it at its source, or "manager"
    data_bytes: int
    bits: int  # of its longest frame; of a checkpoint: of all frames of a round
    period_ns: int
    response_ns: int | None  # None: unbounded, or the bus is not analysed
    deadline_ns: int
    last: int | None = None  # the last identifier of a range
    extended: bool = False  # whether the identifier has 29 bits

    @property
    def slack_ns(self) -> int | None:
        """Deadline minus response time in ns.

        Negative where the deadline can be missed, None where `response_ns` is None.
        """
        return None if self.response_ns is None else self.deadline_ns - self.response_ns

    @property
    def identifier_text(self) -> str:
        """The identifier, or the range; an `x` marks 29 bits."""
        span = str(self.identifier) if self.last in (None, self.identifier) else f"{self.identifier}-{self.last}"
        return f"{span}x" if self.extended else span


@dataclass(frozen=True, slots=True)
class BusSchedule:
    """The messages on one bus, and the shares of the bit rate that data and management take."""

    bus: Bus
    is_up: bool
    messages: tuple[ScheduledMessage, ...]  # most urgent first
    data: Fraction
    data_limit: Fraction  # max_load - reserve, reduced where the bus is limited
    management: Fraction  # all regular messages of the system that are neither data nor checkpoints
    foreign: Fraction  # what other equipment sends
    blocking_ns: int  # longest frame that may have started just before a message is due
    checkpoints: Fraction = Fraction(0)  # they share the limit of data

    def share(self, message: ScheduledMessage) -> Fraction:
        """Return the share of this bus's bit rate that a message takes at most."""
        return Fraction(message.bits * _NS_PER_S, message.period_ns * self.bus.bitrate)

    @property
    def management_fits(self) -> bool:
        """Tell whether the regular management frames fit into the reserve and, with all others, into `max_load`."""
        return self.management <= self.bus.reserve and self.together <= self.bus.max_load

    @property
    def together(self) -> Fraction:
        """The share that all regular messages take."""
        return self.data + self.checkpoints + self.management + self.foreign

    @property
    def data_fit(self) -> bool:
        """Tell whether data and checkpoints fit into what the bus has for them."""
        return self.data + self.checkpoints <= self.data_limit

    @property
    def reserve_left_frames_per_s(self) -> int:
        """Number of 8-byte frames per second that still fit into the bus's reserve for management; 0 if none fits."""
        left = (self.bus.reserve - self.management) * self.bus.bitrate / WORST_BLOCKING_BITS
        return max(0, int(left))


def bus_schedules(
    spec: Spec, now: Situation, configuration: Configuration, *, every_echo: bool = False
) -> list[BusSchedule]:
    """Compute the schedule of every bus of the spec under a configuration, whose names must exist in the spec.

    every_echo: whether every command of an output is echoed, as simulated plants ask for it.

    Raises WireError where the spec has more sources than identifiers.
    """
    left = survivors(spec, now)
    published = hops(left, configuration)
    loads = bus_loads_mbit_per_s(spec, published)
    times, rates = ResponseTimes(spec), EchoRates(spec)
    responses = {(r.hop.producer, r.hop.variable, r.hop.bus): r for r in times.responses(published)}
    reports = list(_reports(spec))
    schedules = []
    for bus in spec.buses.values():
        there = sorted(
            (hop for hop in published if hop.bus == bus.name),
            key=lambda hop: times.identifiers[hop.producer, hop.variable],
        )
        data = [_datum(spec, configuration, hop, times, responses) for hop in there]
        jitters = [_arrives(hop, responses) for hop in there]
        echoes = _echoes(spec, bus, configuration, rates, every_echo=every_echo)
        below = [*_heartbeats(spec, bus, rates), *sorted(echoes, key=lambda echo: echo.identifier)]
        above = [*_above(spec, bus, rates), *(report for way, report in reports if bus.name in way)]
        states = _checkpoints(spec, left, configuration, bus.name)
        messages = _messages(bus, [*above, *_foreign(bus), *below, *states], data, jitters)
        room = left.bus_mbit_per_s.get(bus.name)
        schedules.append(
            BusSchedule(
                bus=bus,
                is_up=room is not None,
                messages=messages,
                data=Fraction(loads[bus.name], 1000 * bus.bitrate),
                data_limit=Fraction(room or 0, 1000 * bus.bitrate),
                management=_load(bus, (message for message in messages if message.kind not in _NOT_OF_THE_RESERVE)),
                foreign=_load(bus, (message for message in messages if message.kind == "foreign")),
                checkpoints=_load(bus, (message for message in messages if message.kind == "checkpoint")),
                blocking_ns=ceil(Fraction(blocking_bits(bus) * _NS_PER_S, bus.bitrate)),
            )
        )
    return schedules


_Responses = Mapping[tuple[str, str, str], Response]


def _datum(
    spec: Spec, configuration: Configuration, hop: Hop, times: ResponseTimes, responses: _Responses
) -> ScheduledMessage:
    variable, mode = spec.variables[hop.variable], spec.modules[hop.producer].modes[hop.mode]
    period_ns = 1000 * _NS_PER_S // mode.rate_mhz
    response = responses.get((hop.producer, hop.variable, hop.bus))
    return ScheduledMessage(
        identifier=times.identifiers[hop.producer, hop.variable],
        kind="data",
        name=hop.variable,
        producer=hop.producer,
        node=configuration.modules[hop.producer].pe,
        data_bytes=HEADER_BYTES + DataType[variable.type].payload_bytes,
        bits=frame_bits(spec, hop.variable),
        period_ns=period_ns,
        response_ns=response.response_ns if response else None,
        deadline_ns=period_ns if variable.deadline_ns is None else variable.deadline_ns,
    )


def _arrives(hop: Hop, responses: _Responses) -> int | None:
    """Return how late (ns) data may come to the bus of `hop`; None: no bound."""
    before = responses.get((hop.producer, hop.variable, hop.after)) if hop.after is not None else None
    # nothing is before, or a radio, which is not analysed
    return 0 if before is None else before.response_ns


def _messages(
    bus: Bus, others: list[ScheduledMessage], data: list[ScheduledMessage], jitters: list[int | None]
) -> tuple[ScheduledMessage, ...]:
    """Return all regular messages of a bus by priority: `data` unchanged, `others` with their response times.

    Response times are computed on a wired bus only.

    jitters: jitter of each message of `data` in ns; None: the jitter of this message has no bound. If one has no
        bound, `others` with a lower priority than that message get no response time.
    """
    given = [*((one, 0) for one in others), *zip(data, jitters, strict=True)]
    given.sort(key=lambda one: _priority(one[0]))
    messages = [one for one, _ in given]
    if bus.kind != "wired":
        return tuple(messages)
    sure = next((number for number, (_, jitter) in enumerate(given) if jitter is None), len(given))
    bounded = [(one, jitter or 0) for one, jitter in given[:sure]]
    times = _times(bus, [one for one, _ in bounded], [jitter for _, jitter in bounded])
    for number, one in enumerate(messages[:sure]):
        if one.last not in (None, one.identifier):
            messages[number] = replace(one, response_ns=_time_of_the_last(bus, given, one))
        elif one.kind not in ("data", "checkpoint"):
            messages[number] = replace(one, response_ns=times[number])
    return tuple(messages)


def _time_of_the_last(
    bus: Bus, given: list[tuple[ScheduledMessage, int | None]], ranged: ScheduledMessage
) -> int | None:
    """Return the response time in ns of a message with a range of identifiers, for the last of them; None: no bound."""
    lowest = _priority(replace(ranged, identifier=ranged.last or 0))
    above = [(one, jitter) for one, jitter in given if one is not ranged and _priority(one) <= lowest]
    if any(jitter is None for _, jitter in above):
        return None
    return _times(bus, [*(one for one, _ in above), ranged], [*(jitter or 0 for _, jitter in above), 0])[-1]


def _priority(message: ScheduledMessage) -> tuple[int, bool, int]:
    """Return what arbitration compares: the upper 11 bits, whether more bits follow, and all of them; less wins."""
    upper = message.identifier >> _LOWER_BITS if message.extended else message.identifier
    return upper, message.extended, message.identifier


def _foreign(bus: Bus) -> Iterator[ScheduledMessage]:
    for one in bus.foreign:
        yield ScheduledMessage(
            identifier=one.first,
            kind="foreign",
            name="foreign",
            producer=None,
            node="other equipment",
            data_bytes=one.data_bytes,
            bits=one.bits,
            period_ns=one.period_ns,
            response_ns=None,
            deadline_ns=one.period_ns,
            last=None if one.span is None else one.last,
            extended=one.extended,
        )


def _reports(spec: Spec) -> Iterator[tuple[tuple[str, ...], ScheduledMessage]]:
    """Yield the report on each radio, once in each of its heartbeat periods, and before it the buses that carry it."""
    for radio in radios(spec).values():
        period_ns = spec.buses[radio.bus].heartbeat_ns
        name = f"link of {radio.bus}"
        yield radio.report_way, _management("management", radio.link_id, name, radio.gateway, period_ns)


def _above(spec: Spec, bus: Bus, rates: EchoRates) -> list[ScheduledMessage]:
    """Return the management messages of a bus that precede data: LEASE, ALIVE, and the states that it carries."""
    lease, alive = (management_id(FIRST_MANAGER, command) for command in (Command.LEASE, Command.ALIVE))
    period_ns = bus.heartbeat_ns
    return [
        _management("management", lease, "LEASE", "manager", period_ns),
        _management("management", alive, "ALIVE", "manager", period_ns),
        *(
            _management("management", state_id(node), "state", name, _state_period_ns(spec, bus, name, rates))
            for node, name in _nodes(spec, bus, rates)
        ),
    ]


def _nodes(spec: Spec, bus: Bus, rates: EchoRates) -> list[tuple[int, str]]:
    """Return node-ID and name of each PE on a bus, and of each PE beyond whose frames gateways forward to it."""
    return sorted((pe.node_id, pe.name) for pe in spec.pes.values() if rates.carries(bus.name, pe.name))


def _state_period_ns(spec: Spec, bus: Bus, pe: str, rates: EchoRates) -> int:
    """Return the period of the states of a PE on a bus: that of the bus, or of the PE's own bus if it is beyond."""
    own = bus.name in spec.pes[pe].buses
    return bus.heartbeat_ns if own else spec.buses[rates.way(pe)[0]].heartbeat_ns


def _heartbeats(spec: Spec, bus: Bus, rates: EchoRates) -> list[ScheduledMessage]:
    nodes = _nodes(spec, bus, rates)
    if bus.name == spec.manager.bus:
        nodes.append((FIRST_MANAGER, "manager"))
    return [
        _management("heartbeat", heartbeat_id(node), "CANopen heartbeat", name, CANOPEN_HEARTBEAT_NS, data_bytes=1)
        for node, name in nodes
    ]


def _echoes(
    spec: Spec, bus: Bus, configuration: Configuration, rates: EchoRates, *, every_echo: bool
) -> Iterator[ScheduledMessage]:
    """Yield the echoes that a bus carries: those of the running outputs whose way to the manager leads over it."""
    outputs = outputs_of(spec)
    for name, running in configuration.modules.items():
        if name in outputs and bus.name in rates.way(running.pe):
            period_ns = 1000 * _NS_PER_S // configuration.mode(spec, name).rate_mhz
            if not every_echo:
                period_ns = max(period_ns, _NS_PER_S // rates.of(running.pe))
            identifier = actuator_echo_id(spec.pes[running.pe].node_id)
            yield replace(_management("echo", identifier, "echo", running.pe, period_ns), producer=name)


def _checkpoints(spec: Spec, left: Survivors, configuration: Configuration, bus: str) -> Iterator[ScheduledMessage]:
    """Yield the checkpoints that a bus carries, in the order of their identifiers."""
    there = [one for one in carried(left, configuration) if one.bus == bus]
    for one in sorted(there, key=lambda one: spec.pes[one.pe].node_id):
        checkpoint = spec.modules[one.module].checkpoint
        assert checkpoint is not None
        on_it = (pe.name for pe in spec.pes.values() if bus in pe.buses)
        routes = (left.route(one.pe, pe) or () for pe in on_it)
        way = max((route for route in routes if bus in route), key=len, default=(bus,))
        yield ScheduledMessage(
            identifier=checkpoint_id(spec.pes[one.pe].node_id),
            kind="checkpoint",
            name="checkpoint",
            producer=one.module,
            node=one.pe,
            data_bytes=MAX_DATA_BYTES,
            bits=frame_count(checkpoint.data_bytes) * WORST_BLOCKING_BITS,
            period_ns=period_ns(checkpoint),
            response_ns=late_ns(spec, checkpoint, way[: way.index(bus) + 1]),
            deadline_ns=checkpoint.max_age_ns,
        )


def _management(
    kind: str, identifier: int, name: str, node: str, period_ns: int, *, data_bytes: int = MAX_DATA_BYTES
) -> ScheduledMessage:
    return ScheduledMessage(
        identifier, kind, name, None, node, data_bytes, worst_bits(data_bytes), period_ns, None, period_ns
    )


def _times(bus: Bus, messages: list[ScheduledMessage], jitters_ns: list[int]) -> list[int | None]:
    """Return the response time of each message in ns, rounded up; None where it is unbounded."""
    bits_per_ns = Fraction(bus.bitrate, _NS_PER_S)
    analysed = [
        Message(m.name, m.bits, m.period_ns * bits_per_ns, jitter * bits_per_ns, m.deadline_ns * bits_per_ns)
        for m, jitter in zip(messages, jitters_ns, strict=True)
    ]
    found = analyse(analysed, blocking_bits=blocking_bits(bus))
    return [None if r.bits is None else ceil(r.bits / bits_per_ns) for r in found]


def _load(bus: Bus, messages: Iterable[ScheduledMessage]) -> Fraction:
    return sum((Fraction(m.bits * _NS_PER_S, m.period_ns * bus.bitrate) for m in messages), Fraction(0))
