"""A channel that carries nothing, as the manager knows it: reported, forgotten in time, no reason for a new plan."""

import pytest

from heronry_dg.loader import loads
from heronry_manager import events
from heronry_manager.core.vocabulary import AskStatus, ChannelsLost, OperatorSaid, Reply
from heronry_tools.reports.status import report
from heronry_wire.management import ElementKind, Emergency, FaultCode
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS, CHANNEL_REPORT_NS
from manager.one_manager import BEAT_NS, SPEC_TEXT, OneManager

NONE: frozenset[int] = frozenset()


def about(code: FaultCode, bus: int = 0, channel: int = 2) -> Emergency:
    return Emergency(code, 0, ElementKind.CHANNEL, bus, channel)


LOST, BACK = about(FaultCode.CHANNEL_LOST), about(FaultCode.CHANNEL_BACK)


@pytest.fixture
def manager() -> OneManager:
    flying = OneManager(
        loads(SPEC_TEXT.replace("{bitrate: 1000000}", "{bitrate: 1000000, channels: 2}"), "twin.dg.yaml")
    )
    flying.start()
    return flying


def told(manager: OneManager) -> list[tuple[str, str, str]]:
    kinds = events.ChannelLost | events.ChannelBack
    return [(e.kind, e.channel, e.by) for e in manager.events if isinstance(e, kinds)]


def status(manager: OneManager) -> dict[str, list[str]]:
    (reply,) = (action for action in manager.give(OperatorSaid(1, AskStatus())) if isinstance(action, Reply))
    assert reply.status is not None
    assert any("carries nothing" in line for line in report(reply.status)) == any(reply.status["channels"].values())
    return dict(reply.status["channels"])


def test_a_lost_channel_makes_one_event_for_each_node_that_lacks_it_and_changes_no_plan(manager: OneManager) -> None:
    requested, answered = len(manager.requests), len(manager.answers())
    for _ in range(3):
        manager.report("left", LOST)
    manager.give(ChannelsLost(frozenset({2})))
    assert told(manager) == [("channel_lost", "can0.2", "left"), ("channel_lost", "can0.2", "the manager")]
    assert status(manager) == {"can0.1": [], "can0.2": ["the manager", "left"]}
    manager.report("left", BACK)
    manager.report("left", BACK)
    manager.give(ChannelsLost(NONE))
    assert told(manager)[2:] == [("channel_back", "can0.2", "left"), ("channel_back", "can0.2", "the manager")]
    assert status(manager) == {"can0.1": [], "can0.2": []}
    assert (len(manager.requests), len(manager.answers())) == (requested, answered)


def test_a_loss_that_is_not_repeated_is_over(manager: OneManager) -> None:
    manager.report("left", LOST)
    manager.pass_time(CHANNEL_REPORT_NS)
    manager.report("left", LOST)
    manager.pass_time(CHANNEL_FORGOTTEN_NS - BEAT_NS)
    assert status(manager)["can0.2"] == ["left"]
    manager.pass_time(3 * BEAT_NS)
    assert told(manager)[1:] == [("channel_back", "can0.2", "left")]


def test_a_report_does_not_stop_what_is_under_way(manager: OneManager) -> None:
    manager.die("right")
    manager.pass_time(4 * BEAT_NS)
    requested = len(manager.requests)
    manager.report("left", LOST)
    assert len(manager.requests) == requested
    assert manager.of(events.EpochAbandoned) == []


@pytest.mark.parametrize(
    "nonsense",
    [
        about(FaultCode.CHANNEL_LOST, bus=1),
        about(FaultCode.CHANNEL_LOST, channel=0),
        about(FaultCode.CHANNEL_LOST, channel=3),
    ],
)
def test_what_the_spec_does_not_have_is_ignored(manager: OneManager, nonsense: Emergency) -> None:
    manager.report("left", nonsense)
    assert told(manager) == []


def test_a_bus_that_is_not_replicated_has_no_channels() -> None:
    manager = OneManager()
    manager.start()
    manager.report("left", about(FaultCode.CHANNEL_LOST, channel=1))
    assert told(manager) == []
    assert status(manager) == {}
