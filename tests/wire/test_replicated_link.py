"""One node on a replicated bus: on two software buses, and on back-ends that fail on command."""

import select
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import can
import pytest

from heronry_tools.runtime.softbus.starter import start_hub
from heronry_wire.bus_opening import LinkError
from heronry_wire.channel_merge import latest_copy_ns
from heronry_wire.frame import Frame
from heronry_wire.link import ECHO_TIMEOUT_NS, REOPEN_NS, Link
from heronry_wire.replicated_link import AnyLink, ReplicatedLink, open_link

PATIENCE_S = 10.0
BEAT_NS = 20_000_000
SLOW_BEAT_NS = 20_000_000_000  # for real processes: copies are recognized even if they run late
LEASE, DATUM = Frame(200, b"lease"), Frame(300, b"datum")
BUS_OFF = can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False, data=bytes(8))


def turn(*links: AnyLink) -> list[list[Frame]]:
    """One turn of a loop that serves these links; gives what has arrived at each."""
    ready, _, _ = select.select([reader for link in links for reader in link.readers], [], [], PATIENCE_S)
    assert ready
    return [[arrival.frame for arrival in link.receive(time.monotonic_ns())] for link in links]


@pytest.fixture
def hubs(tmp_path: Path) -> Iterator[list[dict[str, str]]]:
    places = [tmp_path / "can0.sock", tmp_path / "can1.sock"]
    processes = [start_hub(str(place), 1_000_000) for place in places]
    yield [{"interface": "softbus", "channel": str(place)} for place in places]
    for process in processes:
        process.close()


def test_each_frame_arrives_once_on_two_buses_and_own_ones_do_not_come_back(hubs: list[dict[str, str]]) -> None:
    with (
        closing(ReplicatedLink(hubs, SLOW_BEAT_NS, 3)) as sender,
        closing(open_link(hubs, SLOW_BEAT_NS, 3)) as receiver,
        closing(Link(hubs[1])) as witness,
    ):
        receiver.accept(range(20))
        sent = [Frame(can_id, b"x") for can_id in range(20)] + [Frame(3, b"x")]
        for frame in sent:
            sender.send(frame, time.monotonic_ns())
        heard: list[list[Frame]] = [[], [], []]
        while len(heard[1]) < 21 or len(heard[2]) < 21 or not all(link.all_left for link in sender.links):
            for kept, new in zip(heard, turn(sender, receiver, witness), strict=True):
                kept.extend(new)
        assert heard[0] == []
        assert sorted(heard[1]) == sorted(sent)
        assert sorted(heard[2]) == sorted(sent), "both channels carry all of it"
        assert sender.nothing_waits
        assert len(sender.departures_ns()) == 21


def test_a_bus_with_one_channel_is_a_plain_link(hubs: list[dict[str, str]]) -> None:
    with closing(open_link(hubs[:1], BEAT_NS, 3)) as link:
        assert type(link) is Link


class Channel(can.BusABC):
    """A back-end with knobs, by the name of its channel."""

    channel_info = "socketcan of the test"
    open: dict[str, "Channel"]
    gone: set[str]

    def __init__(self, channel: str, **_: object) -> None:
        super().__init__(channel)
        if channel in self.gone:
            raise OSError(f"{channel} is not there")
        self.sent: list[can.Message] = []
        self.arrived: list[can.Message] = []
        self.open[channel] = self

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - python-can's
        self.sent.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        return (self.arrived.pop(0) if self.arrived else None), True

    def _apply_filters(self, filters: object) -> None:
        """Take in everything."""

    def fileno(self) -> int:
        return 0

    def echo(self) -> None:
        """Let the frame that was sent last be on the bus."""
        self.arrived.append(self.sent[-1])

    def bring(self, frame: Frame, at_ns: int) -> None:
        """Let a frame of another node arrive at a time of the wall clock."""
        message = can.Message(arbitration_id=frame.can_id, is_extended_id=False, data=frame.data, timestamp=at_ns / 1e9)
        self.arrived.append(message)


@pytest.fixture
def twin(monkeypatch: pytest.MonkeyPatch) -> Iterator[ReplicatedLink]:
    monkeypatch.setattr(can, "Bus", Channel)
    monkeypatch.setattr(Channel, "open", {}, raising=False)
    monkeypatch.setattr(Channel, "gone", set(), raising=False)
    with closing(ReplicatedLink([{"channel": "a"}, {"channel": "b"}], BEAT_NS, 3)) as link:
        yield link


def messages(name: str) -> list[bytes]:
    return [bytes(message.data) for message in Channel.open[name].sent]


def test_a_copy_that_lags_behind_its_first_is_dropped_and_what_is_newer_follows(twin: ReplicatedLink) -> None:
    twin.send(DATUM, 0)
    twin.send(LEASE, 0)
    for now_ns in (1, 2):
        Channel.open["a"].echo()
        twin.receive(now_ns)
    assert (messages("a"), messages("b")) == ([b"datum", b"lease"], [b"datum"])
    late_ns = 2 + latest_copy_ns(BEAT_NS) + 1
    twin.send(Frame(400, b"newer"), late_ns)
    Channel.open["b"].echo()
    twin.receive(late_ns)
    assert messages("b") == [b"datum", b"newer"]
    assert twin.links[1].queue.expired == 1


