"""How a PE stages a configuration: PREPARE, heads, bodies, and every reason to refuse (protocol rules 4 and 5)."""

from dataclasses import replace

from heronry_agent.core.vocabulary import ImagesMissing
from heronry_wire.configuration_slice import ModuleSlice, Slice, slice_digest
from heronry_wire.management import Lease, Prepare, SliceBody, SliceHead, Step
from heronry_wire.state_frames import PeState, Reason
from lab.conformance import puppets
from lab.conformance.pe_under_test import (
    CONTROL,
    DEMAND,
    EVERYTHING,
    GAUGE,
    HEIGHT,
    HEIGHT_ID,
    HELPER,
    LAMP,
    NEIGHBOUR,
    NODE,
    NOTHING,
    OTHER_HEIGHT,
    PERIOD_NS,
    SERVO,
    TABLE,
    PeUnderTest,
    with_plans_on_board,
)
from lab.conformance.player import MS, demand, equal

_EPOCH, _DIGEST = 17, 0x111111
_QUIET_NS = PERIOD_NS // 2  # without a frame of the body, before INCOMPLETE


def _ready() -> PeUnderTest:
    """Return a PE that hears a manager, in the quiet part of its period."""
    pe = PeUnderTest().attended()
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
    return pe


def a_slice_is_staged_and_said_at_once() -> None:
    """Page 1 names the epoch without a digest while the slice is collected, and with it when the slice is complete."""
    pe = _ready()
    frames = pe.slice_frames(_EPOCH, EVERYTHING)
    demand(len(frames) > 4, "the slice of this test is too short")
    pe.main.command(Prepare(5, _EPOCH, _DIGEST), *frames[:-1])
    began_ns = pe.run(4)
    pe.says_nothing_of_it(began_ns)
    pe.main.command(frames[-1])
    began_ns = pe.run(1)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)
    for again in (Prepare(5, _EPOCH, _DIGEST), frames[0]):
        pe.main.command(again)
        began_ns = pe.run(1)
        pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)
    pe.main.command(frames[1])
    began_ns = pe.run(1)
    pe.says_nothing_of_it(began_ns)
    equal(pe.page_0().state, PeState.UNCONFIGURED, "what is staged does not run")


def its_frames_come_in_any_order_and_doubled() -> None:
    """The body comes before its head, from the end, twice: the slice is staged."""
    pe = _ready()
    head, *body = pe.slice_frames(_EPOCH, EVERYTHING)
    pe.main.command(Prepare(5, _EPOCH, _DIGEST), *reversed(body))
    began_ns = pe.run(3)
    pe.says_nothing_of_it(began_ns)
    pe.main.command(body[0], head, body[1])
    began_ns = pe.run(2)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)


def what_is_for_others_is_left_alone() -> None:
    """A slice of another node, or of another epoch, or without a PREPARE, changes nothing."""
    pe = _ready()
    head, *body = pe.slice_frames(_EPOCH, EVERYTHING)
    pe.main.command(head, *body)
    began_ns = pe.run(3)
    pe.says_nothing_of_it(began_ns)
    pe.main.command(Prepare(5, _EPOCH, _DIGEST))
    assert isinstance(head, SliceHead)
    others = [replace(one, node=NODE + 1) for one in (head, *body)]
    older = [replace(one, epoch_low=_EPOCH - 1) for one in (head, *body)]
    pe.main.command(*others)
    pe.main.command(*older)
    began_ns = pe.run(5)
    pe.says_nothing_of_it(began_ns)
    pe.main.command(head, *body)
    began_ns = pe.run(3)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)


