"""What PEs report as silent: told once, over in three ways, dropped where the manager knows better, and failing."""

from dataclasses import replace

import pytest

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.vocabulary import FailElement, OperatorSaid
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS
from heronry_wire.silence import Silence
from manager.one_manager import BEAT_NS, SPEC_TEXT, OneManager

CONTROL, DRIVE_LEFT, DRIVE_RIGHT = range(3)
DEMAND = Silence(0, is_output=True)


def stale(module: int, silence: Silence) -> Emergency:
    return Emergency(FaultCode.STALE, 0, ElementKind.MODULE, module, silence.detail)


def flying(spec: Spec | None = None) -> OneManager:
    """A manager whose plan runs: `control` and `drive_left` on `left`."""
    manager = OneManager(spec)
    manager.start()
    running = {module.partition(" ")[0] for module in manager.core.status()["pes"]}
    assert running == {"left", "middle", "right"}
    return manager


def strict() -> Spec:
    return loads(SPEC_TEXT.replace("control: {", "control: {silent: fails, "), "strict.dg.yaml")


def test_an_output_is_told_once_while_it_lasts_and_its_end() -> None:
    manager = flying()
    requests = len(manager.requests)
    for _ in range(3):
        manager.report("left", stale(CONTROL, DEMAND))
        manager.pass_time(CHANNEL_FORGOTTEN_NS // 3)
    (told,) = manager.of(events.OutputSilent)
    assert (told.module, told.by, told.variable) == ("control", "left", "demand")
    (shown,) = manager.core.status()["silences"]
    assert (shown["module"], shown["by"], shown["what"], shown["variable"]) == ("control", "left", "output", "demand")
    assert shown["producer"] is None
    manager.report("left", stale(CONTROL, replace(DEMAND, is_over=True)))
    (over,) = manager.of(events.SilenceOver)
    assert (over.what, over.why) == ("output", "data come again")
    assert manager.core.status()["silences"] == []
    assert manager.core.status()["latched"] == []
    assert len(manager.requests) == requests


def test_an_input_names_the_module_that_should_give_it() -> None:
    manager = flying()
    manager.report("left", stale(DRIVE_LEFT, Silence(0)))
    (told,) = manager.of(events.InputSilent)
    assert (told.module, told.by, told.variable, told.producer) == ("drive_left", "left", "demand", "control")


def test_a_silence_that_its_pe_does_not_repeat_is_over() -> None:
    manager = flying()
    manager.report("left", stale(DRIVE_LEFT, Silence(0)))
    manager.pass_time(CHANNEL_FORGOTTEN_NS + 2 * BEAT_NS)
    assert [one.why for one in manager.of(events.SilenceOver)] == ["no longer reported"]


@pytest.mark.parametrize(
    ("pe", "module", "silence"),
    [
        ("left", DRIVE_RIGHT, Silence(0)),  # does not run
        ("middle", DRIVE_LEFT, Silence(0)),  # runs elsewhere
        ("left", DRIVE_LEFT, Silence(1)),  # has no such input
        ("left", DRIVE_LEFT, Silence(0, is_output=True)),  # has no such output
        ("left", CONTROL, Silence(9, is_output=True)),  # the spec has no such variable
        ("left", 77, Silence(0)),
    ],
)
def test_a_report_of_what_does_not_run_is_dropped(pe: str, module: int, silence: Silence) -> None:
    manager = flying()
    manager.report(pe, stale(module, silence))
    assert manager.core.status()["silences"] == []


def test_a_module_that_is_to_fail_fails_at_its_place_and_a_plan_follows() -> None:
    manager = flying(strict())
    requests = len(manager.requests)
    manager.report("left", stale(CONTROL, DEMAND))
    (fault,) = manager.core.status()["latched"]
    assert (fault["element"], fault["by"], fault["code"]) == ("module:control@left", "left", "STALE")
    assert len(manager.requests) == requests + 1
    assert "module:control@left" in manager.requests[-1].now.down
    manager.report("left", stale(CONTROL, DEMAND))
    assert len(manager.of(events.FaultReported)) == 1


def test_a_silent_input_fails_no_module() -> None:
    manager = flying(strict())
    manager.report("left", stale(DRIVE_LEFT, Silence(0)))
    assert len(manager.of(events.InputSilent)) == 1
    assert manager.core.status()["latched"] == []


def test_the_end_of_what_was_never_told_is_no_event() -> None:
    manager = flying()
    manager.report("left", stale(CONTROL, replace(DEMAND, is_over=True)))
    assert manager.of(events.SilenceOver) == []


def test_a_silence_is_over_when_its_module_runs_elsewhere() -> None:
    manager = flying()
    manager.report("left", stale(CONTROL, DEMAND))
    manager.give(OperatorSaid(1, FailElement("module:control@left")))
    moved = manager.answer()
    assert moved.configuration.modules["control"].pe == "middle"
    for pe in manager.spec.pes:
        manager.stage(pe)
    manager.pass_time(BEAT_NS)
    assert [one.why for one in manager.of(events.SilenceOver)] == ["no longer part of what runs"]


def test_an_input_whose_producer_has_failed_is_no_silence() -> None:
    manager = flying()
    manager.give(OperatorSaid(1, FailElement("module:control@left")))
    manager.report("left", stale(DRIVE_LEFT, Silence(0)))
    assert manager.of(events.InputSilent) == []
