"""The response-time analysis against a simulated bus that shares no code with it."""

from fractions import Fraction

import pytest

from heronry_wire.timing import Message, Response, analyse
from lab.benches import bus as bus_bench
from lab.benches.bus import QUARTERS, Release, Stream, main, run_bus, try_sets


def test_no_message_takes_longer_and_each_comes_within_a_tenth() -> None:
    tally = try_sets(25, seed=3)
    assert (tally.sets, tally.exceeded, tally.short) == (25, 0, 0)
    assert tally.messages > 200
    assert tally.several > 20
    assert tally.least >= Fraction(9, 10)


def test_the_worked_example_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--sets", "2"]) == 0
    out = capsys.readouterr().out
    assert "C: at most 3.5 ms, seen 3.5 ms, misses its deadline of 3.25 ms" in out
    assert "longer than the analysis says: 0" in out


@pytest.mark.parametrize(("factor", "finding"), [(Fraction(4, 5), "longer"), (Fraction(6, 5), "below 90%")])
def test_the_benchmark_finds_a_wrong_analysis(
    factor: Fraction, finding: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def wrong(messages: list[Message], *, blocking_bits: int = 0) -> list[Response]:
        found = analyse(messages, blocking_bits=blocking_bits)
        return [r._replace(bits=None if r.bits is None else r.bits * factor) for r in found]

    monkeypatch.setattr(bus_bench, "analyse", wrong)
    assert main(["--sets", "3"]) == 1
    told = next(line for line in capsys.readouterr().out.splitlines() if line.strip().startswith(finding))
    assert not told.endswith(" 0")


def test_the_bus_sends_by_priority_and_interrupts_no_frame() -> None:
    streams = [Stream(400, 10_000, 0), Stream(300, 10_000, 0)]
    releases = [Release(10, 0, 10), Release(0, 1, 0), Release(20, 1, 20)]
    assert run_bus(streams, releases, iter(()), watched=1) == [300 - 10 + 400, 300 + 400 + 300 - 20]


def test_a_frame_within_a_bit_time_takes_part_against_the_watched_one_alone() -> None:
    streams = [Stream(400, 10_000, 0), Stream(300, 10_000, 0)]
    releases = [Release(QUARTERS - 1, 0, 0), Release(0, 1, 0)]
    assert run_bus(streams, releases, iter(()), watched=1) == [400, 700]
    assert run_bus(streams, releases, iter(()), watched=0) == [700, 300]