def what_is_missing_is_asked_for() -> None:
    """The PE reports INCOMPLETE half a heartbeat period after the last frame; once for each frame that comes."""
    pe = _ready()
    head, *body = pe.slice_frames(_EPOCH, EVERYTHING)
    pe.main.command(Prepare(5, _EPOCH, _DIGEST), head)
    pe.run(1)
    came_ns = pe.now_ns
    pe.run_until(came_ns + _QUIET_NS - 3 * MS)
    pe.says_nothing_of_it(came_ns - MS)
    pe.run(4)
    pe.answers_in_page_1(came_ns, _EPOCH, 0, Reason.INCOMPLETE)
    began_ns = pe.run(25)
    pe.says_nothing_of_it(began_ns)
    pe.main.command(*body[1:])
    began_ns = pe.run(9)
    pe.says_nothing_of_it(began_ns)
    pe.run(5)
    pe.answers_in_page_1(began_ns, _EPOCH, 0, Reason.INCOMPLETE)
    pe.main.command(body[0])
    began_ns = pe.run(2)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)


def bytes_that_do_not_fit_are_refused() -> None:
    """DIGEST for bytes that were not announced; when the true ones come, the slice is staged after all."""
    pe = _ready()
    head, first, *others = pe.slice_frames(_EPOCH, EVERYTHING)
    assert isinstance(first, SliceBody)
    pe.main.command(Prepare(5, _EPOCH, _DIGEST), head, replace(first, body=bytes(5)), *others)
    began_ns = pe.run(3)
    pe.answers_in_page_1(began_ns, _EPOCH, 0, Reason.DIGEST)
    began_ns = pe.run(15)
    pe.says_nothing_of_it(began_ns)
    pe.main.command(first, *others)
    began_ns = pe.run(3)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)


def another_head_begins_anew() -> None:
    """A different head voids the frames of the body that have come."""
    pe = _ready()
    pe.main.command(Prepare(5, _EPOCH, _DIGEST), *pe.slice_frames(_EPOCH, EVERYTHING)[:-1])
    pe.run(4)
    small = Slice((ModuleSlice(GAUGE, 0, ()),), publish={HEIGHT: 1})
    head, *body = pe.slice_frames(_EPOCH, small)
    pe.main.command(head)
    began_ns = pe.run(1)
    pe.says_nothing_of_it(began_ns)
    pe.main.command(*body)
    began_ns = pe.run(2)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)


_GAUGE, _LAMP, _SERVO = ModuleSlice(GAUGE, 0, ()), ModuleSlice(LAMP, 0, (DEMAND,)), ModuleSlice(SERVO, 0, (DEMAND,))
_PRE_PLANNER = ModuleSlice(CONTROL, 0, (HEIGHT,))
_COHERENT = (
    Slice((_GAUGE,)),
    Slice((_GAUGE,), publish={HEIGHT: 1}),
    Slice((_LAMP,), remote={DEMAND: NEIGHBOUR}),
    Slice((replace(_LAMP, sources=(None,)),)),
    Slice((_GAUGE, _PRE_PLANNER), publish={DEMAND: 1}),
    Slice(forward={OTHER_HEIGHT: (NEIGHBOUR, 1)}),
)
_INCOHERENT = (
    Slice((_LAMP,)),  # it reads a source that is not supplied
    Slice((_LAMP,), remote={OTHER_HEIGHT: NEIGHBOUR}),  # another source is supplied
    Slice((replace(_LAMP, sources=(OTHER_HEIGHT,)),), remote={OTHER_HEIGHT: NEIGHBOUR}),  # of another variable
    Slice((_LAMP,), remote={DEMAND: NODE}),  # from itself
    Slice((_LAMP,), remote={DEMAND: 126}),  # from no PE
    Slice((_GAUGE, _PRE_PLANNER), remote={DEMAND: NEIGHBOUR}),  # from there and from here
    Slice((_GAUGE,), remote={99: NEIGHBOUR}),  # an unknown source
    Slice((_GAUGE,), remote={len(TABLE.sources): NEIGHBOUR}),
    Slice((_GAUGE,), publish={DEMAND: 1}),  # a source that it does not give
    Slice((_GAUGE,), publish={HEIGHT: 0}),
    Slice((_GAUGE,), publish={HEIGHT: 2}),  # on a bus that the PE is not on
    Slice((_GAUGE,), publish={HEIGHT: 3}),
    Slice(forward={99: (NEIGHBOUR, 1)}),
    Slice(forward={OTHER_HEIGHT: (126, 1)}),
    Slice(forward={OTHER_HEIGHT: (NEIGHBOUR, 0)}),
    Slice(forward={OTHER_HEIGHT: (NEIGHBOUR, 2)}),
    Slice((ModuleSlice(GAUGE, 1, ()),)),  # no such mode
    Slice((ModuleSlice(5, 0, ()),)),  # not of this PE
    Slice((_GAUGE, _GAUGE)),  # twice the same module
)


