"""A link, on a software bus and on a back-end that fails on command."""

import errno
import re
import select
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from threading import Event
from typing import Any

import can
import pytest

from heronry_tools.runtime.softbus.batches import Batches
from heronry_tools.runtime.softbus.starter import start_hub
from heronry_wire import can_interface
from heronry_wire.bus_opening import LinkError, Opened
from heronry_wire.can_interface import CanInterface
from heronry_wire.controller import ControllerState
from heronry_wire.frame import Frame
from heronry_wire.frame_port import Arrival, Haste
from heronry_wire.link import ECHO_TIMEOUT_NS, REOPEN_NS, RETRY_NS, Link
from heronry_wire.slow_opening import SlowOpening

PATIENCE_S = 10.0


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Path]:
    process = start_hub(str(tmp_path / "can0.sock"), 1_000_000)
    yield tmp_path / "can0.sock"
    process.close()


def link_to(hub: Path) -> Link:
    return Link({"interface": "softbus", "channel": str(hub)})


def turn(*links: Link) -> list[Arrival]:
    """One turn of a loop that serves these links; gives the arrivals at the last one."""
    select.select(links, [], [], PATIENCE_S)
    arrivals: list[Arrival] = []
    for link in links:
        arrivals = link.receive(time.monotonic_ns())
    return arrivals


def test_frames_arrive_once_dated_and_own_ones_do_not_come_back(hub: Path) -> None:
    with closing(link_to(hub)) as sender, closing(link_to(hub)) as receiver:
        before_ns = time.monotonic_ns()
        for can_id in range(20):
            sender.send(Frame(can_id, b"x"), time.monotonic_ns())
        arrivals: list[Arrival] = []
        while len(arrivals) < 20:
            arrivals += turn(sender, receiver)
        assert sender.receive(time.monotonic_ns()) == []
        assert [arrival.frame for arrival in arrivals] == [Frame(can_id, b"x") for can_id in range(20)]
        slack_ns = 1_000_000  # two clocks are compared
        assert all(before_ns - slack_ns <= arrival.time_ns <= time.monotonic_ns() for arrival in arrivals)
        assert sender.echoes_lost == 0


