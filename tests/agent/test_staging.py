"""What a PE stages, in whatever order the frames come, and what it says when it cannot."""

import itertools
from base64 import b64encode
from dataclasses import replace

import pytest

from agent.one_pe import CONTROL, FLYING, NODE, RUN_CONTROL, RUN_SERVO_1, TABLE, OnePe, pages, slice_messages, started
from heronry_wire.configuration_slice import ModuleSlice, Slice, slice_digest
from heronry_wire.contingency_block import Preloaded, write_block
from heronry_wire.management import Activate, Prepare, SliceBody, SliceHead, Step
from heronry_wire.pe_table import PeTable, TableError
from heronry_wire.sansio import StandBack
from heronry_wire.state_frames import PeState, Reason, StatePage1

EPOCH, DIGEST = 7, 1007


def last_page_1(pe: OnePe) -> StatePage1:
    return pe.ask()[1]


def test_a_slice_is_staged_and_told_at_once() -> None:
    pe = OnePe()
    actions = pe.command(*slice_messages(FLYING, EPOCH, DIGEST))
    final = pages(actions)[-1]
    assert isinstance(final, StatePage1)
    assert (final.staged_epoch, final.staged_digest, final.reason) == (EPOCH, DIGEST, Reason.NONE)
    assert final.state is PeState.UNCONFIGURED


def test_a_head_whose_body_does_not_follow_is_answered_incomplete_after_half_a_period() -> None:
    pe = OnePe()
    prepare, head, *_ = slice_messages(FLYING, EPOCH, DIGEST)
    assert pages(pe.command(prepare, head)) == []
    assert Reason.INCOMPLETE in [
        page.reason for page in pages(pe.pass_time(11_000_000)) if isinstance(page, StatePage1)
    ]


def test_the_frames_of_a_slice_come_in_any_order_and_doubled() -> None:
    prepare, *rest = slice_messages(FLYING, EPOCH, DIGEST)
    assert len(rest) >= 4
    for order in itertools.permutations(rest):
        pe = OnePe()
        pe.command(prepare, *order, *order)
        assert last_page_1(pe).staged_digest == DIGEST


def test_a_lost_body_frame_is_asked_for_when_the_others_have_stopped_coming() -> None:
    pe = OnePe()
    prepare, head, *bodies = slice_messages(FLYING, EPOCH, DIGEST)
    pe.command(prepare, head, *bodies[1:])
    answers = [page for page in pages(pe.pass_time(11_000_000)) if isinstance(page, StatePage1)]
    assert Reason.INCOMPLETE in [page.reason for page in answers]
    pe.command(bodies[0])
    assert last_page_1(pe).staged_digest == DIGEST


def test_bytes_without_the_digest_announced_are_refused_and_can_be_sent_again() -> None:
    pe = OnePe()
    messages = slice_messages(FLYING, EPOCH, DIGEST)
    pe.command(*messages[:-1], SliceBody(NODE, EPOCH, len(messages) - 2, b"\xff" * 5))
    assert last_page_1(pe).reason is Reason.DIGEST
    pe.command(*messages[1:])
    assert last_page_1(pe).staged_digest == DIGEST


@pytest.mark.parametrize(
    "impossible",
    [
        Slice((ModuleSlice(1, 0, (2,)),), remote={2: 92}),  # the leaf wants a rate, and the source is an alarm
        Slice((RUN_CONTROL,)),  # the rate comes from nobody
        Slice((RUN_CONTROL,), remote={0: 93}),  # from this PE itself, which does not give it
        Slice((RUN_CONTROL,), remote={0: 12}),  # from a node that is no PE
        Slice(publish={1: 1}),  # publishes what no module here gives
        Slice((RUN_CONTROL,), remote={0: 92}, publish={1: 2}),  # on a bus it does not have
        Slice((RUN_SERVO_1, RUN_SERVO_1), remote={1: 92}),  # twice the same module
        Slice(remote={99: 92}),
        Slice(forward={99: (92, 1)}),
    ],
)
def test_a_slice_that_does_not_fit_the_table_is_refused(impossible: Slice) -> None:
    pe = OnePe()
    pe.command(*slice_messages(impossible, EPOCH, DIGEST))
    page = last_page_1(pe)
    assert (page.reason, page.staged_epoch, page.staged_digest) == (Reason.UNKNOWN_INDEX, EPOCH, 0)


def test_a_module_that_the_table_does_not_have_is_refused() -> None:
    pe = OnePe()
    pe.command(*slice_messages(Slice((ModuleSlice(50, 0, ()),)), EPOCH, DIGEST))
    assert last_page_1(pe).reason is Reason.UNKNOWN_INDEX


