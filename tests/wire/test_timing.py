"""Frame lengths against published ones and a bit-by-bit coder; response times against the formulas and a bus."""

from fractions import Fraction
from math import ceil

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from heronry_wire.frame import Frame, WireError, parse_frame
from heronry_wire.timing import WORST_BLOCKING_BITS, Errors, Message, Response, analyse, exact_bits, worst_bits
from thoroughness import part_of

# -- lengths --------------------------------------------------------------------------------------------------


def coded_bits(frame: Frame) -> tuple[int, int, int]:
    """Code a frame bit by bit as ISO 11898-1 describes it; give length, stuff bits and CRC."""
    size = f"{len(frame.data):04b}"
    if frame.extended:
        base, extension = f"{frame.can_id >> 18:011b}", f"{frame.can_id & 0x3FFFF:018b}"
        bits = f"0{base}11{extension}{frame.remote:d}00{size}"
    else:
        bits = f"0{frame.can_id:011b}{frame.remote:d}00{size}"
    bits += "".join(f"{byte:08b}" for byte in frame.data)
    crc = 0
    for bit in bits:
        feedback = (crc >> 14) ^ int(bit)
        crc = (crc << 1) & 0x7FFF ^ (0x4599 if feedback else 0)
    stuffed, run, last = 0, 0, ""
    for bit in bits + f"{crc:015b}":
        run, last = (run + 1, bit) if bit == last else (1, bit)
        if run == 5:
            stuffed, run, last = stuffed + 1, 1, "0" if bit == "1" else "1"
    return len(bits) + 15 + stuffed + 13, stuffed, crc


# Measured with can-utils (canframelen.c, CFL_EXACT): frame, bits, stuff bits, CRC.
PUBLISHED = [
    ("000#", 53, 6, 0x0000),
    ("7FF#", 50, 3, 0x272F),
    ("000#0000000000000000", 127, 16, 0x145B),
    ("7FF#FFFFFFFFFFFFFFFF", 126, 15, 0x4C89),
    ("555#5555555555555555", 112, 1, 0x1B04),
    ("078#3C3C3C3C3C3C3C3C", 131, 20, 0x1921),
    ("12C#01000000", 86, 7, 0x7E84),
    ("130#01020000BFC00000", 123, 12, 0x2AC9),
    ("137#0102000040490FDB", 120, 9, 0x3206),
    ("208#010C0000400005DC", 121, 10, 0x3BB0),
    ("080#2A000000", 86, 7, 0x3B3C),
    ("081#2A10000001020000", 122, 11, 0x4A21),
    ("080#2A150202DEADBEEF", 118, 7, 0x1320),
    ("005#0101000001020304", 123, 12, 0x7818),
    ("705#05", 59, 4, 0x68BF),
    ("605#4017100000000000", 124, 13, 0x3DF9),
    ("00000000#0000000000000000", 150, 19, 0x3DAF),
    ("00010130#010200003F800000", 146, 15, 0x722B),
    ("1FFFFFFF#FFFFFFFFFFFFFFFF", 149, 18, 0x1B69),
]


@pytest.mark.parametrize(("text", "bits", "stuffed", "crc"), PUBLISHED, ids=[row[0] for row in PUBLISHED])
def test_the_lengths_that_can_utils_gives(text: str, bits: int, stuffed: int, crc: int) -> None:
    frame = parse_frame(text)
    assert isinstance(frame, Frame)
    assert coded_bits(frame) == (bits, stuffed, crc)
    assert exact_bits(frame) == bits


payloads = st.one_of(st.binary(max_size=8), st.lists(st.sampled_from([0, 0xFF, 0x0F, 0xF0]), max_size=8).map(bytes))
standard_ids, extended_ids = st.integers(0, 0x7FF), st.integers(0, 0x1FFF_FFFF)
no, yes = st.just(value=False), st.just(value=True)
frames = st.one_of(
    st.builds(Frame, standard_ids, payloads, no, no, no),
    st.builds(Frame, extended_ids, payloads, yes, no, no),
    st.builds(Frame, standard_ids, st.just(b""), no, yes, no),
    st.builds(Frame, extended_ids, st.just(b""), yes, yes, no),
)


@settings(max_examples=part_of(500))
@given(frames)
def test_the_byte_tables_agree_with_the_bit_by_bit_coder(frame: Frame) -> None:
    bits = exact_bits(frame)
    assert bits == coded_bits(frame)[0]
    assert bits <= worst_bits(len(frame.data), extended=frame.extended)


def test_every_empty_standard_frame() -> None:
    for can_id in range(2048):
        frame = Frame(can_id, b"")
        assert exact_bits(frame) == coded_bits(frame)[0]