@pytest.mark.parametrize("step_ns", [3_600_000_000_000, -3_600_000_000_000])
def test_a_clock_of_the_day_that_is_set_in_flight_ages_no_frame(
    hub: Path, step_ns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with closing(link_to(hub)) as sender, closing(link_to(hub)) as receiver:
        read_day_ns = time.time_ns
        monkeypatch.setattr(time, "time_ns", lambda: read_day_ns() + step_ns)
        before_ns = time.monotonic_ns()
        sender.send(Frame(1, b"x"), before_ns)
        (arrival,) = turn(receiver)
        assert before_ns <= arrival.time_ns <= time.monotonic_ns()


@pytest.mark.parametrize(
    ("one_at_a_time", "order"), [(True, [700, 400, 500, 600]), (False, [400, 500, 600, 700])], ids=["one", "several"]
)
def test_what_waits_goes_out_by_priority(hub: Path, one_at_a_time: bool, order: list[int]) -> None:
    with closing(link_to(hub)) as sender, closing(link_to(hub)) as receiver:
        now_ns = time.monotonic_ns()
        sender.one_at_a_time = one_at_a_time
        for can_id in (700, 500, 600, 400):
            sender.put(Frame(can_id, b""), None)
            if one_at_a_time:
                sender.pump(now_ns)
        sender.pump(now_ns)
        arrivals: list[Arrival] = []
        while len(arrivals) < 4:
            arrivals += turn(sender, receiver)
        assert [arrival.frame.can_id for arrival in arrivals] == order


@pytest.mark.parametrize(("one_at_a_time", "haste"), [(True, Haste.PROMPT), (False, Haste.PATIENT)], ids=["one", "any"])
def test_the_echo_of_a_gateways_frame_is_awaited(
    hub: Path, one_at_a_time: bool, haste: Haste, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[Haste] = []
    send = Batches.send

    def noted(self: Batches, frame: Frame, haste: Haste) -> None:
        said.append(haste)
        send(self, frame, haste)

    monkeypatch.setattr(Batches, "send", noted)
    with closing(link_to(hub)) as sender:
        sender.is_calm, sender.one_at_a_time = True, one_at_a_time
        sender.send(Frame(0x123, bytes(8)), time.monotonic_ns())
    assert said == [haste]


def test_how_long_a_frame_was_in_the_controller_is_known_from_its_echo(hub: Path) -> None:
    with closing(link_to(hub)) as sender:
        sender.send(Frame(0x123, bytes(8)), time.monotonic_ns())
        departures: list[int] = []
        while not departures:
            turn(sender)
            departures = sender.departures_ns()
        assert len(departures) == 1
        assert departures[0] > 100_000, "8 bytes at 1 Mbit/s take more than 100 us"
        assert sender.departures_ns() == []


def test_what_a_gateway_computed_before_it_handed_a_frame_over_is_not_the_time_of_its_radio(hub: Path) -> None:
    turn_ns = 3_600_000_000_000
    with closing(link_to(hub)) as sender:
        sender.one_at_a_time = True
        sender.send(Frame(0x123, bytes(8)), time.monotonic_ns() - turn_ns)
        while not (departures := sender.departures_ns()):
            turn(sender)
        assert 100_000 < departures[0] < turn_ns


def test_what_means_nothing_here_does_not_come_and_echoes_still_do(hub: Path) -> None:
    with closing(link_to(hub)) as sender, closing(link_to(hub)) as receiver:
        receiver.accept({500})
        receiver.send(Frame(700, b"own"), time.monotonic_ns())
        for can_id in (400, 500):
            sender.send(Frame(can_id, b"x"), time.monotonic_ns())
        arrivals: list[Arrival] = []
        while not arrivals or receiver.next_deadline_ns() is not None:
            arrivals += turn(sender, receiver)
            receiver.pump(time.monotonic_ns())
        assert [arrival.frame for arrival in arrivals] == [Frame(500, b"x")]
        assert receiver.echoes_lost == 0


def test_no_hub_is_one_sentence_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="no bus answers there") as caught:
        link_to(tmp_path / "nothing.sock")
    assert "\n" not in str(caught.value)


def test_a_hub_that_goes_is_told_once_and_its_return_as_well(tmp_path: Path) -> None:
    hub = tmp_path / "can0.sock"
    with closing(start_hub(str(hub), 1_000_000)) as first, closing(link_to(hub)) as link:
        link.accept({5})
        first.close()
        now_ns = time.monotonic_ns()
        while link.is_open:
            assert turn(link) == []
        link.send(Frame(5, b"lost"), now_ns)
        link.pump(now_ns + REOPEN_NS)
        (sentence,) = link.health.take_link_events()
        assert sentence.startswith(f"softbus {hub} is lost: ")
        assert link.health.counts["not sent while lost"] == 1
        with closing(start_hub(str(hub), 1_000_000)), closing(link_to(hub)) as other:
            link.pump(now_ns + 3 * REOPEN_NS)
            assert link.is_open
            assert re.fullmatch(r".* is back after 0\.\d s", link.health.take_link_events()[-1])
            link.send(Frame(700, b""), time.monotonic_ns())
            for can_id in (4, 5):
                other.send(Frame(can_id, b"heard"), time.monotonic_ns())
            arrivals: list[Arrival] = []
            while not arrivals or link.next_deadline_ns() is not None:
                arrivals += turn(other, link)
            assert [arrival.frame for arrival in arrivals] == [Frame(5, b"heard")]


def test_an_interface_that_cannot_be_waited_on_is_refused() -> None:
    with pytest.raises(LinkError, match="no file descriptor"):
        Link({"interface": "virtual", "channel": "x"})


def test_an_unknown_interface_is_refused() -> None:
    with pytest.raises(LinkError, match="cannot be opened"):
        Link({"interface": "nonsense", "channel": "x"})


class Stubborn(can.BusABC):
    """A back-end with knobs: what `send` raises, and what has arrived."""

    channel_info = "socketcan of the test"
    current: "Stubborn"
    broken: Exception | None = None  # what every method but `send` raises

    def __init__(self, channel: str, **_: object) -> None:
        super().__init__(channel)
        self.refusals: list[Exception] = []
        self.sent: list[can.Message] = []
        self.arrived: list[can.Message] = []
        Stubborn.current = self

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - python-can's
        if self.refusals:
            raise self.refusals.pop(0)
        self.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        if self.broken is not None:
            raise self.broken
        return (self.arrived.pop(0) if self.arrived else None), True

    def _apply_filters(self, filters: object) -> None:  # noqa: ARG002
        if self.broken is not None:
            raise self.broken

    def fileno(self) -> int:
        return 0


@pytest.fixture
def stubborn(monkeypatch: pytest.MonkeyPatch) -> Iterator[Link]:
    monkeypatch.setattr(can, "Bus", Stubborn)
    with closing(Link({"channel": "x"})) as link:
        yield link


@pytest.mark.parametrize(
    "refusal",
    [
        can.CanOperationError("no room", errno.ENOBUFS),
        can.CanOperationError("Transmit buffer full"),
        BlockingIOError(11, ""),
    ],
)
def test_a_full_controller_is_tried_again_in_the_same_order(stubborn: Link, refusal: Exception) -> None:
    bus = Stubborn.current
    bus.refusals = [refusal]
    stubborn.send(Frame(5, b"first"), 0)
    stubborn.send(Frame(5, b"second"), 0)
    assert stubborn.next_deadline_ns() == RETRY_NS
    stubborn.pump(RETRY_NS)
    bus.arrived = [bus.sent[0]]
    stubborn.receive(RETRY_NS)
    assert [bytes(message.data) for message in bus.sent] == [b"first", b"second"]


def test_any_other_refusal_loses_the_bus_and_what_waits(stubborn: Link) -> None:
    bus = Stubborn.current
    bus.refusals = [can.CanOperationError("Network is down", errno.ENETDOWN)]
    stubborn.send(Frame(5, b""), 0)
    assert (stubborn.is_open, stubborn.health.off_since_ns) == (False, 0)
    assert "x is lost: the interface is down" in stubborn.health.take_link_events()[0]
    stubborn.send(Frame(6, b""), 1)
    assert stubborn.receive(1) == []
    stubborn.pump(REOPEN_NS)
    assert stubborn.is_open
    assert Stubborn.current is not bus
    assert Stubborn.current.sent == []
    assert stubborn.health.counts == {"lost": 1, "not sent while lost": 2}


@pytest.mark.parametrize("when", ["it receives", "it filters"])
def test_a_back_end_that_raises_loses_the_bus_and_nothing_else(stubborn: Link, when: str) -> None:
    bus = Stubborn.current
    bus.broken = OSError(errno.ENODEV, "gone")
    if when == "it receives":
        assert stubborn.receive(0) == []
    else:
        stubborn.accept({5})
    assert not stubborn.is_open
    assert "there is no such interface" in stubborn.health.take_link_events()[0]


def test_whatever_a_back_end_raises_is_not_the_end_of_its_node(stubborn: Link) -> None:
    Stubborn.current.broken = RuntimeError("of a library")
    assert stubborn.receive(0) == []
    assert not stubborn.is_open
    assert "of a library" in stubborn.health.take_link_events()[0]


@pytest.mark.parametrize("noise", [ValueError("invalid literal"), IndexError("string index out of range")])
def test_noise_is_counted_and_what_comes_after_it_is_taken(stubborn: Link, noise: Exception) -> None:
    """The slcan back-end raises where its modem sends an unexpected answer."""
    bus = Stubborn.current
    bus.broken, bus.arrived = noise, [can.Message(timestamp=0.0)]
    assert stubborn.receive(0) == []
    assert stubborn.is_open
    assert stubborn.has_more
    bus.broken = None
    assert len(stubborn.receive(0)) == 1
    assert stubborn.health.counts["not understood"] > 0


@pytest.fixture
def modem(monkeypatch: pytest.MonkeyPatch) -> Iterator[Link]:
    """A back-end that is neither SocketCAN nor the software bus, and has been lost at 0."""
    monkeypatch.setattr(can, "Bus", Stubborn)
    monkeypatch.setattr(Stubborn, "channel_info", "a modem")
    with closing(Link({"interface": "slcan", "channel": "x"})) as link:
        Stubborn.current.broken = OSError(errno.ENODEV, "gone")
        link.receive(0)
        yield link


def pump_until(link: Link, is_done: Callable[[], bool]) -> None:
    """Pump as time passes, for as long as another thread works."""
    while not is_done():
        link.pump(link.next_deadline_ns() or 0)


def test_a_bus_that_takes_long_to_open_holds_nothing_up(modem: Link, monkeypatch: pytest.MonkeyPatch) -> None:
    modem_answers = Event()

    def slowly(**config: Any) -> can.BusABC:
        assert modem_answers.wait(PATIENCE_S)
        return Stubborn(**config)

    monkeypatch.setattr(can, "Bus", slowly)
    for _ in range(3):
        modem.pump(modem.next_deadline_ns() or 0)
        assert not modem.is_open
    modem_answers.set()
    pump_until(modem, lambda: modem.is_open)
    assert "is back after" in modem.health.take_link_events()[-1]
    modem.send(Frame(5, b""), 0)
    assert [message.arbitration_id for message in Stubborn.current.sent] == [5]


def test_a_bus_that_cannot_be_opened_again_is_tried_again(modem: Link, monkeypatch: pytest.MonkeyPatch) -> None:
    tries: list[str] = []

    def refused(**_: Any) -> can.BusABC:
        tries.append("in vain")
        raise can.CanInitializationError("could not open port x")

    monkeypatch.setattr(can, "Bus", refused)
    pump_until(modem, lambda: len(tries) == 2)
    assert not modem.is_open


@pytest.mark.parametrize("when", ["it is open", "it opens", "it cannot be opened"])
def test_a_bus_whose_opening_was_abandoned_is_closed(when: str) -> None:
    is_closed, goes_on = Event(), Event()

    class Late(Stubborn):
        def shutdown(self) -> None:
            super().shutdown()
            is_closed.set()

    def open_late() -> Opened:
        if when != "it is open":
            assert goes_on.wait(PATIENCE_S)
        if when == "it cannot be opened":
            is_closed.set()
            raise RuntimeError("of a library")
        return Opened(Late("x"), 0)

    opening = SlowOpening(open_late)
    while when == "it is open" and opening.result is None:
        pass
    opening.abandon()
    goes_on.set()
    assert is_closed.wait(PATIENCE_S)
    assert opening.result is None


def test_a_bus_that_opens_and_does_not_work_is_refused_at_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can, "Bus", Stubborn)
    monkeypatch.setattr(Stubborn, "broken", can.CanOperationError("Network is down", errno.ENETDOWN))
    with pytest.raises(LinkError, match="x cannot be opened: the interface is down"):
        Link({"channel": "x"})


