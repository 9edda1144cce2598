"""What PEs hold back, and why: told where it lasts longer than T_lease, and when it is over."""

from dataclasses import replace

import pytest

from heronry_manager import events
from heronry_manager.core.vocabulary import FailElement, OperatorSaid
from heronry_wire.state_frames import PeFlags, PeState
from manager.one_manager import BEAT_NS, OneManager

DRIVES = "left"
HEARS, HELD = PeFlags.HEARS_LEASE, PeFlags.OUTPUT_HELD


@pytest.fixture
def manager() -> OneManager:
    found = OneManager()
    found.start()
    return found


def reports(manager: OneManager, flags: PeFlags, beats: int, epoch: int | None = None) -> None:
    """Let the PE that drives report these flags for some beats."""
    page = manager.running[DRIVES]
    manager.running[DRIVES] = replace(page, flags=flags, epoch=page.epoch if epoch is None else epoch)
    manager.pass_time(beats * BEAT_NS)


def test_a_moment_is_not_told(manager: OneManager) -> None:
    for _ in range(3):
        reports(manager, HEARS | HELD, 5)
        reports(manager, HEARS, 1)
    assert manager.of(events.OutputsHeld) == manager.of(events.OutputsFree) == []


def test_what_is_held_where_and_why_and_when_it_is_free_again(manager: OneManager) -> None:
    reports(manager, HEARS | HELD, 9)
    (told,) = manager.of(events.OutputsHeld)
    assert (told.pe, told.modules) == (DRIVES, ("drive_left",))
    assert told.cause == "it heard no node for longer than T_lease, or a frame told it of a newer epoch"
    shown = manager.core.status()["pes"][DRIVES]["held"]
    assert (shown["modules"], shown["why"]) == (["drive_left"], told.cause)
    assert shown["for_ns"] > 5 * BEAT_NS
    reports(manager, HEARS, 1)
    assert [one.pe for one in manager.of(events.OutputsFree)] == [DRIVES]
    assert manager.core.status()["pes"][DRIVES]["held"] is None


def test_the_cause_is_what_the_manager_sees(manager: OneManager) -> None:
    reports(manager, HELD, 7)
    reports(manager, HEARS, 1)
    reports(manager, HEARS | HELD, 7, epoch=0)
    assert manager.of(events.OutputsHeld)[0].cause == "it hears no LEASE of this manager"


def test_a_pe_that_is_left_out_and_one_on_another_epoch(manager: OneManager) -> None:
    manager.give(OperatorSaid(1, FailElement(f"pe:{DRIVES}")))
    reports(manager, HEARS | HELD, 9)
    assert [one.cause for one in manager.of(events.OutputsHeld)] == ["it is not available, so ALIVE does not name it"]
    manager.running["middle"] = replace(manager.running["middle"], flags=HEARS | HELD)
    manager.answer()
    for pe in ("middle", "right"):
        manager.stage(pe)
    manager.take("right", PeState.ACTIVE)
    manager.pass_time(9 * BEAT_NS)
    last = manager.of(events.OutputsHeld)[-1]
    assert (last.pe, last.modules, last.cause) == ("middle", (), "it runs epoch 1, and epoch 2 is active")
