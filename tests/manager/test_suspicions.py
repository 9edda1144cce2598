"""A module reports a PE or a bus: the manager assesses it by its own evidence, and tells both."""

from heronry_dg.loader import loads
from heronry_manager import events
from heronry_wire.management import Control, ElementKind, Emergency, FaultCode, Operation, Ping
from heronry_wire.protocol_times import CHANNEL_FORGOTTEN_NS
from manager.one_manager import BEAT_NS, SPEC_TEXT, OneManager


def suspect(manager: OneManager, by: str, kind: ElementKind, index: int) -> bool:
    """Report an element; tells whether the report is acknowledged."""
    before = len(manager.commands)
    manager.report(by, Emergency(FaultCode.REPORTED, 0x81, kind, index, 3))
    node = manager.spec.pes[by].node_id
    return Control(manager.core.term, node, Operation.ACKNOWLEDGE, kind, index) in manager.commands[before:]


def flying(text: str | None = None) -> OneManager:
    manager = OneManager() if text is None else OneManager(loads(text, "x.dg.yaml"))
    manager.start()
    return manager


def concluded(manager: OneManager) -> list[tuple[str, str]]:
    return [(told.element, told.found) for told in manager.of(events.SuspicionAssessed)]


def pings(manager: OneManager) -> list[int]:
    return [command.node for command in manager.commands if isinstance(command, Ping)]


def test_a_pe_that_answers_stays_and_both_is_told() -> None:
    manager = flying()
    assert suspect(manager, "left", ElementKind.PE, 1)
    assert pings(manager) == [93]
    manager.beat("middle")
    assert concluded(manager) == [("pe:middle", "it answers, and stays")]
    (told,) = manager.of(events.Suspicion)
    assert (told.element, told.by, told.evidence) == (
        "pe:middle",
        "left",
        "it was heard in time, and is asked",
    )
    assert manager.core.status()["pes"]["middle"]["state"] == "up"
    assert manager.core.status()["latched"] == []


def test_a_repetition_asks_no_more_and_after_a_while_it_is_a_new_suspicion() -> None:
    manager = flying()
    for _ in range(3):
        assert suspect(manager, "left", ElementKind.PE, 1)
        manager.pass_time(CHANNEL_FORGOTTEN_NS // 3)
    assert pings(manager) == [93]
    manager.pass_time(2 * CHANNEL_FORGOTTEN_NS)
    suspect(manager, "left", ElementKind.PE, 1)
    assert pings(manager) == [93, 93]


def test_a_pe_that_is_silent_is_lost_like_any_other() -> None:
    manager = flying()
    manager.die("middle")
    suspect(manager, "left", ElementKind.PE, 1)
    manager.pass_time(5 * BEAT_NS)
    assert concluded(manager) == [("pe:middle", "it does not answer, and is lost")]
    assert suspect(manager, "right", ElementKind.PE, 1)
    assert manager.of(events.Suspicion)[-1].evidence == "it counts as lost already"
    suspect(manager, "right", ElementKind.PE, 1)
    assert len(manager.of(events.Suspicion)) == 2


def test_the_managers_own_bus_stays_since_it_has_carried_the_report() -> None:
    manager = flying()
    for by in (*manager.spec.pes, "left"):
        assert suspect(manager, by, ElementKind.BUS, 0)
    assert len(manager.of(events.Suspicion)) == len(manager.spec.pes), "a repetition is not told again"
    assert set(concluded(manager)) == {("bus:can0", "it stays")}
    assert {told.evidence for told in manager.of(events.Suspicion)} == {"it has carried the report"}


SIDE = SPEC_TEXT.replace("can0: {bitrate: 1000000}", "can0: {bitrate: 1000000}, side: {bitrate: 1000000}")


def with_a_side_bus() -> OneManager:
    """Left and middle are on a second bus, which is on nobody's way to the manager's."""
    text = SIDE.replace("middle: {node_id: 93, buses: [can0]", "middle: {node_id: 93, buses: [side]")
    return flying(text.replace("left:   {node_id: 92, buses: [can0]", "left:   {node_id: 92, buses: [can0, side]"))


def test_a_bus_stays_while_a_pe_is_heard_that_can_be_reached_over_it_alone() -> None:
    manager = with_a_side_bus()
    for by in ("left", "middle"):
        assert suspect(manager, by, ElementKind.BUS, 1)
    assert set(concluded(manager)) == {("bus:side", "it stays")}
    assert manager.of(events.Suspicion)[0].evidence == "pe:middle is heard, which can be reached over it alone"
    assert manager.core.status()["latched"] == []


def test_a_bus_beyond_which_all_are_lost_is_not_latched_so_that_they_may_return() -> None:
    manager = with_a_side_bus()
    manager.die("middle")
    manager.pass_time(5 * BEAT_NS)
    suspect(manager, "left", ElementKind.BUS, 1)
    assert concluded(manager) == [("bus:side", "no plan uses it before a PE behind it is back")]
    assert manager.core.status()["latched"] == []