def test_a_controller_that_is_bus_off_is_off_the_bus(stubborn: Link) -> None:
    bus = Stubborn.current
    stubborn.send(Frame(5, b""), 0)
    bus.arrived = [can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, data=bytes(8))]
    assert stubborn.receive(1) == []
    assert stubborn.health.off_since_ns == 1
    assert "its controller is bus-off" in stubborn.health.take_link_events()[0]
    stubborn.pump(1 + REOPEN_NS)
    assert stubborn.is_open


def test_a_bus_on_which_no_node_acknowledges_is_one_event(stubborn: Link) -> None:
    for can_id in range(25):
        stubborn.send(Frame(can_id, b""), can_id * ECHO_TIMEOUT_NS)
        stubborn.pump(can_id * ECHO_TIMEOUT_NS)
    (sentence,) = stubborn.health.take_link_events()
    assert "no other node acknowledges" in sentence


def test_an_interface_at_another_bit_rate_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    slow = CanInterface("can0", "can", is_can=True, is_up=True, queue_length=10, bitrate=500_000)
    monkeypatch.setattr(can_interface, "read_interface", lambda _: slow)
    with pytest.raises(LinkError, match=r"interface runs at 500000 bit/s, and this bus at 1000000: 'ip link set can0"):
        Link({"interface": "socketcan", "channel": "can0", "bitrate": 1_000_000})