def test_a_waiting_frame_is_withdrawn_on_both_channels(twin: ReplicatedLink) -> None:
    twin.send(DATUM, 0)
    twin.send(LEASE, 0)
    assert not twin.nothing_waits
    twin.withdraw(frozenset({LEASE.can_id}))
    assert twin.nothing_waits
    assert not twin.all_left


def test_data_are_held_back_on_both_channels(twin: ReplicatedLink) -> None:
    twin.stand_back(1_000)
    twin.send(DATUM, 0)
    twin.send(LEASE, 0)
    assert (messages("a"), messages("b")) == ([b"lease"], [b"lease"])


def test_a_channel_that_goes_costs_nothing_and_comes_back_by_itself(twin: ReplicatedLink) -> None:
    assert twin.is_open
    Channel.open["b"].arrived.append(BUS_OFF)
    Channel.gone.add("b")
    twin.receive(5)
    assert twin.off_since_ns is None
    assert [link.name for link in twin.readers] == [twin.links[0].name]
    assert "b is lost: its controller is bus-off" in twin.take_link_events()[0]
    twin.send(LEASE, 6)
    Channel.open["a"].echo()
    twin.receive(7)
    assert (messages("a"), messages("b"), twin.departures_ns()) == ([b"lease"], [], [1])
    assert twin.all_left
    Channel.gone.clear()
    assert twin.next_deadline_ns() == 5 + REOPEN_NS
    twin.pump(5 + REOPEN_NS)
    assert len(twin.readers) == 2
    assert "b is back" in twin.take_link_events()[-1]


def test_the_bus_is_lost_since_its_second_channel_went_and_back_with_either(twin: ReplicatedLink) -> None:
    Channel.gone |= {"a", "b"}
    for now_ns, name in ((5, "b"), (9, "a")):
        Channel.open[name].arrived.append(BUS_OFF)
        twin.receive(now_ns)
    assert (twin.off_since_ns, twin.is_open, twin.nothing_waits) == (9, False, True)
    twin.send(LEASE, 10)
    assert twin.departures_ns() == [0], "it has left the queue, for a caller that waits for it"
    Channel.gone.remove("a")
    twin.pump(9 + REOPEN_NS)
    assert twin.off_since_ns is None


def test_at_the_start_one_channel_may_be_missing_and_not_both(
    twin: ReplicatedLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin.close()
    monkeypatch.setattr(Channel, "gone", {"a"})
    with closing(ReplicatedLink([{"channel": "a"}, {"channel": "b"}], BEAT_NS, 3)) as one:
        assert "a is not there; it is tried again until it is back" in one.take_link_events()[0]
    monkeypatch.setattr(Channel, "gone", {"a", "b"})
    with pytest.raises(LinkError, match=r"a cannot be opened: a is not there; .* b cannot be opened: b is not there"):
        ReplicatedLink([{"channel": "a"}, {"channel": "b"}], BEAT_NS, 3)


def test_a_channel_that_brings_nothing_is_told_of_and_one_that_lets_nothing_out(twin: ReplicatedLink) -> None:
    begun_ns, wall_ns = time.monotonic_ns(), time.time_ns()
    for beat in range(6):
        Channel.open["a"].bring(Frame(260, bytes([beat])), wall_ns + beat * BEAT_NS)
    assert len(twin.receive(begun_ns + 6 * BEAT_NS)) == 6
    assert twin.lost_channels(begun_ns + 6 * BEAT_NS) == {2}


def test_what_both_bring_is_taken_in_the_order_in_which_it_came(twin: ReplicatedLink) -> None:
    wall_ns = time.time_ns() - 1_000_000_000
    Channel.open["a"].bring(LEASE, wall_ns + 2_000_000)
    for frame, later_ns in ((DATUM, 1_000_000), (LEASE, 3_000_000)):
        Channel.open["b"].bring(frame, wall_ns + later_ns)
    assert [arrival.frame for arrival in twin.receive(time.monotonic_ns())] == [DATUM, LEASE]
    assert twin.merge.copies == 1


def test_a_back_end_that_echoes_nothing_is_sent_to_without(
    twin: ReplicatedLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    twin.close()
    monkeypatch.setattr(Channel, "channel_info", "a bus of its own kind")
    with closing(ReplicatedLink([{"channel": "a"}, {"channel": "b"}], BEAT_NS, 3)) as link:
        link.send(LEASE, 0)
        link.send(LEASE, ECHO_TIMEOUT_NS)
        assert (messages("a"), messages("b")) == ([b"lease"] * 2, [b"lease"] * 2)
        assert link.departures_ns() == [0, 0]
