"""The one way onto a bus, on a software bus and on a back-end that fails as it is told."""

import errno
import select
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import can
import pytest

from heronry_tools.softbus.starter import start_hub
from heronry_wire.frame import Frame
from heronry_wire.link import ECHO_TIMEOUT_NS, RETRY_NS, Arrival, Link, LinkError

PATIENCE_S = 10.0


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Path]:
    process = start_hub(str(tmp_path / "can0.sock"), 1_000_000)
    yield tmp_path / "can0.sock"
    process.close()


def link_to(hub: Path) -> Link:
    return Link({"interface": "softbus", "channel": str(hub)})


def turn(*links: Link) -> list[Arrival]:
    """One turn of a loop that serves these links; what arrives at the last one is given."""
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


def test_what_waits_goes_out_by_priority(hub: Path) -> None:
    with closing(link_to(hub)) as sender, closing(link_to(hub)) as receiver:
        now_ns = time.monotonic_ns()
        for can_id in (700, 500, 600, 400):
            sender.send(Frame(can_id, b""), now_ns)
        arrivals: list[Arrival] = []
        while len(arrivals) < 4:
            arrivals += turn(sender, receiver)
        assert [arrival.frame.can_id for arrival in arrivals] == [700, 400, 500, 600]


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
    with pytest.raises(LinkError, match="no hub answers there") as caught:
        link_to(tmp_path / "nothing.sock")
    assert "\n" not in str(caught.value)


def test_a_hub_that_goes_is_one_sentence(tmp_path: Path) -> None:
    process = start_hub(str(tmp_path / "can0.sock"), 1_000_000)
    with closing(link_to(tmp_path / "can0.sock")) as link:
        process.close()
        with pytest.raises(LinkError, match="is lost"):
            turn(link)


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
        return (self.arrived.pop(0) if self.arrived else None), True

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


def test_any_other_refusal_is_the_end_of_the_link(stubborn: Link) -> None:
    Stubborn.current.refusals = [can.CanOperationError("Network is down", errno.ENETDOWN)]
    with pytest.raises(LinkError, match="the interface is down"):
        stubborn.send(Frame(5, b""), 0)


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
        Stubborn.current.arrived = [can.Message(timestamp=0.0)]
        assert link.receive(1_000)[0].time_ns == 1_000


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