def what_its_table_has_not_is_refused() -> None:
    """A slice that cannot run here is refused with UNKNOWN_INDEX; one that is just within the limits is staged."""
    pe = _ready()
    epoch = _EPOCH
    for wanted, parts in ((Reason.NONE, _COHERENT), (Reason.UNKNOWN_INDEX, _INCOHERENT)):
        for part in parts:
            epoch += 1
            pe.run_into_next_period(5)
            pe.prepare(epoch, part, _DIGEST)
            began_ns = pe.run(3)
            reasons = [(page.reason, page.staged_digest) for _, page in pe.pages_1(began_ns)]
            equal(reasons, [(wanted, 0 if wanted else _DIGEST)], f"answers to {part}")


def bytes_that_are_no_slice_are_refused() -> None:
    """UNKNOWN_INDEX answers bytes that are no slice, with the announced digest, and a length that cannot be sent."""
    pe = _ready()
    pe.main.command(Prepare(5, _EPOCH, _DIGEST), *pe.slice_frames(_EPOCH, b"\xff\xff\xff"))
    began_ns = pe.run(2)
    pe.answers_in_page_1(began_ns, _EPOCH, 0, Reason.UNKNOWN_INDEX)
    for length, reasons in ((1275, []), (1276, [Reason.UNKNOWN_INDEX])):
        pe.main.command(SliceHead(NODE, _EPOCH, length, 0x77))
        began_ns = pe.run(2)
        equal([page.reason for _, page in pe.pages_1(began_ns)], reasons, f"answers to a head of {length} bytes")


def an_image_that_cannot_be_loaded_is_refused() -> None:
    """The PE refuses the slice with IMAGE, and only if a module of the slice has that image."""
    broken = replace(TABLE.modules[HELPER], image="lab.conformance.puppets:Missing")
    pe = PeUnderTest(replace(TABLE, modules=(*TABLE.modules[:HELPER], broken))).attended()
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
    pe.prepare(_EPOCH, EVERYTHING, _DIGEST)
    began_ns = pe.run(3)
    pe.answers_in_page_1(began_ns, _EPOCH, 0, Reason.IMAGE)
    pe.prepare(_EPOCH + 1, Slice((_GAUGE,)), _DIGEST)
    began_ns = pe.run(3)
    pe.answers_in_page_1(began_ns, _EPOCH + 1, _DIGEST, Reason.NONE)


def what_is_old_is_refused() -> None:
    """STALE_EPOCH answers an epoch that is not newer than the staged or running one, also with another digest."""
    pe = _ready()
    pe.prepare(_EPOCH, EVERYTHING, _DIGEST)
    pe.run(3)
    for epoch, digest in ((_EPOCH - 1, _DIGEST), (_EPOCH, _DIGEST + 1), (_EPOCH + 0x8000, _DIGEST)):
        pe.main.command(Prepare(5, epoch, digest))
        began_ns = pe.run(1)
        pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.STALE_EPOCH)
    pe.activate(_EPOCH, Step.GO_ALL, _DIGEST)
    pe.run(22)
    pe.main.command(Prepare(5, _EPOCH, _DIGEST))
    began_ns = pe.run(1)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)
    pe.main.command(Prepare(5, _EPOCH - 1, _DIGEST))
    began_ns = pe.run(1)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.STALE_EPOCH)
    equal(pe.pinged().epoch, _EPOCH, "it runs")