def test_a_slice_longer_than_frames_can_carry_is_refused() -> None:
    pe = OnePe()
    pe.command(Prepare(1, EPOCH, DIGEST), SliceHead(NODE, EPOCH, 1276, 5))
    assert last_page_1(pe).reason is Reason.UNKNOWN_INDEX


def test_an_image_that_is_not_here_is_refused_before_anything_is_stopped() -> None:
    pe = OnePe(missing_images=frozenset({"servo"}))
    pe.command(*slice_messages(FLYING, EPOCH, DIGEST))
    assert last_page_1(pe).reason is Reason.IMAGE
    assert pe.command(Activate(1, EPOCH, Step.GO_ALL, DIGEST)) == []


def with_contingencies(*slices: Slice) -> PeTable:
    """The table with these on board; the digest of the configuration of number n is n."""
    block = write_block([Preloaded(one.encode(), number) for number, one in enumerate(slices, start=1)])
    return replace(TABLE, contingencies=b64encode(block).decode())


def test_a_contingency_on_board_is_staged_by_its_number_alone() -> None:
    pe = OnePe(with_contingencies(Slice(), FLYING))
    (answer,) = pages(pe.command(Prepare(1, EPOCH, 2, contingency=2)))
    assert isinstance(answer, StatePage1)
    assert (answer.staged_epoch, answer.staged_digest, answer.reason) == (EPOCH, 2, Reason.NONE)
    assert started(pe.command(Activate(1, EPOCH, Step.GO, 2))) == [CONTROL]
    assert pages(pe.command(Prepare(1, EPOCH, 2, contingency=2))) != []  # doubled: it is answered again


def test_while_a_contingency_is_called_data_stand_back_once() -> None:
    pe = OnePe(with_contingencies(Slice(), FLYING))
    actions = pe.command(Prepare(1, EPOCH, 2, contingency=2))
    (stands_back,) = [action for action in actions if isinstance(action, StandBack)]
    answers_ns = 3 * 3 * 135 * 1000  # three frames of each of three PEs at 1 Mbit/s
    assert answers_ns < stands_back.until_ns - pe.now_ns < 2 * answers_ns
    again = pe.command(Prepare(1, EPOCH, 2, contingency=2), *slice_messages(FLYING, EPOCH + 1, DIGEST))
    assert not [action for action in again if isinstance(action, StandBack)]


def test_a_contingency_that_is_not_on_board_is_asked_for_and_comes_in_slices() -> None:
    pe = OnePe(with_contingencies(Slice(), FLYING))
    for _ in range(2):  # the answer may be lost, and the question doubled
        (answer,) = pages(pe.command(Prepare(1, EPOCH, DIGEST, contingency=3)))
        assert isinstance(answer, StatePage1)
        assert (answer.staged_epoch, answer.staged_digest, answer.reason) == (EPOCH, 0, Reason.NOT_ON_BOARD)
    pe.command(*slice_messages(FLYING, EPOCH, DIGEST)[1:])
    assert last_page_1(pe).staged_digest == DIGEST


def test_a_number_that_means_another_configuration_here_stages_nothing() -> None:
    pe = OnePe(with_contingencies(FLYING))
    pe.command(Prepare(1, EPOCH, 2, contingency=1))
    assert (last_page_1(pe).reason, last_page_1(pe).staged_digest) == (Reason.NOT_ON_BOARD, 0)


def test_a_contingency_whose_image_is_not_here_is_refused() -> None:
    pe = OnePe(with_contingencies(FLYING), missing_images=frozenset({"servo"}))
    pe.command(Prepare(1, EPOCH, 1, contingency=1))
    assert (last_page_1(pe).staged_epoch, last_page_1(pe).reason) == (EPOCH, Reason.IMAGE)


@pytest.mark.parametrize(
    "contingencies", ["no base64", "AAA", "gICA", b64encode(write_block([Preloaded(b"\x09", 1)])).decode()]
)
def test_a_table_whose_contingencies_cannot_be_read_is_refused(contingencies: str) -> None:
    with pytest.raises(TableError, match=r"contingenc.*write the table anew"):
        OnePe(replace(TABLE, contingencies=contingencies))


