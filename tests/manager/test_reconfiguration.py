"""The manager's side of one epoch: its requests to each PE, how often, and for how long."""

from heronry_dg.configuration import Configuration, Running
from heronry_dg.objective import score
from heronry_dg.plan import make_plan
from heronry_dg.situation import Situation
from heronry_manager.core.epochs.epoch import Epoch, Participant, Stage
from heronry_manager.core.tables.compilation import Compiler
from heronry_wire.management import Activate, Prepare, SliceBody, SliceHead, Step
from heronry_wire.state_frames import PeState
from manager.one_manager import BEAT_NS, MS, two_tails

PES = ("left", "middle", "right")
NODES = {"left": 92, "middle": 93, "right": 94}
FLYING = Configuration({"control": Running("left", "only"), "drive_left": Running("left", "only")})


def opened(*, awaited: tuple[str, ...] = PES, knows: tuple[str, ...] = (), on_board: tuple[str, ...] = ()) -> Epoch:
    """An epoch for all three PEs, opened at time 0; `knows` are those that run the same slice already.

    With `on_board` it is contingency number 7, which these PEs hold.
    """
    spec = two_tails()
    compiled = Compiler(spec).configuration(FLYING)
    participants = [
        Participant(
            pe=pe,
            node=NODES[pe],
            period_ns=BEAT_NS,
            awaited=pe in awaited,
            runs_digest=compiled.slice_digests[NODES[pe]] if pe in knows else None,
            on_board=pe in on_board,
        )
        for pe in PES
    ]
    return Epoch(
        term=1,
        epoch=300,
        plan=make_plan(spec, Situation(), FLYING, score(spec, Situation(), FLYING, None), optimal=True),
        compiled=compiled,
        placed={},
        participants=participants,
        bitrate=1_000_000,
        started_ns=0,
        contingency=7 if on_board else 0,
    )


def staged(epoch: Epoch, *pes: str, now_ns: int = 0) -> None:
    for pe in pes:
        epoch.staged(pe, has_staged=True, wants_body=False, now_ns=now_ns)


def said(epoch: Epoch) -> list[Prepare | SliceHead | SliceBody | Activate]:
    messages = list(epoch.outbox)
    epoch.outbox.clear()
    return messages


def run(epoch: Epoch, from_ns: int, to_ns: int) -> tuple[list[Prepare | SliceHead | SliceBody | Activate], list[str]]:
    """Let time pass, deadline by deadline; gives what was sent and which PEs are overdue."""
    messages, overdue = said(epoch), []
    now_ns = from_ns
    while (due_ns := epoch.next_deadline_ns()) is not None and due_ns <= to_ns:
        now_ns = max(now_ns, due_ns)
        overdue += epoch.tick(now_ns)
        messages += said(epoch)
        if overdue:
            break
    return messages, overdue


def test_a_late_timer_sends_no_flood() -> None:
    epoch = opened()
    epoch.staged("left", has_staged=False, wants_body=True, now_ns=0)
    said(epoch)
    epoch.tick(0)
    assert len(said(epoch)) == 1


def test_a_requested_body_is_sent_once_and_again_only_with_the_next_try() -> None:
    epoch = opened(knows=("left",))
    said(epoch)
    for _ in range(3):
        epoch.staged("left", has_staged=False, wants_body=True, now_ns=MS)
    messages, _ = run(epoch, MS, 4 * MS)
    assert [message.index for message in messages if isinstance(message, SliceBody)] == [1, 2]


def test_a_pe_that_is_no_participant_cannot_move_an_epoch() -> None:
    epoch = opened()
    staged(epoch, *PES)
    epoch.drop("left")
    staged(epoch, "left")
    epoch.reported("left", PeState.ACTIVE, 0)
    assert epoch.all_staged()


def test_a_state_frame_of_the_epoch_proves_that_it_was_staged() -> None:
    epoch = opened()
    epoch.reported("left", PeState.UNCONFIGURED, 0)
    staged(epoch, "middle", "right")
    assert not epoch.all_staged()
    epoch.reported("left", PeState.BROKEN, 0)
    assert epoch.all_staged()


def test_it_waits_for_pes_that_must_break_and_for_identifiers_that_are_not_free() -> None:
    epoch = opened(knows=("left",))
    staged(epoch, *PES)
    epoch.identifiers_free_ns = 50 * MS
    epoch.activate({"left", "stranger"}, MS)
    assert (epoch.stage, epoch.must_break) == (Stage.BREAKING, {"left"})
    assert not epoch.all_broken()
    epoch.reported("left", PeState.BROKEN, 2 * MS)
    assert epoch.all_broken()
    for pe in ("middle", "right"):
        epoch.reported(pe, PeState.BROKEN, 2 * MS)
    assert epoch.next_deadline_ns() == 50 * MS
    epoch.identifiers_free_ns = None
    epoch.go(50 * MS)
    assert epoch.stage is Stage.GOING


def test_an_epoch_does_not_wait_for_a_pe_beyond_a_radio_but_serves_it() -> None:
    epoch = opened(awaited=("left", "middle"))
    staged(epoch, "left", "middle")
    assert epoch.all_staged()
    epoch.activate(set(), 0)
    for pe in ("left", "middle"):
        epoch.reported(pe, PeState.ACTIVE, 0)
    assert epoch.all_active()
    epoch.finish()
    messages, _ = run(epoch, 0, 30 * MS)
    assert {message.node for message in messages if isinstance(message, SliceHead)} >= {94}
    staged(epoch, "right", now_ns=30 * MS)
    messages, _ = run(epoch, 30 * MS, 60 * MS)
    assert [message.step for message in messages if isinstance(message, Activate)][-1] is Step.GO_ALL


def test_a_pe_that_must_break_is_awaited_even_beyond_a_radio() -> None:
    epoch = opened(awaited=("left", "middle"))
    staged(epoch, *PES)
    epoch.activate({"right"}, 0)
    assert not epoch.all_broken()
    epoch.drop("right")
    assert epoch.all_broken()


def called_by_number(*on_board: str) -> Epoch:
    """An epoch that is contingency number 7; these PEs hold it."""
    epoch = opened(on_board=on_board)
    prepare, *_ = epoch.outbox
    assert prepare == Prepare(1, 300, epoch.compiled.digest, 7)
    return epoch


def test_a_pe_that_does_not_answer_to_a_number_gets_prepare_again_and_no_slice() -> None:
    messages, _ = run(called_by_number(*PES), 0, BEAT_NS + MS)
    assert [type(message) for message in messages] == [Prepare, Prepare]


def test_a_pe_that_does_not_have_it_on_board_after_all_gets_its_slice() -> None:
    epoch = called_by_number("left", "right")
    staged(epoch, "right")
    said(epoch)
    for _ in range(2):
        for pe in (*PES, "unknown"):
            epoch.not_on_board(pe, MS)
    messages, _ = run(epoch, MS, 5 * MS)
    slices = [(m.node, getattr(m, "index", 0)) for m in messages if isinstance(m, SliceHead | SliceBody)]
    assert slices == [(92, 0), (92, 1), (92, 2)]  # the middle PE has got its head, and needs no more
