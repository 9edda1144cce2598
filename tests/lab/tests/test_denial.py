"""Forgers on real processes: what counts as denied, how long a function was silent, and a short flight."""

from dataclasses import replace

import pytest

from heronry_tools.console.spec_files import load_spec
from lab.denial import Endured, main
from lab.silences import Silences
from tools.test_witness import MS, echo

NOTHING = Endured("forged_tag", 9, 9.0, silent_ms=60, lease_ms=500, renewed=0, lost=(), refused=7)


@pytest.mark.parametrize(
    ("endured", "failure"),
    [
        (NOTHING, None),
        (replace(NOTHING, percent=0, refused=0), None),
        (replace(NOTHING, silent_ms=501), "a function was silent for 501 ms, longer than T_lease (500 ms)"),
        (replace(NOTHING, silent_ms=900, usual_ms=401), None),
        (replace(NOTHING, silent_ms=902, usual_ms=401), "silent for 902 ms, longer than T_lease (401 + 500 ms)"),
        (replace(NOTHING, restarted="tail_a", has_joined=False), "tail_a was restarted, and has not joined again"),
        (replace(NOTHING, renewed=2), "the manager ended 2 sessions"),
        (replace(NOTHING, lost=("tail_a", "tail_b")), "the manager lost tail_a, tail_b"),
        (replace(NOTHING, refused=0), "the manager's status tells nothing of the forger"),
    ],
)
def test_what_rule_11_forbids_is_a_failure(endured: Endured, failure: str | None) -> None:
    assert (endured.failure() or "").endswith(failure or "")
    assert (endured.failure() is None) == (failure is None)
    assert endured.line().endswith("7 refused" if failure is None and endured.refused else failure or "0 refused")


def test_a_silence_counts_also_while_it_lasts() -> None:
    spec = load_spec("elevator_and_chute")
    silences = Silences(spec)
    for at_ms in (0, 25, 300):
        silences.see(at_ms * MS, echo(spec, "elevator_servo_1"))
    assert silences.longest_ns(310 * MS) == 275 * MS
    silences.begin()
    assert silences.longest_ns(310 * MS) == 10 * MS
    assert silences.longest_ns(900 * MS) == 600 * MS


@pytest.mark.live
@pytest.mark.soak
def test_no_forger_denies_anything_to_real_processes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--seconds", "5", "--percent", "9", "--kinds", "forged_epoch", "forged_session"]) == 0
    assert capsys.readouterr().out.endswith("no forger denied anything\n")