def test_the_slice_that_already_runs_is_staged_without_its_body() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    body = FLYING.encode()
    head = SliceHead(NODE, 8, len(body), slice_digest("00" * 32, body))
    (answer,) = pages(pe.command(Prepare(1, 8, 555), head))
    assert isinstance(answer, StatePage1)
    assert (answer.staged_epoch, answer.staged_digest) == (8, 555)
    actions = pe.command(Activate(1, 8, Step.GO_ALL, 555))
    assert not started(actions)
    assert pe.ask()[0].epoch == 8


def test_an_empty_slice_stops_everything() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.command(*slice_messages(Slice(), 8, 555), Activate(1, 8, Step.GO_ALL, 555))
    assert pe.running == {}
    assert pe.ask()[0].state is PeState.ACTIVE


def test_an_empty_slice_of_another_spec_stops_nothing() -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    head = SliceHead(NODE, 8, 0, slice_digest("11" * 32, b""))
    pe.command(Prepare(1, 8, 555), head, Activate(1, 8, Step.GO_ALL, 555))
    assert last_page_1(pe).reason is Reason.DIGEST
    assert pe.running != {}


def test_what_is_staged_is_answered_again_and_stays_what_it_is() -> None:
    pe = OnePe()
    messages = slice_messages(FLYING, EPOCH, DIGEST)
    pe.command(*messages)
    for again in messages[:2]:
        (answer,) = pages(pe.command(again))
        assert isinstance(answer, StatePage1)
        assert answer.staged_epoch == EPOCH
    pe.command(Activate(1, EPOCH, Step.GO_ALL, DIGEST))
    (answer,) = pages(pe.command(messages[0]))
    assert isinstance(answer, StatePage1)
    assert (answer.staged_epoch, answer.reason) == (EPOCH, Reason.NONE)


def test_a_newer_epoch_replaces_the_staged_one() -> None:
    pe = OnePe()
    pe.command(*slice_messages(FLYING, 7, 1007), Prepare(1, 8, 1008))
    assert pe.command(Activate(1, 7, Step.GO_ALL, 1007)) == []
    assert (last_page_1(pe).staged_epoch, last_page_1(pe).staged_digest) == (8, 0)


@pytest.mark.parametrize(("epoch", "digest"), [(6, 1006), (7, 999), (0, 0)])
def test_an_epoch_that_is_not_newer_than_the_running_one_is_refused(epoch: int, digest: int) -> None:
    pe = OnePe()
    pe.configure(FLYING, 7)
    pe.command(Prepare(1, epoch, digest))
    assert last_page_1(pe).reason is Reason.STALE_EPOCH


def test_a_late_prepare_does_not_undo_a_later_one_of_the_same_reign() -> None:
    pe = OnePe()
    pe.command(*slice_messages(FLYING, 8, 1008), Prepare(1, 7, 1007))
    assert last_page_1(pe).staged_epoch == 8
    pe.command(Prepare(2, 7, 1007))
    assert last_page_1(pe).staged_digest == 0


def test_epochs_wrap_round() -> None:
    pe = OnePe()
    pe.configure(FLYING, 0xFFFF)
    pe.configure(Slice(), 1)
    assert pe.ask()[0].epoch == 1


def test_frames_for_other_nodes_and_of_other_epochs_stage_nothing() -> None:
    pe = OnePe()
    prepare, *rest = slice_messages(FLYING, EPOCH, DIGEST)
    others = [
        SliceHead(92, 7, m.length, m.digest) if isinstance(m, SliceHead) else SliceBody(92, 7, 1, b"") for m in rest
    ]
    assert pages(pe.command(prepare, *others)) == []
    stale = [SliceBody(NODE, 6, m.index, m.body) for m in rest if isinstance(m, SliceBody)]
    pe.command(rest[0], *stale)
    assert last_page_1(pe).staged_digest == 0


def test_another_head_of_the_same_epoch_begins_the_body_anew() -> None:
    pe = OnePe()
    prepare, head, *bodies = slice_messages(FLYING, EPOCH, DIGEST)
    assert isinstance(head, SliceHead)
    pe.command(prepare, replace(head, digest=head.digest ^ 1), *bodies[:-1])
    pe.command(head, bodies[-1])
    assert last_page_1(pe).staged_digest == 0
    pe.command(*bodies)
    assert last_page_1(pe).staged_digest == DIGEST


def test_a_leaf_may_be_wired_to_nobody() -> None:
    pe = OnePe()
    pe.command(*slice_messages(Slice((ModuleSlice(CONTROL, 0, (None,)),)), EPOCH, DIGEST))
    assert last_page_1(pe).staged_digest == DIGEST
    assert started(pe.command(Activate(1, EPOCH, Step.GO_ALL, DIGEST))) == [CONTROL]
