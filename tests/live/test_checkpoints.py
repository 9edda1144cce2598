"""A controller on processes goes on from its state when its agent is killed."""

import pytest

from lab.checkpoints import MOST_JUMP
from lab.checkpoints.live import fly

pytestmark = pytest.mark.live


def test_a_killed_controller_goes_on_elsewhere_where_it_was() -> None:
    (kill,) = fly(1, seed=1, heartbeat_ms=100)
    assert kill.age_ms is not None
    assert kill.jump <= 5 * MOST_JUMP  # a busy computer finds the loss late, and the loop moves meanwhile


@pytest.mark.soak
def test_twenty_kills() -> None:
    found = fly(20, seed=2, heartbeat_ms=100)
    assert all(kill.age_ms is not None for kill in found)
    assert sorted(kill.jump for kill in found)[10] <= MOST_JUMP
