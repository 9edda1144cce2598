"""When an actuator is driven and when it is made safe, in any order of commands, renewals and pauses; and the memory.

The oracle writes down what semantics and protocol ask of what was written, and knows nothing of the state machine.
"""

import math
import os
from contextlib import suppress
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_agent.shell.device_processes.judgement import ReadingRule, Silence
from heronry_agent.shell.device_processes.safe_output import Move, OutputLimits, SafeOutput, TakeSafeAction
from heronry_agent.shell.device_processes.shared_block import (
    BLOCK_BYTES,
    Entry,
    Ring,
    SharedBlock,
    Word,
    decode_value,
    encode_value,
)

MS = 1_000_000
SAFE = -99.0


@dataclass
class Actuator:
    """The process of an actuator, with a clock of the test's."""

    limits: OutputLimits = field(default_factory=OutputLimits)
    lasts_ns: int | None = None  # of every value but 0
    written: list[tuple[int, float]] = field(default_factory=list)
    now_ns: int = 10_000 * MS
    until_ns: int = 0
    entry: Entry | None = None

    def __post_init__(self) -> None:
        self.output = SafeOutput(self.limits)
        self._write(SAFE)

    def command(self, value: float | None, valid_ns: int) -> None:
        self.entry = Entry(1 if self.entry is None else self.entry.number + 1, self.now_ns, value)
        self.until_ns = self.now_ns + valid_ns if value is not None else 0

    def run(self) -> None:
        """Do what is due now."""
        while True:
            done = self.output.done
            match self.output.decide(self.entry, self.until_ns, self.now_ns, self._lasts):
                case Move(value):
                    self._write(value)
                case TakeSafeAction():
                    self._write(SAFE)
                case None if done == self.output.done:
                    return

    def sleep(self, ns: int) -> None:
        """Let time pass; the process wakes whenever it has asked to."""
        end_ns = self.now_ns + ns
        self.run()
        while (due_ns := self.output.next_deadline_ns(self.until_ns)) <= end_ns:
            self.now_ns = max(self.now_ns, due_ns)
            self.run()
        self.now_ns = end_ns

    def _write(self, value: float) -> None:
        self.written.append((self.now_ns, value))
        self.output.moved(value, self.now_ns)

    def _lasts(self, value: float) -> int | None:
        return self.lasts_ns if value else None

    @property
    def position(self) -> float:
        return self.written[-1][1]


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("command"), st.floats(-50, 50), st.integers(0, 60 * MS)),
        st.tuples(st.just("safe")),
        st.tuples(st.just("renew"), st.integers(0, 60 * MS)),
        st.tuples(st.just("sleep"), st.integers(0, 90 * MS)),
        st.tuples(st.just("pause"), st.integers(0, 90 * MS)),
    ),
    max_size=25,
)


@given(STEPS, st.sampled_from([None, 40.0, 1000.0]))
def test_in_any_story_nothing_is_driven_beyond_its_validity_its_limits_or_its_rate(
    steps: list[tuple], per_s: float | None
) -> None:
    actuator = Actuator(OutputLimits(-20.0, 30.0, per_s))
    for step in steps:
        match step:
            case "command", value, valid_ns:
                actuator.command(value, valid_ns)
                actuator.run()
            case ("safe",):
                actuator.command(None, 0)
                actuator.run()
                assert actuator.position == SAFE
            case "renew", valid_ns if actuator.now_ns <= actuator.until_ns:
                actuator.until_ns = actuator.now_ns + valid_ns
            case "sleep", ns:
                actuator.sleep(ns)
            case "pause", ns:
                actuator.now_ns += ns
                actuator.run()
        if actuator.now_ns > actuator.until_ns:
            actuator.run()
            assert actuator.position == SAFE, "the end of validity has passed"
    values = [value for _, value in actuator.written if value != SAFE]
    assert all(-20.0 <= value <= 30.0 or (value < -20.0 and per_s is not None) for value in values)
    if per_s is not None:
        for (earlier_ns, earlier), (later_ns, later) in zip(actuator.written, actuator.written[1:], strict=False):
            if later != SAFE:
                allowed = per_s * min(later_ns - earlier_ns, 20 * MS) / 1e9
                assert abs(later - earlier) <= allowed + 1e-9


@given(
    st.lists(st.tuples(st.sampled_from([0.0, 1.0, 2.0]), st.sampled_from([0, 7 * MS, 25 * MS, 60 * MS])), max_size=20)
)
def test_an_actuator_that_may_last_so_long_is_on_no_longer_and_then_waits_for_an_order_to_be_off(
    commands: list[tuple[float, int]],
) -> None:
    actuator = Actuator(lasts_ns=50 * MS)
    on_since_ns: int | None = None
    is_used_up = False
    for value, ns in commands:
        begun_ns = actuator.now_ns
        actuator.command(value, 10**12)
        if value == 0.0:
            on_since_ns, is_used_up = None, False
        elif on_since_ns is None:
            on_since_ns = begun_ns
        actuator.sleep(ns)
        actuator.run()
        is_used_up = is_used_up or (on_since_ns is not None and actuator.now_ns >= on_since_ns + 50 * MS)
        assert actuator.position == (SAFE if is_used_up else value)


