"""A gateway at its radio: one frame at a time, at the rate of the usable bandwidth, and its reports to the manager."""

from dataclasses import replace

from agent.one_pe import FAR, GATEWAY_TABLE, MS, NEIGHBOUR, NODE, RATE, RATE_ID, OnePe, neighbour_state, rate_frame
from heronry_agent.core.vocabulary import Action, Left
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.management import Alive, Lease, Prepare, SliceBody, Step
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.state_frames import StatePage0, decode_state
from lab.peers import command_frame

UPLINK, RADIO = 0, 1
LINK_ID = 291
PERIOD_NS = 100 * MS
IMMEDIATE = 1
TABLE = replace(
    GATEWAY_TABLE, ports=(GATEWAY_TABLE.ports[0], replace(GATEWAY_TABLE.ports[1], link_id=LINK_ID, bitrate=112_500))
)
FORWARDS = Slice(forward={RATE: (NEIGHBOUR, 0b10)})


class Gateway(OnePe):
    """A gateway whose radio takes each frame after `frame_ns`; None: it takes none."""

    def __init__(self, frame_ns: int | None = IMMEDIATE) -> None:
        super().__init__(TABLE)
        self.frame_ns = frame_ns
        self.by_radio: list[Send] = []
        self.leaves_ns: int | None = None

    def give(self, event: object) -> list[Action]:
        actions = super().give(event)  # type: ignore[arg-type]  # every event there is
        radio = [action for action in actions if isinstance(action, Send) and action.port == RADIO]
        assert len(radio) <= 1, "one frame at a time"
        if radio:
            assert self.leaves_ns is None, "the one before has not left"
            self.by_radio += radio
            self.leaves_ns = None if self.frame_ns is None else self.now_ns + self.frame_ns
        if self.frame_ns == IMMEDIATE and self.leaves_ns is not None:
            self.leaves_ns = None
            actions = actions + self.give(Left(RADIO, self.frame_ns))
        return actions

    def wait(self, duration_ns: int) -> list[Action]:
        """Let time pass; the radio takes frames meanwhile."""
        end_ns, actions = self.now_ns + duration_ns, []
        while True:
            leaves_ns, due_ns = self.leaves_ns, self.core.next_deadline_ns()
            if min(due_ns, due_ns if leaves_ns is None else leaves_ns) > end_ns:
                break
            if leaves_ns is not None and leaves_ns <= due_ns:
                self.now_ns, self.leaves_ns = leaves_ns, None
                assert self.frame_ns is not None
                actions += self.give(Left(RADIO, self.frame_ns))
            else:
                self.now_ns = max(self.now_ns, due_ns)
                actions += self.give(Tick())
        self.now_ns = end_ns
        return actions

    def beyond(self, sequence: int) -> list[Action]:
        """The far node sends a state frame."""
        page = decode_state(neighbour_state(0, node=FAR).data)
        assert isinstance(page, StatePage0)
        frame = Frame(neighbour_state(0, node=FAR).can_id, replace(page, sequence=sequence % 256).encode())
        return self.hear(frame, port=RADIO)


def test_the_next_frame_goes_when_the_last_one_has_left() -> None:
    pe = Gateway(frame_ns=10 * MS)
    pe.command(Prepare(1, 7, 1007))
    pe.command(Lease(1, 7, Step.PREPARED, 1007), *(SliceBody(FAR, 7, index, b"12345") for index in (1, 2)))
    assert [one.frame for one in pe.by_radio] == [command_frame(Prepare(1, 7, 1007))]
    pe.wait(11 * MS)
    assert pe.by_radio[-1].frame == command_frame(Lease(1, 7, Step.PREPARED, 1007)), "the more urgent one first"


def test_frames_of_29_bits_on_the_radio_are_not_measured() -> None:
    pe = Gateway()
    assert pe.give(Received(RADIO, Frame(330, bytes(8), extended=True))) == []
    assert pe.core.radio_ports == {RADIO}


def test_what_the_driver_would_drop_is_not_handed_over() -> None:
    pe = Gateway(frame_ns=None)
    pe.command(Lease(1, 0, Step.PREPARED, 0))
    pe.now_ns += 1 * MS
    pe.command(Alive(1, 0, frozenset({NODE})), Prepare(1, 7, 1007))
    pe.wait(100 * MS)  # the LEASE is given up, and 1 ms of the ALIVE is left
    assert [one.frame for one in pe.by_radio[1:]] == [command_frame(Prepare(1, 7, 1007))]


def test_a_frame_that_leaves_after_it_was_given_up_changes_nothing() -> None:
    pe = Gateway()
    pe.wait(10 * MS)
    count = len(pe.by_radio)
    pe.give(Left(RADIO, 500 * MS))
    assert len(pe.by_radio) == count
    assert pe.core.next_deadline_ns() > pe.now_ns


def test_what_waits_of_a_producer_does_not_reach_the_radio_when_the_new_one_is_beyond_it() -> None:
    pe = Gateway(frame_ns=None)
    pe.configure(FORWARDS, 7)
    pe.hear(rate_frame(1.0), port=UPLINK)
    pe.configure(Slice(forward={RATE: (FAR, 0b01)}), 8)
    handed = len(pe.by_radio)
    pe.frame_ns = IMMEDIATE
    pe.leaves_ns = pe.now_ns
    pe.wait(5 * PERIOD_NS)
    assert RATE_ID not in {one.frame.can_id for one in pe.by_radio[handed:]}