def a_newer_epoch_takes_the_place_of_what_is_collected() -> None:
    """An older epoch does not; in a new term an epoch may be older than one that was only staged."""
    pe = _ready()
    pe.main.command(Prepare(5, _EPOCH + 2, _DIGEST))
    pe.main.command(Prepare(5, _EPOCH + 1, _DIGEST))
    began_ns = pe.run(2)
    pe.answers_in_page_1(began_ns, _EPOCH + 2, 0, Reason.STALE_EPOCH)
    pe.prepare(_EPOCH + 3, EVERYTHING, _DIGEST)
    began_ns = pe.run(3)
    pe.answers_in_page_1(began_ns, _EPOCH + 3, _DIGEST, Reason.NONE)
    pe.term, pe.lease = 7, Lease(7, 0, Step.PREPARED, 0)
    pe.prepare(_EPOCH + 1, EVERYTHING, _DIGEST + 1)
    began_ns = pe.run(3)
    pe.answers_in_page_1(began_ns, _EPOCH + 1, _DIGEST + 1, Reason.NONE)


def what_runs_here_needs_no_body() -> None:
    """A head with the digest and length of the running slice stages it; with another length it does not."""
    pe = PeUnderTest().attended().flies()
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
    pe.prepare(_EPOCH + 1, EVERYTHING, _DIGEST + 1, body=False)
    began_ns = pe.run(2)
    pe.answers_in_page_1(began_ns, _EPOCH + 1, _DIGEST + 1, Reason.NONE)
    body = EVERYTHING.encode()
    pe.main.command(Prepare(5, _EPOCH + 2, _DIGEST + 2))
    pe.main.command(SliceHead(NODE, _EPOCH + 2, len(body) + 1, slice_digest(TABLE.identity, body)))
    began_ns = pe.run(2)
    pe.says_nothing_of_it(began_ns)
    pe.main.command(SliceHead(NODE, _EPOCH + 2, len(body), 0x77))
    began_ns = pe.run(2)
    pe.says_nothing_of_it(began_ns)


def nothing_to_do_is_staged_by_its_head() -> None:
    """The empty slice is complete with its head, from the start on; before the first epoch it is not what 'runs'."""
    pe = _ready()
    pe.prepare(_EPOCH, NOTHING, _DIGEST)
    began_ns = pe.run(2)
    pe.answers_in_page_1(began_ns, _EPOCH, _DIGEST, Reason.NONE)
    pe.main.command(Prepare(5, _EPOCH + 1, _DIGEST), SliceHead(NODE, _EPOCH + 1, 0, 0))
    began_ns = pe.run(2)
    pe.answers_in_page_1(began_ns, _EPOCH + 1, 0, Reason.DIGEST)


def a_contingency_on_board_is_called_by_its_number() -> None:
    """PREPARE alone stages it if number and digest agree; else NOT_ON_BOARD comes once, and the slice is accepted."""
    first, second = Slice((_GAUGE,), publish={HEIGHT: 1}), EVERYTHING
    table = with_plans_on_board(TABLE, (first, 0xA1), (second, 0xA2))
    pe = PeUnderTest(table).attended()
    for epoch, number, digest, staged in (
        (_EPOCH, 1, 0xA1, True),
        (_EPOCH + 1, 2, 0xA2, True),
        (_EPOCH + 2, 3, 0xA2, False),
        (_EPOCH + 3, 1, 0xA2, False),
        (_EPOCH + 4, 2, 0xA1, False),
    ):
        pe.run_into_next_period(5)
        pe.main.command(Prepare(5, epoch, digest, number))
        began_ns = pe.run(1)
        wanted = (epoch, digest, Reason.NONE) if staged else (epoch, 0, Reason.NOT_ON_BOARD)
        pe.answers_in_page_1(began_ns, *wanted)
        pe.main.command(Prepare(5, epoch, digest, number))
        began_ns = pe.run(1)
        pe.answers_in_page_1(began_ns, *wanted)
    pe.main.command(*pe.slice_frames(_EPOCH + 4, second))
    began_ns = pe.run(3)
    pe.answers_in_page_1(began_ns, _EPOCH + 4, 0xA1, Reason.NONE)
    pe.activate(_EPOCH + 4, Step.GO_ALL, 0xA1)
    pe.run(45)
    equal((pe.page_0().state, pe.page_0().epoch), (PeState.ACTIVE, _EPOCH + 4), "it runs")