def test_the_worst_cases_are_those_of_davis_and_of_the_linux_kernel() -> None:
    assert [worst_bits(n) for n in range(9)] == [55, 65, 75, 85, 95, 105, 115, 125, 135]
    assert [worst_bits(n, extended=True) for n in range(9)] == [80, 90, 100, 110, 120, 130, 140, 150, 160]
    for n in range(9):  # with one stuff bit after the first five bits and after each four more
        assert worst_bits(n) == 8 * n + 47 + (34 + 8 * n - 1) // 4
        assert worst_bits(n, extended=True) == 8 * n + 67 + (54 + 8 * n - 1) // 4
    assert worst_bits(8) == WORST_BLOCKING_BITS


@pytest.mark.parametrize("size", [-1, 9])
def test_a_frame_of_another_size_does_not_exist(size: int) -> None:
    with pytest.raises(WireError, match=r"0\.\.8 data bytes"):
        worst_bits(size)


# -- response times -------------------------------------------------------------------------------------------

# Davis et al. 2007, the counterexample: 125 kbit/s, so 125 bits are 1 ms.
MS = 125
COUNTEREXAMPLE = [
    Message("A", 1 * MS, Fraction(5, 2) * MS, 0, Fraction(5, 2) * MS),
    Message("B", 1 * MS, Fraction(7, 2) * MS, 0, Fraction(13, 4) * MS),
    Message("C", 1 * MS, Fraction(7, 2) * MS, 0, Fraction(13, 4) * MS),
]


def test_the_counterexample_of_davis_misses_its_deadline_in_the_second_instance() -> None:
    assert analyse(COUNTEREXAMPLE) == [
        Response("A", Fraction(2 * MS), meets_deadline=True, instances=1),
        Response("B", Fraction(3 * MS), meets_deadline=True, instances=2),
        Response("C", Fraction(7, 2) * MS, meets_deadline=False, instances=2),
    ]


def test_a_lone_message_waits_for_one_frame_of_lower_priority() -> None:
    message = Message("altitude", 135, 10_000, 0, 270)
    assert analyse([message]) == [Response("altitude", Fraction(135), meets_deadline=True, instances=1)]
    assert analyse([message], blocking_bits=WORST_BLOCKING_BITS)[0].bits == 270
    late = analyse([message._replace(jitter=1)], blocking_bits=WORST_BLOCKING_BITS)
    assert late == [Response("altitude", Fraction(271), meets_deadline=False, instances=1)]


def test_an_overloaded_bus_has_no_bound_from_there_on() -> None:
    messages = [
        Message("fits", 100, 400, 0, 400),
        Message("fills", 100, Fraction(400, 3), 0, 400),
        Message("starves", 55, 100_000, 0, 100_000),
    ]
    fits, fills, starves = analyse(messages)
    assert fits.bits == 200
    assert fills == Response("fills", None, meets_deadline=False, instances=0)
    assert starves == Response("starves", None, meets_deadline=False, instances=0)


def test_a_bus_that_is_full_to_within_the_clocks_is_overloaded_too() -> None:
    assert analyse([Message("m", 100, 101, 0, 101)])[0].bits == 100
    assert analyse([Message("m", 100_000, 100_001, 0, 100_001)])[0].bits is None


def test_errors_take_time_and_may_be_too_many() -> None:
    message = Message("m", 100, 1_000, 0, 1_000)
    # One error destroys the frame at its end, at worst: 31 bits and the frame once more.
    assert analyse([message], errors=Errors(1, 10_000))[0].bits == 231
    assert analyse([message], errors=Errors(3, 10_000))[0].bits == 3 * 131 + 100
    assert analyse([message], errors=Errors(1, 140))[0].bits is None


def test_no_messages_have_no_responses() -> None:
    assert analyse([]) == []
    assert analyse([], blocking_bits=135, errors=Errors(1, 1000)) == []


@pytest.mark.parametrize(
    "message",
    [Message("m", 0, 1, 0, 1), Message("m", 55, 0, 0, 1), Message("m", 55, 1, -1, 1)],
)
def test_an_impossible_message_is_refused(message: Message) -> None:
    with pytest.raises(WireError, match="message m: give a length and a period"):
        analyse([message])


@pytest.mark.parametrize("errors", [Errors(0, 100), Errors(1, 0)])
def test_impossible_errors_are_refused(errors: Errors) -> None:
    with pytest.raises(WireError, match="give a burst of 1 or more"):
        analyse([], errors=errors)


def textbook(messages: list[Message], blocking_bits: int, errors: Errors | None) -> list[tuple[Fraction, int]]:
    """The equations of Davis 2007 as printed, by plain iteration over rationals."""
    found = []
    for m, message in enumerate(messages):
        above, at_or_above = messages[:m], messages[: m + 1]
        blocking = max([blocking_bits, *(k.bits for k in messages[m + 1 :])])
        longest = max(k.bits for k in at_or_above)

        def lost(t: Fraction, longest: int = longest) -> Fraction:
            if errors is None:
                return Fraction(0)
            return (errors.burst - 1 + ceil(t / errors.interval)) * Fraction(31 + longest)

        t, grown = Fraction(0), Fraction(message.bits)
        while grown != t:
            t = grown
            released = sum(ceil((t + k.jitter) / Fraction(k.period)) * k.bits for k in at_or_above)
            grown = lost(t) + blocking + released
        instances = ceil((t + message.jitter) / Fraction(message.period))
        worst = Fraction(0)
        for q in range(instances):
            w, grown = Fraction(-1), Fraction(blocking + q * message.bits)
            while grown != w:
                w = grown
                released = sum(ceil((w + k.jitter + 1) / Fraction(k.period)) * k.bits for k in above)
                grown = lost(w + message.bits) + blocking + q * message.bits + released
            worst = max(worst, message.jitter + w - q * message.period + message.bits)
        found.append((worst, instances))
    return found


