"""A few kills of the laboratory: with a checkpoint the command goes on, and without one it jumps."""

import pytest

from lab.checkpoints import MOST_JUMP
from lab.checkpoints.kills import Flown, faults_of, fly


@pytest.mark.parametrize("seed", [2, 3])
def test_a_command_goes_on_with_a_checkpoint_alone(seed: int) -> None:
    kept, forgotten = (fly(seed, kept=is_kept) for is_kept in (True, False))
    assert faults_of([kept]) == []
    assert (kept.age_ms is None, forgotten.age_ms) == (False, None)
    assert forgotten.jump > 10 * MOST_JUMP


def test_what_is_wrong_is_told() -> None:
    flown = Flown(4, 0.02, 80.0, None, ("checkpoint: too old",))
    assert faults_of([flown]) == [
        "seed 4: the command jumps by 2.00%",
        "seed 4: starts without its state",
        "seed 4: checkpoint: too old",
    ]
