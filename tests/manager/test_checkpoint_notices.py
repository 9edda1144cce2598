"""What PEs tell of the states of modules: each start once, and a state that cannot be saved as long as this lasts."""

import pytest

from heronry_manager import events
from heronry_wire.checkpoint_frames import Lack
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS
from manager.one_manager import OneManager

CONTROL = 0
RESTORED, LACKING = FaultCode.STATE_RESTORED, FaultCode.STATE_LACKING


def told(code: FaultCode, detail: int, module: int = CONTROL, kind: ElementKind = ElementKind.MODULE) -> Emergency:
    return Emergency(code, 0, kind, module, detail)


def managing() -> OneManager:
    manager = OneManager()
    manager.start()
    return manager


def kept(manager: OneManager) -> object:
    return manager.core.status()["checkpoints"]


def test_a_start_from_a_state_is_an_event_and_stays_in_the_status() -> None:
    manager = managing()
    requests = len(manager.requests)
    for _ in range(3):
        manager.report("left", told(RESTORED, 180))
        manager.pass_time(1_000_000_000)
    (event,) = manager.of(events.StateRestored)
    assert (event.module, event.by, event.age_ms) == ("control", "left", 180)
    (line,) = manager.core.status()["checkpoints"]
    assert {key: line[key] for key in ("module", "by", "age_ms", "why", "not_saved")} == {
        "module": "control",
        "by": "left",
        "age_ms": 180,
        "why": None,
        "not_saved": None,
    }
    assert line["for_ns"] > 2_900_000_000
    assert len(manager.requests) == requests


def test_the_same_report_much_later_is_another_start() -> None:
    manager = managing()
    for _ in range(2):
        manager.report("left", told(LACKING, Lack.NO_STATE))
        manager.pass_time(2 * CHANNEL_FORGOTTEN_NS)
    assert [one.why for one in manager.of(events.StateLacking)] == ["no state of it was kept there"] * 2


def test_copies_that_a_long_queue_has_delayed_are_no_other_starts() -> None:
    manager = managing()
    for _ in range(3):
        manager.report("left", told(RESTORED, 180))
        manager.pass_time(2_000_000_000)
    assert len(manager.of(events.StateRestored)) == 1
    (line,) = manager.core.status()["checkpoints"]
    assert line["for_ns"] > 5_900_000_000


def test_a_later_start_replaces_the_one_before() -> None:
    manager = managing()
    manager.report("left", told(RESTORED, 180))
    manager.report("right", told(LACKING, Lack.TOO_OLD))
    (line,) = manager.core.status()["checkpoints"]
    assert (line["by"], line["age_ms"], line["why"]) == ("right", None, "its state is too old")


def test_a_state_that_cannot_be_saved_is_told_when_it_begins_and_when_it_is_over() -> None:
    manager = managing()
    manager.report("left", told(LACKING, Lack.NO_STATE))
    for _ in range(3):
        manager.report("left", told(LACKING, Lack.HANGS))
        manager.pass_time(1_000_000_000)
    assert [one.why for one in manager.of(events.StateNotSaved)] == ["its save takes too long"]
    (line,) = manager.core.status()["checkpoints"]
    assert (line["why"], line["not_saved"]) == ("no state of it was kept there", "its save takes too long")
    manager.pass_time(2 * CHANNEL_FORGOTTEN_NS)
    assert [(one.module, one.by) for one in manager.of(events.StateSaved)] == [("control", "left")]


def test_a_manager_that_has_heard_of_no_start_knows_what_cannot_be_saved() -> None:
    manager = managing()
    manager.report("left", told(LACKING, Lack.NO_NUMBERS))
    why = "its save gives something else than finite numbers"
    line = {"module": "control", "by": "left", "age_ms": None, "why": None, "for_ns": None, "not_saved": why}
    assert kept(manager) == [line]


@pytest.mark.parametrize(
    "report",
    [
        told(RESTORED, 5, module=99),
        told(RESTORED, 5, kind=ElementKind.DEVICE),
        told(LACKING, 0),
        told(LACKING, 99),
    ],
)
def test_a_report_that_makes_no_sense_is_ignored(report: Emergency) -> None:
    manager = managing()
    manager.report("left", report)
    assert kept(manager) == []