def test_a_process_that_begins_anew_waits_for_an_order_to_be_off_where_values_may_not_last() -> None:
    actuator = Actuator(lasts_ns=50 * MS)
    actuator.output = SafeOutput(OutputLimits(), begun_anew=True)
    actuator.command(1.0, 10**12)
    actuator.run()
    assert actuator.position == SAFE
    actuator.command(0.0, 10**12)
    actuator.run()
    actuator.command(1.0, 10**12)
    actuator.run()
    assert actuator.position == 1.0


@pytest.mark.parametrize("value", ["up", b"\x01", (1, 2), math.nan, math.inf])
def test_a_command_that_is_no_finite_number_moves_nothing(value: object) -> None:
    actuator = Actuator()
    actuator.command(value, 10**12)
    actuator.run()
    assert actuator.position == SAFE
    assert actuator.output.done == 1, "it was dealt with"


# Readings


def test_a_reading_at_the_end_of_its_age_and_range_is_valid_and_beyond_is_not() -> None:
    rule = ReadingRule(100, -1.0, 1.0)
    assert rule.judge(Entry(1, 1000, 1.0), 1100).valid
    assert not rule.judge(Entry(1, 1000, 1.0), 1101).valid
    assert not rule.judge(Entry(1, 1000, 1.0001), 1100).valid
    assert rule.judge(Entry(1, 1000, (5, 6)), 1100).valid
    assert not rule.judge(None, 1100).valid


def test_a_standstill_of_the_agent_is_no_silence_of_the_device() -> None:
    silence = Silence(300 * MS, 0, 0)
    silence.look(100 * MS)
    silence.look(5_000 * MS)
    assert not silence.is_over(5_000 * MS)
    silence.sign(4_000 * MS)
    assert not silence.is_over(5_300 * MS)
    for at_ms in range(5_000, 5_400, 50):
        silence.look(at_ms * MS)
    assert silence.is_over(5_301 * MS)


# The memory

VALUES = st.one_of(
    st.none(),
    st.floats(allow_nan=False),
    st.integers(-(2**63), 2**63 - 1),
    st.text(max_size=100),
    st.binary(max_size=100),
    st.tuples(st.integers(-(2**63), 2**63 - 1), st.integers(-(2**63), 2**63 - 1)),
)


@given(VALUES)
def test_a_value_is_read_as_it_was_written(value: object) -> None:
    assert decode_value(encode_value(value)) == value


@given(st.binary(max_size=64))
def test_any_bytes_are_a_value_or_none(data: bytes) -> None:
    with suppress(ValueError):
        assert isinstance(decode_value(data), int | float | str | bytes | tuple | None)


@pytest.mark.parametrize("value", [[1], {}, object(), 2**63, "x" * 2_000, "\ud800", (1.5,)])
def test_what_is_no_value_is_refused(value: object) -> None:
    with pytest.raises(ValueError, match=r"value|bits"):
        encode_value(value)


def test_both_sides_see_the_newest_entry_and_garbage_is_none() -> None:
    descriptor = SharedBlock.create()
    ours, theirs = SharedBlock(descriptor), SharedBlock(descriptor)
    assert ours.newest(Ring.READINGS) is None
    for number in range(1, 20):
        theirs.put(Ring.READINGS, number, float(number))
        assert ours.newest(Ring.READINGS) == Entry(number, number, float(number))
    assert ours.newest(Ring.COMMANDS) is None, "the other ring is untouched"
    theirs[Word.ALIVE] = 2**62
    assert ours[Word.ALIVE] == 2**62
    os.pwrite(descriptor, b"\xff" * (BLOCK_BYTES - 64), 64)
    assert ours.newest(Ring.READINGS) is None
    ours.close()
    theirs.close()
    os.close(descriptor)


@given(st.integers(64, BLOCK_BYTES - 1), st.integers(1, 255))
def test_a_flipped_byte_gives_no_wrong_entry(at: int, flips: int) -> None:
    descriptor = SharedBlock.create()
    block = SharedBlock(descriptor)
    block.put(Ring.READINGS, 5, 2.5)
    (before,) = os.pread(descriptor, 1, at)
    os.pwrite(descriptor, bytes((before ^ flips,)), at)
    assert block.newest(Ring.READINGS) in (None, Entry(1, 5, 2.5))
    block.close()
    os.close(descriptor)
