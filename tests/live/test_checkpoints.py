"""States in real partitions, and a controller on processes that goes on from its state when its agent is killed."""

import os
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from agent.modules_with_states import Counts
from agent.one_pe import CONTROL
from heronry_agent.core.vocabulary import (
    KeptState,
    SaveState,
    StartModule,
    StateLacking,
    StateRestored,
    StateSaved,
    StepModule,
    Stepped,
)
from heronry_agent.shell.code_digest import code_digest
from heronry_agent.shell.partition_messages import Step
from heronry_agent.shell.partition_process import PartitionProcess
from heronry_wire.checkpoint_frames import Lack, SentState
from heronry_wire.sansio import NEVER_NS
from lab.checkpoints import MOST_JUMP
from lab.checkpoints.live import fly
from live.test_partitions import Hosted, _path

pytestmark = pytest.mark.live
__all__ = ["_path"]  # so that partitions find the modules of the tests


@pytest.fixture
def hosted(request: pytest.FixtureRequest) -> Iterator[Hosted]:
    """A host whose `control` is one of the modules with states."""
    host = Hosted("Misbehaving")
    entry = replace(host.entries[CONTROL], image=f"agent.modules_with_states:{request.param}")
    host.entries[CONTROL] = host.host._entries[CONTROL] = entry
    yield host
    host.host.close()


def saved_after_a_step(host: Hosted) -> object:
    """Let the module compute its first step, and save its state behind the second."""
    assert isinstance(host.step(CONTROL), Stepped)
    host.do(StepModule(CONTROL, 99, {}, NEVER_NS))
    host.do(SaveState(CONTROL, 7, 16))
    assert isinstance(host.next(), Stepped)
    return host.next()


@pytest.mark.parametrize("hosted", ["Counts"], indirect=True)
def test_a_partition_saves_a_state_and_another_start_goes_on_from_it(hosted: Hosted) -> None:
    hosted.start(CONTROL)
    saved = saved_after_a_step(hosted)
    assert isinstance(saved, StateSaved)
    assert (saved.round, saved.code) == (7, code_digest(Counts))
    kept = KeptState(SentState.of(0, 7, saved.data, saved.code), 0, NEVER_NS)
    hosted.do(StartModule(CONTROL, hosted.entries[CONTROL], 0, kept))
    assert isinstance(hosted.next(), StateRestored)
    assert hosted.demand(CONTROL) == 3.0


@pytest.mark.parametrize(("hosted", "lack"), [("Hangs", Lack.HANGS), ("Raises", Lack.RAISES)], indirect=["hosted"])
def test_a_save_that_fails_costs_the_module_nothing_else(hosted: Hosted, lack: Lack) -> None:
    hosted.start(CONTROL)
    lacking = saved_after_a_step(hosted)
    assert isinstance(lacking, StateLacking)
    assert lacking.lack is lack
    assert hosted.demand(CONTROL) == 3.0


def test_a_step_does_not_pay_for_the_state_that_is_saved_before_it() -> None:
    process = PartitionProcess("p", 1024)
    try:
        begun_ns = time.monotonic_ns()
        process.states_due[CONTROL] += 1
        process.expect(CONTROL, 1, begun_ns)
        process.send(Step(CONTROL, 1, begun_ns, NEVER_NS, None, ()))
        process.flush(begun_ns)
        saved_ns = begun_ns + 3600 * 10**9
        process.told_state(CONTROL, saved_ns)
        assert process.answered(CONTROL, 1, saved_ns + 5, NEVER_NS) == 5
        assert not process.states_due[CONTROL]
    finally:
        process.kill()
        os.waitpid(process.pid, 0)


def test_a_killed_controller_goes_on_elsewhere_where_it_was() -> None:
    (kill,) = fly(1, seed=1, heartbeat_ms=100)
    assert kill.age_ms is not None
    assert kill.jump <= 5 * MOST_JUMP  # a busy computer finds the loss late, and the loop moves meanwhile


@pytest.mark.soak
def test_twenty_kills() -> None:
    found = fly(20, seed=2, heartbeat_ms=100)
    assert all(kill.age_ms is not None for kill in found)
    assert sorted(kill.jump for kill in found)[10] <= MOST_JUMP
