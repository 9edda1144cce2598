"""The oracle of replicated buses: it finds nodes that take a frame twice or not at all, and false reports."""

import pytest

from heronry_tools.sim.oracles.channels import ChannelCheck
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.first_copies import REMEMBERED_NS, FirstCopies
from heronry_tools.sim.world.replicated_port import Copy
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import ElementKind, Emergency, FaultCode
from scenarios.flights import MS, flying, twin_wires

LEASE = Frame(200, b"lease")
LOST = Emergency(FaultCode.CHANNEL_LOST, 0, ElementKind.CHANNEL, 0, 2)
AT_NS = 5_000 * MS


def found(*copies: tuple[int, Frame, bool]) -> list[str]:
    """Violations by copies, each with its channel and whether `front` took it."""
    check = ChannelCheck(twin_wires())
    for channel, frame, is_taken in copies:
        check.copied(Copy(AT_NS, "front", "can0", channel, frame, is_taken))
    return [violation.story for violation in check.violations]


def test_a_sending_that_is_taken_once_is_right_whichever_channel_brings_it_and_however_often() -> None:
    again = Frame(*LEASE)
    assert found((0, LEASE, True), (1, LEASE, False), (1, again, True), (0, again, False)) == []
    assert found((0, LEASE, False), (1, LEASE, True)) == []
    assert found((0, LEASE, True), (0, LEASE, True), (1, LEASE, False)) == [], "a controller may bring it twice"


def test_a_sending_that_is_taken_twice_or_not_at_all_though_both_channels_brought_it_is_wrong() -> None:
    assert found((0, LEASE, True), (1, LEASE, True)) == ["front took 0C8#6C65617365 2 times on can0"]
    (story,) = found((0, LEASE, False), (1, LEASE, False))
    assert story == "front did not take 0C8#6C65617365, which both channels brought on can0"


def test_one_of_two_equal_sendings_may_be_taken_for_the_other() -> None:
    first, second = (Frame(LEASE.can_id, LEASE.data) for _ in range(2))
    assert found((1, first, False), (0, second, True), (1, second, True)) == []
    assert found((0, first, False), (0, second, True), (1, second, True), (1, second, True)) != []


def signs(check: ChannelCheck, channels: tuple[int, ...], from_ms: int, to_ms: int) -> None:
    for at_ms in range(from_ms, to_ms, 20):
        for channel in channels:
            frame = Frame(260, bytes([channel]))
            check.copied(Copy(at_ms * MS, "front", "can0", channel, frame, is_taken=True))
            check.carried(channel, Sent(at_ms * MS, "can0", "front", frame))


@pytest.mark.parametrize(("silent_ms", "is_right"), [(0, False), (50, False), (70, True)])
def test_a_pe_that_reports_a_channel_must_have_lost_it(silent_ms: int, is_right: bool) -> None:
    check = ChannelCheck(twin_wires())
    signs(check, (0, 1), 0, 4000)
    report = Sent((3980 + silent_ms) * MS, "can0", "front", Frame(emcy_id(92), LOST.encode()))
    check.emergency(report, "front", LOST)
    assert (check.violations == []) == is_right


def test_a_report_may_last_as_long_as_the_hold_down_and_a_repetition_and_no_longer() -> None:
    check = ChannelCheck(twin_wires())
    signs(check, (0, 1), 0, 1000)
    signs(check, (0,), 1000, 2000)
    signs(check, (0, 1), 2000, 4000)
    for at_ms in (2100, 3250, 3300):
        check.emergency(Sent(at_ms * MS, "can0", "front", Frame(emcy_id(92), LOST.encode())), "front", LOST)
    assert [violation.t_ns // MS for violation in check.violations] == [3300]


def test_other_emergencies_are_not_verified_by_it() -> None:
    check = ChannelCheck(twin_wires())
    sent = Sent(AT_NS, "can0", "front", Frame(emcy_id(92), LOST.encode()))
    for emergency in (
        Emergency(FaultCode.REPORTED, 0, ElementKind.DEVICE, 0, 0),
        Emergency(FaultCode.CHANNEL_BACK, 0, ElementKind.CHANNEL, 0, 2),
    ):
        check.emergency(sent, "front", emergency)
    assert check.violations == []


def test_in_a_flight_false_reports_and_doubled_sendings_are_found() -> None:
    simulation = flying(twin_wires())
    simulation.run_for(2_000 * MS)
    simulation.checks.see(Sent(simulation.now_ns, "can0", "front", Frame(emcy_id(92), LOST.encode())))
    simulation.checks.copied(Copy(simulation.now_ns, "front", "can0", 0, LEASE, is_taken=True))
    simulation.checks.copied(Copy(simulation.now_ns, "front", "can0", 1, LEASE, is_taken=True))
    assert [violation.rule for violation in simulation.broken()] == ["channels", "copies"]


def test_a_tap_sees_each_sending_once_and_forgets_it() -> None:
    first, seen = FirstCopies(), list[Sent]()
    first.taps.append(seen.append)
    again = Frame(*LEASE)
    for at_ns, frame in ((1, LEASE), (2, LEASE), (3, again), (REMEMBERED_NS + 2, LEASE), (REMEMBERED_NS + 3, again)):
        first.see(Sent(at_ns, "can0", "front", frame))
    assert [sent.end_ns for sent in seen] == [1, 3, REMEMBERED_NS + 2]
