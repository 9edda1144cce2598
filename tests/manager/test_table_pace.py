"""How fast a table follows: as the analysis says of the same spec with its frames declared as other equipment."""

from math import ceil

import pytest

from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.response_times import ResponseTimes
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, survivors
from heronry_dg.traffic import hops
from heronry_manager import events
from heronry_manager.core.provisioning.pace import SHARES
from heronry_manager.core.vocabulary import ClearElement, FailElement
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import LinkReport, LinkState
from heronry_wire.identifiers import heartbeat_id, sdo_request_id, sdo_response_id
from heronry_wire.sdo import LATE_NS
from heronry_wire.state_frames import PeState
from heronry_wire.timing import worst_bits
from manager.one_manager import MS, SPEC_TEXT, OneManager
from manager.test_operator import say

PE, NODE = "right", 94
REQUEST, ANSWER = sdo_request_id(NODE), sdo_response_id(NODE)


def spec(bitrate: int, deadline_ms: float, more: str = "") -> Spec:
    """Two tails, where the demand comes from the PE in the middle, and has a deadline."""
    text = SPEC_TEXT.replace("{bitrate: 1000000}", f"{{bitrate: {bitrate}{more}}}")
    text = text.replace("[left, middle]", "[middle]").replace("rate_hz: 40", "rate_hz: 20")
    return loads(text.replace("{type: FLOAT}", f"{{type: FLOAT, deadline_ms: {deadline_ms}}}"), "two_tails.dg.yaml")


def with_frames(bitrate: int, deadline_ms: float, period_ns: int) -> Spec:
    late = [(REQUEST, 3_600_000.0)] * ceil(LATE_NS / period_ns)  # those that follow at once, when the manager was late
    each = [(REQUEST, period_ns / 1e6), (ANSWER, period_ns / 1e6), *late]
    frames = (f"{{identifier: {one}, bytes: 8, period_ms: {each_ms}}}" for one, each_ms in each)
    return spec(bitrate, deadline_ms, f", foreign: [{', '.join(frames)}]")


def is_punctual(manager: OneManager, spec: Spec) -> bool:
    configuration = manager.core._known.deployment.configuration
    assert configuration is not None
    published = hops(survivors(spec, Situation()), configuration)
    assert published
    return all(one.meets_deadline for one in ResponseTimes(spec).responses(published))


def flying(bitrate: int, deadline_ms: float, more: str = "") -> OneManager:
    manager = OneManager(spec(bitrate, deadline_ms, more), brings_tables=True)
    manager.start()
    return manager