@pytest.mark.parametrize(
    ("restart_ms", "refusal", "says"),
    [
        (100, None, "Linux restarts it after 100 ms"),
        (0, PermissionError(), "can restart-ms 100"),
        (0, None, None),
    ],
)
def test_a_controller_that_is_still_bus_off_is_restarted_where_that_may_be(
    monkeypatch: pytest.MonkeyPatch, restart_ms: int, refusal: Exception | None, says: str | None
) -> None:
    off = CanInterface(
        "can0", "can", is_can=True, is_up=True, queue_length=10, state=ControllerState.BUS_OFF, restart_ms=restart_ms
    )
    restarted: list[str] = []

    def restart(name: str) -> None:
        if refusal is not None:
            raise refusal
        restarted.append(name)

    monkeypatch.setattr(can_interface, "read_interface", lambda _: off)
    monkeypatch.setattr(can_interface, "take_down_and_up", restart)
    with pytest.raises(LinkError) as caught:  # this kernel has no can0, so after all it cannot be opened
        Link({"interface": "socketcan", "channel": "can0"})
    assert (says is None) == (restarted == ["can0"])
    assert says is None or says in str(caught.value)


def test_an_echo_that_does_not_come_is_given_up_and_one_that_comes_late_is_still_ours(stubborn: Link) -> None:
    bus = Stubborn.current
    stubborn.send(Frame(5, b""), 0)
    stubborn.send(Frame(6, b""), 0)
    assert len(bus.sent) == 1
    stubborn.pump(ECHO_TIMEOUT_NS)
    assert (len(bus.sent), stubborn.echoes_lost) == (2, 1)
    bus.arrived = [*bus.sent, can.Message(arbitration_id=7, is_extended_id=False)]
    assert [arrival.frame.can_id for arrival in stubborn.receive(ECHO_TIMEOUT_NS)] == [7]