def data_stand_back_for_what_is_on_board() -> None:
    """All PEs answer PREPARE together, and take a step together: data wait for the time of some frames meanwhile."""
    pe = PeUnderTest(with_plans_on_board(TABLE, (EVERYTHING, 0xA1)))
    puppets.behave_normally()
    pe.attended().flies()
    pe.run(200)
    last_ns = pe.data(HEIGHT_ID, -1)[-1][0]
    pe.run_until(last_ns + 60 * MS - MS // 2)
    pe.main.command(Prepare(5, _EPOCH + 1, 0xA1, 1))
    began_ns = pe.run(10)
    late_ns = pe.data(HEIGHT_ID, began_ns)[0][0] - last_ns - 60 * MS
    demand(0.5 * MS < late_ns < 2 * MS, f"data come {late_ns / MS} ms late when what is on board is called")
    pe.run_until(last_ns + 120 * MS - MS // 2)
    pe.main.command(Prepare(5, _EPOCH + 1, 0xA1, 1))
    began_ns = pe.run(10)
    late_ns = pe.data(HEIGHT_ID, began_ns)[0][0] - last_ns - 120 * MS
    demand(late_ns < 0.3 * MS, f"data come {late_ns / MS} ms late when it is called again")


def what_cannot_run_is_not_staged_from_on_board_either() -> None:
    """A contingency on board is refused for the same reasons as a slice."""
    impossible = Slice((_GAUGE,), publish={HEIGHT: 2})
    pe = PeUnderTest(with_plans_on_board(TABLE, (impossible, 0xA1))).attended()
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
    pe.main.command(Prepare(5, _EPOCH, 0xA1, 1))
    began_ns = pe.run(1)
    pe.answers_in_page_1(began_ns, _EPOCH, 0, Reason.UNKNOWN_INDEX)


def code_that_turns_out_to_be_missing_is_refused() -> None:
    """The running modules go on; the next slice that names the image is refused, one that does not is staged."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies(Slice((_GAUGE,), publish={HEIGHT: 1}))
    image = TABLE.modules[GAUGE].image
    assert image is not None
    pe.tell(ImagesMissing({image: "no such code"}))
    equal(pe.notes("image"), [f"{image} cannot be run here: no such code"], "notes of what is missing")
    for epoch, part, reason in ((_EPOCH + 1, Slice((_GAUGE,)), Reason.IMAGE), (_EPOCH + 2, NOTHING, Reason.NONE)):
        pe.run_into_next_period(5)
        pe.prepare(epoch, part, _DIGEST + epoch)
        began_ns = pe.run(3)
        equal({page.reason for _, page in pe.pages_1(began_ns)}, {reason}, f"reasons after {part}")
    began_ns = pe.run(100)
    demand(bool(pe.data(HEIGHT_ID, began_ns)), "a running module has stopped")


def page_1_tells_the_load() -> None:
    """Page 1 reports the load of the running modules, in per cent of the CPU of the PE."""
    pe = PeUnderTest().attended()
    for epoch, part, load in (
        (_EPOCH, Slice((_GAUGE,)), 20),
        (_EPOCH + 1, Slice((_GAUGE, _PRE_PLANNER)), 40),
        (_EPOCH + 2, EVERYTHING, 100),
        (_EPOCH + 3, NOTHING, 0),
    ):
        pe.flies(part, epoch, _DIGEST + epoch)
        pe.run(200)
        equal(pe.page_1().load, load, f"load of {len(part.modules)} modules")
