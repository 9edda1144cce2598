"""What the laboratory finds wrong with landings of the EAV whose filter has moved."""

import pytest

pytest.importorskip("jsbsim")

from heronry_tools.fly.acceptance import Touchdown
from heronry_tools.fly.mission import Landing, Mission
from lab.checkpoints.landings import Pair, faults_of

SOFT = Touchdown(time_s=30.0, x_m=1.0, y_m=0.0, sink_m_per_s=0.5, airspeed_m_per_s=16.0, pitch_deg=4.0, bank_deg=0.0)


def landing(seed: int, touchdown: Touchdown | None = SOFT, *violations: str) -> Landing:
    return Landing(Mission(seed), touchdown, touchdown is None, "precise", "", 40.0, None, None, (), violations)


def pairs(*moved: Landing, age_ms: int | None = 200) -> list[Pair]:
    return [Pair(landing(one.mission.seed), one, age_ms) for one in moved]


def test_one_landing_may_be_lost_and_two_may_not() -> None:
    refused = [landing(seed, None) for seed in (1, 2)]
    assert faults_of(pairs(landing(0), refused[0]), kept=True) == []
    assert faults_of(pairs(landing(0), *refused), kept=True) == ["1 landings with a move, 3 without"]
    assert faults_of(pairs(landing(0), *refused), kept=False) == []


def test_a_filter_without_its_state_and_a_violation_are_told() -> None:
    assert faults_of(pairs(landing(7), age_ms=None), kept=True) == ["seed 7: no state"]
    assert faults_of(pairs(landing(7), age_ms=None), kept=False) == []
    assert faults_of(pairs(landing(7, SOFT, "checkpoint: too old")), kept=False) == ["seed 7: checkpoint: too old"]
