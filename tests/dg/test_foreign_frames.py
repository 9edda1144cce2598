"""Foreign frames in the response times of data, against a bus that is simulated bit by bit of time (semantics rule 9).

The simulation knows no analysis: it decides each arbitration by the bits of the identifiers, as the wire does. For each
datum it forces the worst case: a frame of lower priority has just started when everything else is released at once.
"""

import random
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import NamedTuple

import pytest

from heronry_dg.findings import SpecError
from heronry_dg.loader import loads
from heronry_dg.model import Bus, Foreign, Spec
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Situation, foreign_bits_per_s, survivors
from heronry_dg.traffic import Hop

SETS = 100
BITRATE = 250_000  # 4 us a bit: periods of whole milliseconds are whole bit times


class Stream(NamedTuple):
    """A periodic frame: its bits in arbitration, its length and its period in bit times."""

    arbitration: str
    bits: int
    period: int


def on_the_wire(identifier: int, *, extended: bool) -> str:
    """The bits of an identifier in arbitration, with those that tell the formats apart; 0 wins."""
    if not extended:
        return f"{identifier:011b}" + "00"  # RTR and IDE are dominant
    whole = f"{identifier:029b}"
    return f"{whole[:11]}11{whole[11:]}0"  # SRR and IDE are recessive


def aircraft(rng: random.Random) -> Spec:
    """Draw a producer of some variables with standard or allocated identifiers, and foreign frames on its bus."""
    count = rng.randint(2, 6)
    standard = rng.sample(range(300, 1000), count)
    lines = [
        "dg: 1",
        f"buses: {{can0: {{bitrate: {BITRATE}, heartbeat_ms: 20}}}}",
        "pes:",
        "  nose: {node_id: 92, buses: [can0], cpu: 1, ram: 8KiB, flash: 8KiB}",
        "  tail: {node_id: 93, buses: [can0], cpu: 1, ram: 8KiB, flash: 8KiB}",
        "variables:",
        *(
            f"  v{i}: {{type: {rng.choice(('FLOAT', 'UCHAR', 'SHORT'))}"
            + (f", identifier: {standard[i]}}}" if rng.random() < 0.6 else "}")
            for i in range(count)
        ),
        "modules:",
        *(
            f"  m{i}: {{gives: {{v{i}: 1}}, cpu: 0.01, ram: 100, rate_hz: {rng.choice((20, 25, 40, 50, 100))}}}"
            for i in range(count)
        ),
        f"  reader: {{needs: {{and: [{', '.join(f'v{i}' for i in range(count))}]}}, cpu: 0.1, ram: 100, rate_hz: 10}}",
        "functions: {reading: {output: reader}}",
    ]
    spec = loads("\n".join(lines), "drawn.dg.yaml")
    foreign = tuple(drawn_foreign(rng) for _ in range(rng.randint(1, 4)))
    return replace(spec, buses={"can0": replace(spec.buses["can0"], foreign=foreign)})


def drawn_foreign(rng: random.Random) -> Foreign:
    extended = rng.random() < 0.6
    first = rng.randrange(100, 1900) << (18 if extended else 0)
    return Foreign(first, None, extended, rng.randint(0, 8), rng.choice((4, 5, 10, 20, 50)) * 1_000_000)


