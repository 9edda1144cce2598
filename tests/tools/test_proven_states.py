"""The judge of sessions: it finds what a page 1 says, however often somebody made the manager open another one."""

from heronry_tools.sim.flight.outcome import KEY
from heronry_tools.sim.oracles.proven_states import ProvenStates
from heronry_wire.authentication import PAGE_1_BEAT, Session
from heronry_wire.management import Control, Operation
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage1, split_state

NODE, DIGEST = 92, 0xABCDEF


def _welcome(number: int) -> Control:
    return Control(7, NODE, Operation.WELCOME, number >> 16, number & 0xFFFF)


def _said(number: int) -> StatePage1:
    """A page 1 that is tagged in the session of that number, and stages DIGEST."""
    page = StatePage1(PeState.ACTIVE, PeFlags.HEARS_LEASE, 9, 0, Reason.NONE, 5)
    said, _ = split_state(page.encode())
    tag = KEY.state_tag(NODE, Session(126, 7, number), PAGE_1_BEAT, said, DIGEST)
    return StatePage1(PeState.ACTIVE, PeFlags.HEARS_LEASE, 9, tag, Reason.NONE, 5)


def test_a_page_is_read_in_its_session_and_in_no_other() -> None:
    proven = ProvenStates(KEY)
    assert proven.read(NODE, _said(1), [DIGEST]).staged_digest == 0
    proven.commanded(126, _welcome(2))
    assert proven.read(NODE, _said(1), [DIGEST]).staged_digest == 0
    assert proven.read(NODE, _said(2), [1, DIGEST]).staged_digest == DIGEST
    assert proven.read(NODE, _said(2), [1]).staged_digest == 0


def test_forged_nonces_do_not_make_it_forget_the_session_that_is_used() -> None:
    proven = ProvenStates(KEY)
    proven.commanded(126, _welcome(1))
    for number in range(2, 1002):
        if number % 300 == 0:
            assert proven.read(NODE, _said(1), [DIGEST]).staged_digest == DIGEST
        proven.commanded(126, _welcome(number))
    assert proven.read(NODE, _said(1), [DIGEST]).staged_digest == DIGEST