def periods_ns(bitrate: int) -> list[int]:
    return [share * worst_bits(8) * 1_000_000_000 // bitrate for share in SHARES]


@pytest.mark.parametrize(
    ("bitrate", "deadline_ms", "at"), [(1_000_000, 5, 0), (50_000, 50, 0), (45_000, 40, 1), (50_000, 20, len(SHARES))]
)
def test_it_is_the_shortest_period_with_which_no_datum_is_late(bitrate: int, deadline_ms: float, at: int) -> None:
    manager, periods = flying(bitrate, deadline_ms), periods_ns(bitrate)
    is_harmless = [is_punctual(manager, with_frames(bitrate, deadline_ms, one)) for one in periods]
    assert is_harmless == [False] * at + [True] * (len(SHARES) - at)
    found = manager.core._known.bringing._client._pace.period_ns(PE)
    assert found == (periods[at] if at < len(periods) else None)


def test_data_and_transfer_stay_below_the_load_that_the_bus_may_have() -> None:
    manager = flying(1_000_000, 50, ", max_load: 0.11")
    assert manager.core._known.bringing._client._pace.period_ns(PE) == periods_ns(1_000_000)[5]


def test_foreign_frames_count_in_that_load() -> None:
    others = ", foreign: [{identifier: 2000, bytes: 8, period_ms: 0.225}]"  # 135 bits: six tenths; the data need 0.3 %
    manager = flying(1_000_000, 50, others)
    assert manager.core._known.bringing._client._pace.period_ns(PE) == periods_ns(1_000_000)[2]  # 5 %, not 10 % or 20 %


@pytest.mark.parametrize(("checkpoint", "at"), [("", 0), (", checkpoint: {bytes: 360, hz: 2, max_age_ms: 1500}", 1)])
def test_checkpoints_count_in_that_load(checkpoint: str, at: int) -> None:
    text = SPEC_TEXT.replace("{bitrate: 1000000}", "{bitrate: 1000000, max_load: 0.31}")
    text = text.replace("rate_hz: 40}", f"rate_hz: 40{checkpoint}}}", 1)
    manager = OneManager(loads(text, "two_tails.dg.yaml"), brings_tables=True)
    manager.start()
    assert manager.core._known.bringing._client._pace.period_ns(PE) == periods_ns(1_000_000)[at]


def deploy(manager: OneManager) -> None:
    """Let the PEs that live stage and run what is prepared."""
    for pe in manager.running:
        manager.stage(pe)
    for pe in manager.running:
        manager.take(pe, PeState.ACTIVE)
    manager.pass_time(100 * MS)


def has_nothing(manager: OneManager) -> None:
    """Let the PE say that it has nothing of its table."""
    manager.hear(Frame(ANSWER, b"\x4f\x26\x20\x02\x00\x00\x00\x00"))


def open_blocks(manager: OneManager, segments: int) -> None:
    """Let the PE say the same, and then that it takes so many segments in a block."""
    has_nothing(manager)
    manager.hear(Frame(ANSWER, bytes((0xA4, 0x26, 0x20, 0x01, segments, 0, 0, 0))))


def requests(manager: OneManager, for_ns: int) -> int:
    before = len(manager.frames)
    manager.pass_time(for_ns)
    return sum(one.can_id == REQUEST for one in manager.frames[before:])


def test_where_no_period_is_long_enough_the_pe_waits_and_this_is_told() -> None:
    manager = flying(50_000, 20)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    manager.hear(Frame(heartbeat_id(NODE), b"\x7f"))
    assert requests(manager, 900 * MS) == 0
    (told,) = manager.of(events.TableNotTaken)
    assert told.why == "beside what runs the bus has no room for it"


def test_no_segment_goes_out_while_another_configuration_is_on_its_way() -> None:
    manager = flying(1_000_000, 5)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    manager.answer()
    assert manager.core._known.deployment.is_at_rest()
    manager.hear(Frame(heartbeat_id(NODE), b"\x7f"))
    open_blocks(manager, 127)
    assert requests(manager, 20 * MS) > 10
    say(manager, FailElement("device:servo_left"))
    manager.answer()
    assert not manager.core._known.deployment.is_at_rest()
    assert requests(manager, 60 * MS) == 0
    deploy(manager)
    assert requests(manager, 10 * MS) > 5


def test_a_transfer_that_has_no_room_any_more_is_ended_and_a_wait_for_an_answer_goes_on_meanwhile() -> None:
    manager = flying(50_000, 20)
    manager.die(PE)
    manager.pass_time(1_500 * MS)
    manager.answer()
    say(manager, FailElement("module:control"))
    manager.answer()
    deploy(manager)  # nothing crosses the bus
    manager.hear(Frame(heartbeat_id(NODE), b"\x7f"))
    open_blocks(manager, 1)
    say(manager, ClearElement("module:control"))
    manager.answer()
    assert requests(manager, 100 * MS) == 0
    manager.hear(Frame(ANSWER, b"\xa2\x01\x7f\x00\x00\x00\x00\x00"))
    deploy(manager)
    manager.pass_time(500 * MS)
    assert manager.frames[-1].can_id != REQUEST
    assert [one for one in manager.frames if one.can_id == REQUEST][-1].data[0] == 0x80
    assert [told.why for told in manager.of(events.TableNotTaken)] == ["beside what runs the bus has no room for it"]


def test_beyond_a_gateway_the_slowest_bus_and_what_is_left_of_a_radio_give_the_pace() -> None:
    manager = OneManager(load(shipped_spec_path("big_blue")), brings_tables=True)
    pace, radio = manager.core._known.bringing._client._pace, manager.spec.buses["radio"]
    assert [bus.name for bus in pace.way("ground")] == ["can0", "radio"]
    assert pace.period_ns("comms") == periods_ns(1_000_000)[0]
    whole_ns = pace.period_ns("ground")
    assert whole_ns == periods_ns(radio.bitrate)[0]
    (link,) = (port.link_id for port in manager.compiler.table("comms").ports if port.link_id is not None)
    report = LinkReport(manager.spec.pes["comms"].node_id, LinkState.UP, 1, 100, 100, 0, 0)
    manager.live("comms")
    manager.hear(Frame(link, report.encode()))
    assert manager.core.now.limits
    left_ns = pace.period_ns("ground")
    assert left_ns is not None
    assert left_ns > whole_ns


def test_a_pe_to_which_no_way_leads_is_brought_no_table() -> None:
    apart = SPEC_TEXT.replace("bitrate: 1000000}}", "bitrate: 1000000}, can1: {bitrate: 1000000}}").replace(
        "node_id: 94, buses: [can0]", "node_id: 94, buses: [can1]"
    )
    manager = OneManager(loads(apart, "apart.dg.yaml"), brings_tables=True)
    assert manager.core._known.bringing._client._pace.way(PE) == []
    assert not manager.core.hears(heartbeat_id(NODE))
