"""The bench of switching measures what it says, and by number is quicker than by slices."""

from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_tools.simulator import switch_bench

FAIL_OVER = Path("dg_specs/examples/fail_over.dg.yaml")


def test_what_is_on_board_is_distributed_sooner() -> None:
    by_slices, by_number = (switch_bench.measured(load(FAIL_OVER), 1, faults, 0.5) for faults in (None, 1))
    assert by_slices is not None
    assert by_number is not None
    assert 0 < by_number[0] < by_slices[0]


def test_it_prints_both(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("sys.argv", ["switch_bench", str(FAIL_OVER), "--runs", "2", "--load", "0.1"])
    switch_bench.main()
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split("\t") == ["ms: median, p99", "distribute", "activate", "both"]
    assert [row.split(" (")[0] for row in rows] == ["slices sent", "on board"]
