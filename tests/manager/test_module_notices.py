"""What modules tell without a fault: told once, shown while it is repeated, without a plan."""

import pytest

from heronry_manager import events
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS
from manager.one_manager import OneManager

CONTROL = 0


def told(module: int = CONTROL, kind: ElementKind = ElementKind.MODULE) -> Emergency:
    return Emergency(FaultCode.DISAGREEMENT, 0, kind, module, 140)


def test_it_is_told_once_while_it_lasts_and_no_plan_follows() -> None:
    manager = OneManager()
    manager.start()
    requests = len(manager.requests)
    for _ in range(3):
        manager.report("left", told())
        manager.pass_time(CHANNEL_FORGOTTEN_NS // 3)
    assert len(manager.of(events.Disagreement)) == 1
    assert manager.core.status()["disagreements"] == [{"module": "control", "by": "left", "detail": 140}]
    assert manager.core.status()["latched"] == []
    manager.pass_time(2 * CHANNEL_FORGOTTEN_NS)
    assert [(one.module, one.by) for one in manager.of(events.Agreement)] == [("control", "left")]
    assert manager.core.status()["disagreements"] == []
    assert len(manager.requests) == requests


def test_one_of_something_that_the_spec_does_not_have_is_ignored() -> None:
    manager = OneManager()
    manager.start()
    manager.report("left", told(99))
    manager.report("left", told(0, ElementKind.DEVICE))
    assert manager.of(events.Disagreement) == []


def test_a_report_of_an_unknown_element_names_the_module_that_made_it() -> None:
    manager = OneManager()
    manager.start()
    for _ in range(3):
        manager.report("left", Emergency(FaultCode.UNKNOWN_ELEMENT, 0, ElementKind.MODULE, CONTROL, 7))
        manager.pass_time(CHANNEL_FORGOTTEN_NS // 3)
    (told,) = manager.of(events.UnknownElement)
    assert (told.module, told.by, told.detail) == ("control", "left", 7)
    manager.pass_time(2 * CHANNEL_FORGOTTEN_NS)
    assert manager.of(events.Agreement) == []
    manager.report("left", Emergency(FaultCode.UNKNOWN_ELEMENT, 0, ElementKind.MODULE, CONTROL, 7))
    assert len(manager.of(events.UnknownElement)) == 2


@pytest.mark.parametrize(
    ("code", "event"),
    [(FaultCode.UNKNOWN_OUTPUT, events.UnknownOutput), (FaultCode.UNKNOWN_INPUT, events.UnknownInput)],
)
def test_a_misspelt_name_names_its_module_and_fails_nothing(
    code: FaultCode, event: type[events.UnknownOutput | events.UnknownInput]
) -> None:
    manager = OneManager()
    manager.start()
    manager.report("left", Emergency(code, 0, ElementKind.MODULE, CONTROL, 0))
    (told,) = manager.of(event)
    assert (told.module, told.by) == ("control", "left")
    assert manager.of(events.FaultReported) == []