@st.composite
def message_sets(draw: st.DrawFn, *, whole: bool) -> list[Message]:
    """Draw up to six messages that load the bus to at most 95 %, with awkward periods, jitter and deadlines."""
    count = draw(st.integers(1, 6))
    bits = [worst_bits(draw(st.integers(0, 8))) for _ in range(count)]
    shares = [draw(st.integers(1, 20)) for _ in range(count)]
    load = Fraction(draw(st.integers(10, 95)), 100)
    messages = []
    for i in range(count):
        period = bits[i] * sum(shares) / (shares[i] * load)
        period = Fraction(ceil(period)) if whole else period
        jitter = draw(st.one_of(st.just(0), st.integers(0, ceil(2 * period))))
        deadline = draw(st.integers(1, ceil(3 * period)))
        messages.append(Message(f"m{i}", bits[i], period, jitter, deadline))
    return messages


@settings(max_examples=part_of(200), deadline=None)
@given(
    message_sets(whole=False),
    st.sampled_from([0, 55, 135, 160]),
    st.one_of(st.none(), st.builds(Errors, st.integers(1, 3), st.integers(8_000, 50_000))),
)
@example(COUNTEREXAMPLE, 0, None)
def test_the_windows_find_what_the_textbook_equations_give(
    messages: list[Message], blocking_bits: int, errors: Errors | None
) -> None:
    expected = textbook(messages, blocking_bits, errors)
    for message, response, (bits, instances) in zip(
        messages, analyse(messages, blocking_bits=blocking_bits, errors=errors), expected, strict=True
    ):
        assert response == Response(message.name, bits, bits <= message.deadline, instances)


def longest_seen(
    messages: list[Message], offsets: list[int], delays: list[list[int]], blocker_bits: int, horizon: int
) -> list[int]:
    """Run a bus in whole bit times; below all messages a node always has a frame of `blocker_bits` to send.

    Instances of one message are queued in their order, however late one of them is.
    """
    releases = []
    for priority, message in enumerate(messages):
        queued = 0
        for number in range(len(delays[priority])):
            due = offsets[priority] + number * int(message.period)
            queued = max(queued, due + delays[priority][number])
            if due < horizon:
                releases.append((queued, priority, number, due))
    longest, pending, now = [0] * len(messages), sorted(releases), 0
    while pending:
        ready = [release for release in pending if release[0] <= now]
        if not ready:
            now = now + blocker_bits if blocker_bits else pending[0][0]
            continue
        chosen = min(ready, key=lambda release: release[1:3])
        pending.remove(chosen)
        _, priority, _, due = chosen
        now += messages[priority].bits
        longest[priority] = max(longest[priority], now - due)
    return longest


@settings(max_examples=part_of(150), deadline=None)
@given(st.data(), message_sets(whole=True), st.sampled_from([0, 55, 135]))
def test_no_run_of_a_bus_takes_longer_than_the_analysis_says(
    data: st.DataObject, messages: list[Message], blocker_bits: int
) -> None:
    horizon = 3 * int(max(message.period for message in messages))
    offsets = [data.draw(st.integers(0, int(message.period))) for message in messages]
    delays = []
    for message in messages:
        count = min(horizon // int(message.period), 60)
        late_ones = st.sampled_from([0, int(message.jitter) // 2, int(message.jitter)])
        delays.append(data.draw(st.lists(late_ones, min_size=count, max_size=count)))
    seen = longest_seen(messages, offsets, delays, blocker_bits, horizon)
    responses = analyse(messages, blocking_bits=blocker_bits)
    for response, bits in zip(responses, seen, strict=True):
        assert response.bits is not None
        assert bits <= response.bits


def test_the_bound_is_reached_but_for_the_bit_by_which_the_other_frame_came_first() -> None:
    # Half-bit steps: everything of the counterexample is due one step after a lower frame has started.
    doubled = [message._replace(bits=2 * message.bits, period=2 * message.period) for message in COUNTEREXAMPLE]
    seen = longest_seen(doubled, [1, 1, 1], [[0] * 6] * 3, blocker_bits=0, horizon=4000)
    assert seen[2] == 7 * MS
    assert analyse(COUNTEREXAMPLE)[2].bits == Fraction(7, 2) * MS
    first = longest_seen(doubled[:1], [1], [[0]], blocker_bits=2 * MS, horizon=4000)
    assert first == [4 * MS - 1]
    assert analyse(COUNTEREXAMPLE[:1], blocking_bits=MS)[0].bits == 2 * MS
