"""What a PE stages, with its frames in any order, and what it reports when it cannot."""

import itertools
from base64 import b64encode
from dataclasses import replace

import pytest

from agent.one_pe import FLYING, RUN_SERVO_1, RUN_SERVO_2, SERVO_2, TABLE, OnePe, pages, slice_messages
from heronry_wire.configuration_slice import Slice
from heronry_wire.contingency_block import Preloaded, write_block
from heronry_wire.pe_table import TableError
from heronry_wire.state_frames import PeState, Reason, StatePage1

EPOCH, DIGEST = 7, 1007


def last_page_1(pe: OnePe) -> StatePage1:
    return pe.ask()[1]


def test_a_slice_is_staged_and_reported_immediately() -> None:
    pe = OnePe()
    actions = pe.command(*slice_messages(FLYING, EPOCH, DIGEST))
    final = pages(actions)[-1]
    assert isinstance(final, StatePage1)
    assert (final.staged_epoch, final.staged_digest, final.reason) == (EPOCH, DIGEST, Reason.NONE)
    assert final.state is PeState.UNCONFIGURED


def test_the_frames_of_a_slice_come_in_any_order_and_doubled() -> None:
    prepare, *rest = slice_messages(FLYING, EPOCH, DIGEST)
    assert len(rest) >= 4
    for order in itertools.permutations(rest):
        pe = OnePe()
        pe.command(prepare, *order, *order)
        assert last_page_1(pe).staged_digest == DIGEST


@pytest.mark.parametrize(
    "contingencies", ["no base64", "AAA", "gICA", b64encode(write_block([Preloaded(b"\x09", 1)])).decode()]
)
def test_a_table_whose_contingencies_cannot_be_read_is_refused(contingencies: str) -> None:
    with pytest.raises(TableError, match=r"contingenc.*write the table anew"):
        OnePe(replace(TABLE, contingencies=contingencies))


def test_two_drivers_of_one_actuator_are_refused_and_each_alone_is_staged() -> None:
    drivers = tuple(replace(m, device="left") if m.index == SERVO_2 else m for m in TABLE.modules)
    for running, reason in (
        ((RUN_SERVO_1, RUN_SERVO_2), Reason.UNKNOWN_INDEX),
        ((RUN_SERVO_1,), Reason.NONE),
        ((RUN_SERVO_2,), Reason.NONE),
    ):
        pe = OnePe(replace(TABLE, modules=drivers))
        pe.command(*slice_messages(replace(FLYING, modules=(FLYING.modules[0], *running)), EPOCH, DIGEST))
        assert last_page_1(pe).reason is reason


def test_epochs_wrap_round() -> None:
    pe = OnePe()
    pe.configure(FLYING, 0xFFFF)
    pe.configure(Slice(), 1)
    assert pe.ask()[0].epoch == 1