def test_a_back_end_that_is_not_well_known_is_sent_to_without_echo_and_its_stamps_are_not_trusted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(can, "Bus", Stubborn)
    monkeypatch.setattr(Stubborn, "channel_info", "a bus of its own kind")
    with closing(Link({"channel": "x"})) as link:
        for can_id in (5, 6):
            link.send(Frame(can_id, b""), 0)
        assert [message.arbitration_id for message in Stubborn.current.sent] == [5, 6]
        assert link.departures_ns() == [0, 0], "it is not known when they left the modem behind it"
        Stubborn.current.arrived = [can.Message(timestamp=0.0)]
        assert link.receive(1_000)[0].time_ns == 1_000
        link.be_patient()
        assert not link.is_patient, "a second opening of a modem fails, or takes frames from the first"


def test_a_frame_is_as_old_as_its_stamp_and_never_newer_than_now(stubborn: Link) -> None:
    bus = Stubborn.current
    bus.arrived = [can.Message(timestamp=0.0), can.Message(timestamp=time.time() + 1_000)]
    old, new = stubborn.receive(1_000)
    assert old.time_ns < 0
    assert new.time_ns == 1_000


def test_no_interface_at_all_says_how_to_name_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(can.util, "CONFIG_FILES", [])
    monkeypatch.delenv("CAN_INTERFACE", raising=False)
    with pytest.raises(LinkError, match="give -i INTERFACE"):
        Link({})


def test_a_back_end_that_breaks_while_it_is_opened_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(**_: object) -> can.BusABC:
        raise NameError("a name of its library is not defined")

    monkeypatch.setattr(can, "Bus", broken)
    with pytest.raises(LinkError, match="kvaser 0 cannot be opened: a name of its library is not defined"):
        Link({"interface": "kvaser", "channel": "0"})


def test_what_waited_out_a_pause_does_not_go_out(stubborn: Link) -> None:
    bus = Stubborn.current
    for can_id in (5, 6):
        stubborn.send(Frame(can_id, b""), 0, 1_000)
    bus.arrived = [*bus.sent]
    stubborn.receive(1_001)
    assert [message.arbitration_id for message in bus.sent] == [5]
    assert stubborn.queue.expired == 1


def test_a_link_that_holds_data_back_sends_urgent_frames_first_and_the_rest_afterwards(stubborn: Link) -> None:
    bus = Stubborn.current
    stubborn.stand_back(1_000)
    stubborn.send(Frame(700, b""), 0)
    assert (bus.sent, stubborn.next_deadline_ns()) == ([], 1_000)
    stubborn.send(Frame(5, b""), 10)
    bus.arrived = [*bus.sent]
    stubborn.receive(20)
    assert stubborn.next_deadline_ns() == 1_000
    stubborn.pump(1_000)
    assert [message.arbitration_id for message in bus.sent] == [5, 700]