def streams(spec: Spec, bus: Bus) -> Iterator[Stream]:
    """The frames that are no data: management, which goes first, and foreign frames."""
    per_ms = BITRATE // 1000
    for _ in range(2 + len(spec.pes)):
        yield Stream("", 55 + 10 * 8, bus.heartbeat_ns // 10**6 * per_ms)
    for one in bus.foreign:
        bits = (80 if one.extended else 55) + 10 * one.data_bytes
        yield Stream(on_the_wire(one.first, extended=one.extended), bits, one.period_ns // 10**6 * per_ms)


def worst_seen(watched: Stream, others: list[Stream], blocking: int) -> int:
    """Simulate a bus until it is idle; the longest time in bits from the release of the watched frame to its end."""
    every = [watched, *(one for one in others if one.arbitration <= watched.arbitration)]
    released = [0] * len(every)  # instances sent so far
    now, worst = blocking, 0
    while True:
        waiting = [number for number, one in enumerate(every) if released[number] * one.period <= now]
        if not waiting:
            return worst
        number = min(waiting, key=lambda n: (every[n].arbitration, n == 0))
        one = every[number]
        now += one.bits
        if number == 0:
            worst = max(worst, now - released[0] * one.period)
        released[number] += 1


def test_the_analysis_is_never_below_a_simulated_bus_and_mostly_equal() -> None:
    """Compare 100 drawn sets of messages; a set is equal if all its response times are."""
    equal = compared = above_data = 0
    seed = 0
    while compared < SETS:
        seed += 1
        spec = aircraft(random.Random(seed))
        bus = spec.buses["can0"]
        if foreign_bits_per_s(bus) > BITRATE // 2:
            continue
        compared += 1
        times = ResponseTimes(spec)
        hops = [Hop(f"m{i}", f"v{i}", "only", "can0") for i in range(len(spec.variables))]
        others = list(streams(spec, bus))
        data = {hop: datum(spec, times, hop) for hop in hops}
        blocking = 160 if any(one.extended for one in bus.foreign) else 135
        exact = True
        for response in times.responses(hops):
            rivals = [*others, *(one for hop, one in data.items() if hop != response.hop)]
            seen = Fraction(worst_seen(data[response.hop], rivals, blocking) * 10**9, BITRATE)
            assert response.response_ns is not None
            assert seen <= response.response_ns, seed
            exact &= seen == response.response_ns
            above_data += any(one.arbitration and one.arbitration < data[response.hop].arbitration for one in others)
        equal += exact
    assert equal >= SETS // 2
    assert above_data >= SETS


def datum(spec: Spec, times: ResponseTimes, hop: Hop) -> Stream:
    mode = spec.modules[hop.producer].modes["only"]
    payload = {"FLOAT": 4, "SHORT": 2, "UCHAR": 1}[spec.variables[hop.variable].type]
    identifier = times.identifiers[hop.producer, hop.variable]
    period = BITRATE * 1000 // mode.rate_mhz
    return Stream(on_the_wire(identifier, extended=False), 55 + 10 * (4 + payload), period)


def test_what_outranks_what() -> None:
    assert Foreign(None, (0x100 << 18, 0x1FF << 18), True, 8, 1).outranks(0x101)
    assert not Foreign(0x101 << 18, None, True, 8, 1).outranks(0x101)  # the 11-bit frame wins
    assert Foreign(0x101, None, False, 8, 1).outranks(0x101)
    assert not Foreign(0x102, None, False, 8, 1).outranks(0x101)


def test_foreign_frames_leave_less_room_to_data_and_never_less_than_none() -> None:
    spec = aircraft(random.Random(1))
    bus = replace(spec.buses["can0"], foreign=(Foreign(0, None, True, 8, 1_000_000),))  # 160 000 bit/s

    def room(one: Bus) -> int:
        return survivors(replace(spec, buses={"can0": one}), Situation()).bus_mbit_per_s["can0"]

    assert room(replace(bus, foreign=())) == 175_000_000
    assert room(bus) == 15_000_000
    assert room(replace(bus, foreign=bus.foreign * 2)) == 0


ONE_BUS = """
dg: 1
buses: {can0: {bitrate: 1000000, foreign: [FOREIGN]}}
pes: {nav: {node_id: 92, buses: [can0], cpu: 1, ram: 8KiB, flash: 8KiB}}
variables: {speed: {type: FLOAT, identifier: 315}}
modules: {reader: {cpu: 0.1, ram: 100, rate_hz: 10}}
functions: {reading: {output: reader}}
"""


def test_the_key_gives_identifiers_bytes_and_periods() -> None:
    entries = "{identifier: 1793, bytes: 0, period_ms: 0.5}, {range: [5, 6], extended: true, bytes: 8, period_ms: 10}"
    bus = loads(ONE_BUS.replace("FOREIGN", entries), "one.dg.yaml").buses["can0"]
    assert bus.foreign == (
        Foreign(1793, None, extended=False, data_bytes=0, period_ns=500_000),
        Foreign(None, (5, 6), extended=True, data_bytes=8, period_ns=10_000_000),
    )
    assert [(one.first, one.last, one.bits) for one in bus.foreign] == [(1793, 1793, 55), (5, 6, 160)]


@pytest.mark.parametrize(
    ("entry", "code", "sentence"),
    [
        ("{identifier: 2048, bytes: 8, period_ms: 1}", "DG106", "identifier 2048 has more than 11 bits"),
        ("{range: [5, 2048], bytes: 8, period_ms: 1}", "DG106", "identifier 2048 has more than 11 bits"),
        ("{identifier: 536870912, extended: true, bytes: 8, period_ms: 1}", "DG106", "at most 536870911"),
        ("{range: [0, 536870912], extended: true, bytes: 8, period_ms: 1}", "DG106", "more than 29 bits"),
        ("{identifier: 5, bytes: 9, period_ms: 1}", "DG106", "at most 8"),
        ("{identifier: 5, bytes: 8, period_ms: 0}", "DG106", "period_ms"),
        ("{identifier: 5, range: [5, 6], bytes: 8, period_ms: 1}", "DG123", "'identifier' or 'range'"),
        ("{range: [6, 5], bytes: 8, period_ms: 1}", "DG124", "6 is more than 5"),
        ("{range: [5], bytes: 8, period_ms: 1}", "DG104", "two whole numbers"),
        ("{identifier: 5, bytes: 8}", "DG103", "period_ms"),
    ],
)
def test_nonsense_is_one_finding(entry: str, code: str, sentence: str) -> None:
    with pytest.raises(SpecError) as refused:
        loads(ONE_BUS.replace("FOREIGN", entry), "one.dg.yaml")
    (finding,) = refused.value.findings
    assert finding.code == code
    assert sentence in f"{finding.sentence} {finding.hint}"
