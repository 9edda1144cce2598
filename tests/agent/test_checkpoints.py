"""The states of modules on one PE: when one is saved and sent, which one is kept, and with which a module starts."""

from dataclasses import replace

import pytest

from agent.one_pe import (
    BEAT_NS,
    CONTROL,
    FAR,
    GATEWAY_TABLE,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_CONTROL,
    RUN_MONITOR,
    TABLE,
    OnePe,
    emergencies,
    neighbour_state,
    sent,
)
from heronry_agent.core.checkpoints.checkpoints import TRIAL_NS
from heronry_agent.core.vocabulary import (
    Action,
    DriveFailed,
    KeptState,
    Note,
    PartitionEnded,
    SaveState,
    StartModule,
    StateLacking,
    StateRestored,
    StateSaved,
    StateUnused,
    StepModule,
)
from heronry_wire.checkpoint_frames import Lack, SentState
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import checkpoint_id
from heronry_wire.management import Alive, FaultCode
from heronry_wire.pe_table import CheckpointEntry
from heronry_wire.sansio import Received, Send, Tick

CODE = b"8 bytes."
PERIOD_NS, GAP_NS, LATE_NS, MAX_AGE_NS, WAIT_NS = 200 * MS, MS, 7 * MS, 500 * MS, 3 * MS
KEPT = CheckpointEntry(CONTROL, 4, 24, PERIOD_NS, GAP_NS, MAX_AGE_NS, LATE_NS, ((NEIGHBOUR, FAR),), (WAIT_NS,))
STATES = replace(TABLE, checkpoints=(KEPT,))
CONTROLLING = Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR})
MONITORING = Slice((RUN_MONITOR,), remote={RATE: NEIGHBOUR})
OWN, THEIRS = checkpoint_id(NODE), checkpoint_id(NEIGHBOUR)


def controlling() -> OnePe:
    """A PE that has just started `control`."""
    pe = OnePe(STATES)
    pe.configure(CONTROLLING, 7)
    pe.hear(neighbour_state(7))
    return pe


def orders(actions: list[Action]) -> list[SaveState]:
    return [action for action in actions if isinstance(action, SaveState)]


def starts(actions: list[Action]) -> list[KeptState | Lack | None]:
    return [action.kept for action in actions if isinstance(action, StartModule)]


def told(actions: list[Action]) -> list[tuple[FaultCode, int, int]]:
    codes = (FaultCode.STATE_RESTORED, FaultCode.STATE_LACKING)
    return [(one.code, one.index, one.detail) for one in emergencies(actions) if one.code in codes]


def heard_state(round_number: int, data: bytes, node: int = NEIGHBOUR, number: int = KEPT.number) -> list[Frame]:
    return list(SentState.of(number, round_number, data, CODE).frames(node))


def counted(pe: OnePe, what: str) -> int:
    return sum(count for (cause, _), count in pe.core.counts.items() if cause == what)


# Saving


def test_a_state_is_saved_after_the_first_step_and_then_in_each_period() -> None:
    pe = controlling()
    begun_ns = pe.now_ns
    pe.pass_time(900 * MS)
    times = [at_ns - begun_ns for at_ns, action in pe.done if isinstance(action, SaveState)]
    assert times == [0, 200 * MS, 400 * MS, 600 * MS, 800 * MS]
    kinds = [type(action) for _, action in pe.done if isinstance(action, StepModule | SaveState)]
    assert kinds[:2] == [StepModule, SaveState]


def test_after_a_pause_one_state_is_saved_and_the_grid_stays() -> None:
    pe = controlling()
    (first,) = orders(pe.pass_time(0))
    pe.now_ns += 730 * MS
    (after,) = orders(pe.give(Tick()))
    assert (first.round, after.round, after.most_bytes) == (0, 1, 24)
    assert len(orders(pe.pass_time(60 * MS))) == 0
    assert len(orders(pe.pass_time(20 * MS))) == 1


def saved(pe: OnePe, data: bytes = bytes(16)) -> list[Action]:
    """Let the module answer its last order."""
    last = [action for _, action in pe.done if isinstance(action, SaveState)][-1]
    return pe.give(StateSaved(CONTROL, last.round, CODE, data, pe.now_ns))


def test_the_frames_of_a_state_are_sent_one_by_one() -> None:
    pe = controlling()
    pe.pass_time(0)
    state = SentState.of(KEPT.number, 0, bytes(range(16)), CODE)
    saved(pe, state.data)
    frames, begun_ns = [], pe.now_ns
    for _ in range(6):
        frames += [(pe.now_ns - begun_ns, frame) for frame in sent(pe.give(Tick()), OWN)]
        pe.now_ns += GAP_NS
    assert frames == [(place * MS, frame) for place, frame in enumerate(state.frames(NODE))]
    until = [action.until_ns for _, action in pe.done if isinstance(action, Send) and action.frame.can_id == OWN]
    assert until == [begun_ns + place * MS + WAIT_NS for place in range(5)]


@pytest.mark.parametrize(("pause_ns", "places"), [(3 * MS, [0, 1, 2, 3, 4]), (8 * MS, [])])
def test_frames_that_are_late_are_made_up_for_or_cut_off(pause_ns: int, places: list[int]) -> None:
    pe = controlling()
    pe.pass_time(0)
    saved_ns = pe.now_ns
    pe.now_ns += pause_ns
    pe.give(StateSaved(CONTROL, 0, CODE, bytes(16), saved_ns))
    pe.pass_time(20 * MS)
    sends = [(at_ns, a) for at_ns, a in pe.done if isinstance(a, Send) and a.frame.can_id == OWN]
    assert [a.frame.data[2] for _, a in sends] == places
    assert [a.until_ns for _, a in sends] == [saved_ns + place * MS + WAIT_NS for place in places]


@pytest.mark.parametrize("says_ns", [0, 10**18])
def test_a_partition_that_tells_a_wrong_time_of_a_state_is_not_believed(says_ns: int) -> None:
    pe = controlling()
    pe.pass_time(0)
    asked_ns = pe.now_ns
    pe.now_ns += 2 * MS
    pe.give(StateSaved(CONTROL, 0, CODE, bytes(8), says_ns))
    (first, *_) = [a for a in pe.give(Tick()) if isinstance(a, Send) and a.frame.can_id == OWN]
    assert first.until_ns == WAIT_NS + (asked_ns if not says_ns else pe.now_ns)


def test_after_a_pause_in_a_round_the_frames_that_are_due_follow_at_once() -> None:
    pe = controlling()
    pe.pass_time(0)
    saved(pe, bytes(24))
    pe.give(Tick())
    pe.now_ns += 3 * MS
    assert [frame.data[2] for frame in sent(pe.give(Tick()), OWN)] == [1, 2, 3]
    pe.now_ns += 6 * MS
    assert sent(pe.give(Tick()), OWN) == []
    assert sent(pe.pass_time(20 * MS), OWN) == []


def test_the_next_state_cuts_off_the_frames_of_the_last_one() -> None:
    pe = controlling()
    pe.fly(20 * MS, epoch=7, digest=1007)
    saved(pe, bytes(24))
    pe.give(Tick())
    pe.now_ns += 200 * MS
    pe.hear(neighbour_state(7))
    pe.fly(40 * MS, epoch=7, digest=1007)
    actions = saved(pe, bytes(8)) + pe.fly(60 * MS, epoch=7, digest=1007)
    assert {frame.data[1] for frame in sent(actions, OWN)} == {1}


@pytest.mark.parametrize(("alive", "count"), [({NODE}, 0), ({NODE, FAR}, 3), ({NODE, NEIGHBOUR}, 3)])
def test_a_state_goes_only_where_a_possible_pe_is_counted_on(alive: set[int], count: int) -> None:
    pe = controlling()
    pe.pass_time(0)
    pe.command(Alive(1, 2, frozenset(alive)))
    saved(pe, bytes(10))
    assert len(sent(pe.pass_time(10 * MS), OWN)) == count


def test_a_pe_that_may_have_been_replaced_sends_no_state() -> None:
    pe = controlling()
    pe.pass_time(60 * MS)  # nobody is heard
    saved(pe)
    assert sent(pe.pass_time(10 * MS), OWN) == []
    assert counted(pe, "checkpoint held") == 1


def test_an_answer_to_another_order_is_dropped() -> None:
    pe = controlling()
    pe.give(StateSaved(CONTROL, 0, CODE, bytes(8), 0))  # before any order
    pe.pass_time(0)
    pe.give(StateSaved(CONTROL, 3, CODE, bytes(8), 0))
    pe.give(StateSaved(MONITOR, 0, CODE, bytes(8), 0))  # has no checkpoint
    assert counted(pe, "stale answer") == 3
    saved(pe)
    saved(pe)
    assert counted(pe, "stale answer") == 4


def test_a_module_without_a_state_yet_sends_none() -> None:
    pe = controlling()
    pe.pass_time(0)
    saved(pe, b"")
    assert sent(pe.pass_time(10 * MS), OWN) == []
    assert told(pe.pass_time(0)) == []


def test_a_state_that_cannot_be_saved_is_told_and_tried_again_a_second_later() -> None:
    pe = controlling()
    pe.pass_time(0)
    actions = pe.give(StateLacking(CONTROL, Lack.RAISES, "ValueError: no")) + pe.pass_time(BEAT_NS)
    assert told(actions) == [(FaultCode.STATE_LACKING, CONTROL, Lack.RAISES)]
    words = "the state of module control cannot be saved (RAISES): ValueError: no"
    assert [action.text for action in actions if isinstance(action, Note)] == [words]
    assert orders(pe.pass_time(950 * MS)) == []
    assert len(orders(pe.pass_time(60 * MS))) == 1
    again = pe.give(StateLacking(CONTROL, Lack.RAISES)) + pe.pass_time(BEAT_NS)
    assert told(again) == []  # it is told once a second, with each try or without
    assert not [action for action in again if isinstance(action, Note)]
    assert len(told(pe.pass_time(1_000 * MS))) == 1
    saved(pe)
    assert told(pe.pass_time(1_500 * MS)) == []


@pytest.mark.parametrize("ends", ["saved", "saved without a state", "stopped"])
def test_that_a_state_cannot_be_saved_is_told_every_second_until_it_is_over(ends: str) -> None:
    pe = OnePe(replace(STATES, checkpoints=(replace(KEPT, period_ns=5_000 * MS),)))
    pe.configure(CONTROLLING, 7)
    pe.pass_time(0)
    lacking = pe.give(StateLacking(CONTROL, Lack.RAISES)) + pe.pass_time(4_900 * MS)
    assert told(lacking) == [(FaultCode.STATE_LACKING, CONTROL, Lack.RAISES)] * 5
    pe.pass_time(110 * MS)
    if ends == "stopped":
        pe.configure(MONITORING, 8)
    else:
        saved(pe, b"state" if ends == "saved" else b"")
    assert told(pe.pass_time(4_000 * MS)) == []


def test_a_copy_that_many_reports_delay_is_not_sent_as_another_start() -> None:
    pe = controlling()
    actions = pe.give(StateRestored(CONTROL, 0)) + pe.pass_time(500 * MS)
    pe.now_ns += 3_500 * MS
    assert len(told(actions + pe.give(Tick()))) == 1
    assert told(pe.pass_time(4_000 * MS)) == []


def test_a_state_that_is_longer_than_it_may_be_is_not_sent() -> None:
    pe = controlling()
    pe.pass_time(0)
    actions = saved(pe, bytes(25)) + pe.pass_time(BEAT_NS)
    assert told(actions) == [(FaultCode.STATE_LACKING, CONTROL, Lack.TOO_LONG)]
    assert sent(actions, OWN) == []


def test_a_module_that_has_stopped_has_no_state_to_save() -> None:
    pe = controlling()
    pe.pass_time(0)
    pe.configure(MONITORING, 8)
    assert told(pe.give(StateLacking(CONTROL, Lack.HANGS))) == []
    assert orders(pe.pass_time(1_000 * MS)) == []


# Starting


def test_a_module_starts_without_a_state_where_there_is_none() -> None:
    pe = OnePe(STATES)
    assert starts(pe.configure(CONTROLLING, 7)) == [Lack.NO_STATE]


def test_a_module_without_a_checkpoint_is_asked_for_none() -> None:
    pe = OnePe(STATES)
    assert starts(pe.configure(MONITORING, 7)) == [None]
    assert orders(pe.pass_time(1_000 * MS)) == []


RESTARTS = replace(STATES, modules=tuple(replace(one, restarts=3) for one in TABLE.modules))


def fails(pe: OnePe) -> list[Action]:
    """Let the module fail, and start it anew."""
    return pe.give(DriveFailed(CONTROL, "no number")) + pe.fly(150 * MS, epoch=7, digest=1007)


def restarted() -> tuple[OnePe, KeptState]:
    """A PE on which the module has failed and goes on from its state, which it has saved in its first step."""
    pe = OnePe(RESTARTS)
    pe.configure(CONTROLLING, 7)
    pe.hear(neighbour_state(7))
    pe.pass_time(0)
    saved(pe, b"my state")
    pe.pass_time(10 * MS)
    (state,) = starts(fails(pe))
    assert isinstance(state, KeptState)
    pe.give(StateRestored(CONTROL, 0))
    return pe, state


def test_a_module_that_is_restarted_goes_on_from_its_own_state() -> None:
    pe, state = restarted()
    assert state.state == SentState.of(KEPT.number, 0, b"my state", CODE)
    assert state.until_ns - state.since_ns == MAX_AGE_NS
    pe.configure(MONITORING, 8)
    assert starts(pe.configure(CONTROLLING, 9)) == [Lack.NO_STATE]  # no start uses it again


@pytest.mark.parametrize("saves", [False, True])
def test_a_module_that_fails_soon_after_its_start_from_a_state_starts_without_one(saves: bool) -> None:
    pe, _ = restarted()
    if saves:
        saved(pe, b"no better")
    actions = fails(pe) + pe.pass_time(500 * MS)
    assert starts(actions) == [Lack.NO_STATE]
    assert voids(actions) == 1
    words = "the states of module control are discarded: one of them may make it fail"
    assert words in [action.text for action in actions if isinstance(action, Note)]


def test_a_partition_that_dies_while_a_state_is_restored_costs_the_state() -> None:
    pe = OnePe(RESTARTS)
    pe.hear(*heard_state(1, b"state"))
    (state,) = starts(pe.configure(CONTROLLING, 7))
    assert isinstance(state, KeptState)
    partition = RESTARTS.modules[CONTROL].partition
    actions = pe.give(PartitionEnded(partition, "killed by SIGSEGV", None)) + pe.pass_time(0)
    assert starts(actions) == [Lack.NO_STATE]


@pytest.mark.parametrize(("more_ns", "is_cold"), [(-10 * MS, True), (10 * MS, False)])
def test_a_module_that_fails_after_its_trial_goes_on_from_the_newest_state(more_ns: int, is_cold: bool) -> None:
    pe = OnePe(RESTARTS)
    pe.hear(*heard_state(1, b"state"))
    pe.configure(CONTROLLING, 7)
    pe.give(StateRestored(CONTROL, 0))
    pe.pass_time(TRIAL_NS + more_ns)
    saved(pe, b"newest")
    (state,) = starts(fails(pe))
    assert isinstance(state, Lack) is is_cold
    assert isinstance(state, Lack) or state.state.data == b"newest"


def voids(actions: list[Action]) -> int:
    """Count the empty states that are sent."""
    return sum(frame.data[2:5] == bytes(3) for frame in sent(actions, OWN))


def test_a_module_that_fails_twice_starts_without_a_state_and_one_that_is_given_up_leaves_none() -> None:
    pe = OnePe(replace(STATES, modules=tuple(replace(one, restarts=2) for one in TABLE.modules)))
    pe.configure(CONTROLLING, 7)
    found = []
    for _ in range(3):
        pe.fly(TRIAL_NS + 200 * MS, epoch=7, digest=1007)
        saved(pe, b"state")
        actions = fails(pe)
        found.append((*map(type, starts(actions)), voids(actions)))
    assert found == [(KeptState, 0), (Lack, 1), (1,)]


def test_a_module_that_takes_too_long_leaves_no_state() -> None:
    pe = controlling()
    pe.spent_ns = 10**9
    assert voids(pe.fly(1_000 * MS, epoch=7, digest=1007)) == 1


def test_a_state_that_the_module_has_refused_is_not_blamed_for_what_follows() -> None:
    pe = OnePe(RESTARTS)
    pe.hear(*heard_state(1, b"state"))
    pe.configure(CONTROLLING, 7)
    pe.give(StateLacking(CONTROL, Lack.REFUSED))
    pe.pass_time(10 * MS)
    saved(pe, b"the next")
    (state,) = starts(fails(pe))
    assert isinstance(state, KeptState)


def test_an_object_that_goes_on_leaves_the_state_for_the_next_start() -> None:
    pe = OnePe(STATES)
    pe.hear(*heard_state(1, b"state"))
    first = starts(pe.configure(CONTROLLING, 7))
    pe.give(StateUnused(CONTROL))
    pe.configure(MONITORING, 8)
    assert starts(pe.configure(CONTROLLING, 9)) == first


def test_an_empty_state_makes_those_before_void() -> None:
    pe = OnePe(STATES)
    pe.hear(*heard_state(1, b"state"), *heard_state(2, b"", FAR))
    assert starts(pe.configure(CONTROLLING, 7)) == [Lack.NO_STATE]


def test_a_newer_state_is_not_replaced_by_an_older_one() -> None:
    pe = OnePe(STATES)
    pe.now_ns += 300 * MS
    pe.hear(*heard_state(1, b"newer"))
    for frame in heard_state(1, b"older", FAR):
        pe.give(Received(0, frame, 100 * MS))
    (state,) = starts(pe.configure(CONTROLLING, 7))
    assert isinstance(state, KeptState)
    assert state.state.data == b"newer"


def test_a_module_starts_from_the_newest_state_that_was_heard() -> None:
    pe = OnePe(STATES)
    pe.hear(*heard_state(1, b"old"))
    pe.pass_time(10 * MS)
    pe.hear(*heard_state(2, b"new", FAR))
    pe.hear(*heard_state(3, b"half")[:-1])
    since_ns = pe.now_ns - LATE_NS
    (kept,) = starts(pe.configure(CONTROLLING, 7))
    assert kept == KeptState(SentState.of(KEPT.number, 2, b"new", CODE), since_ns, since_ns + MAX_AGE_NS)


def test_a_state_counts_from_its_arrival_even_after_a_pause() -> None:
    pe = OnePe(STATES)
    for frame in heard_state(1, b"state"):
        pe.give(Received(0, frame, 100 * MS))
    (kept,) = starts(pe.configure(CONTROLLING, 7))
    assert isinstance(kept, KeptState)
    assert kept.since_ns == pe.now_ns - 100 * MS - LATE_NS


def test_a_round_that_lasts_longer_than_it_may_is_not_whole() -> None:
    pe = OnePe(STATES)
    first, second = heard_state(1, b"state")
    pe.hear(first)
    pe.pass_time(LATE_NS + 1)
    pe.hear(second)
    assert starts(pe.configure(CONTROLLING, 7)) == [Lack.NO_STATE]


@pytest.mark.parametrize(("late_ns", "is_too_old"), [(0, False), (1, True)])
def test_a_state_that_is_too_old_is_not_used(late_ns: int, is_too_old: bool) -> None:
    pe = OnePe(STATES)
    pe.hear(*heard_state(1, b"state"))
    pe.pass_time(MAX_AGE_NS - LATE_NS + late_ns)
    (kept,) = starts(pe.configure(CONTROLLING, 7))
    assert (kept is Lack.TOO_OLD) is is_too_old


def test_a_pe_that_runs_the_module_takes_no_state_of_it() -> None:
    pe = controlling()
    pe.hear(*heard_state(1, b"forged"))
    pe.configure(MONITORING, 8)
    assert starts(pe.configure(CONTROLLING, 9)) == [Lack.NO_STATE]


def test_what_a_start_has_used_is_told_three_times_and_noted_once() -> None:
    pe = controlling()
    actions = pe.give(StateRestored(CONTROL, 123_400_000)) + pe.pass_time(3_500 * MS)
    assert told(actions) == [(FaultCode.STATE_RESTORED, CONTROL, 124)] * 3
    words = "module control starts from its state, which is at most 124 ms old"
    assert [action.text for action in actions if isinstance(action, Note) and action.kind == "checkpoint"] == [words]


def test_a_start_without_a_state_is_told_and_replaced_by_the_next_report() -> None:
    pe = controlling()
    actions = pe.give(StateLacking(CONTROL, Lack.REFUSED, "ValueError: no")) + pe.pass_time(500 * MS)
    actions += pe.give(StateRestored(CONTROL, 10**15)) + pe.pass_time(4_000 * MS)
    lacking = (FaultCode.STATE_LACKING, CONTROL, Lack.REFUSED)
    assert told(actions) == [lacking, *[(FaultCode.STATE_RESTORED, CONTROL, 0xFFFF)] * 3]
    notes = [action.text for action in actions if isinstance(action, Note) and action.kind == "checkpoint"]
    assert notes[0] == "module control starts without its state (REFUSED): ValueError: no"


def test_two_reports_at_once_are_sent_in_two_heartbeats() -> None:
    both = replace(STATES, checkpoints=(KEPT, replace(KEPT, module=MONITOR, number=5)))
    pe = OnePe(both)
    pe.configure(Slice((RUN_CONTROL, RUN_MONITOR), remote={RATE: NEIGHBOUR}), 7)
    actions = pe.give(StateRestored(CONTROL, 0)) + pe.give(StateRestored(MONITOR, 0))
    assert told(actions + pe.pass_time(0)) == [(FaultCode.STATE_RESTORED, CONTROL, 0)]
    assert told(pe.pass_time(BEAT_NS)) == [(FaultCode.STATE_RESTORED, MONITOR, 0)]


# The bus


@pytest.mark.parametrize(
    "frame",
    [
        Frame(THEIRS, b""),
        heard_state(1, b"state", number=9)[0],
        Frame(THEIRS, b"\x04\x01"),
    ],
)
def test_a_frame_that_is_none_of_a_possible_pe_changes_nothing(frame: Frame) -> None:
    pe = OnePe(STATES)
    pe.hear(frame)
    assert starts(pe.configure(CONTROLLING, 7)) == [Lack.NO_STATE]


def test_without_a_bound_of_the_response_time_no_state_is_kept() -> None:
    pe = OnePe(replace(TABLE, checkpoints=(replace(KEPT, late_ns=None),)))
    pe.hear(*heard_state(1, b"state"))
    assert starts(pe.configure(CONTROLLING, 7)) == [Lack.NO_STATE]


def test_an_alive_that_names_the_same_pes_changes_nothing() -> None:
    pe = controlling()
    for sequence in range(3):
        pe.command(Alive(1, sequence, frozenset({NODE, NEIGHBOUR})))
    pe.pass_time(0)
    saved(pe, b"x")
    assert len(sent(pe.pass_time(10 * MS), OWN)) == 2


WIRED = tuple(replace(port, wireless=False) for port in GATEWAY_TABLE.ports)
BOTH_SIDES = replace(KEPT, towards=((NEIGHBOUR,), (FAR,)), waits_ns=(WAIT_NS, 2 * WAIT_NS))


def test_a_gateway_that_was_paused_forwards_no_old_frame() -> None:
    pe = OnePe(replace(GATEWAY_TABLE, ports=WIRED, checkpoints=(BOTH_SIDES,)))
    pe.command(Alive(1, 2, frozenset({NODE, NEIGHBOUR, FAR})))
    (sends,) = [a for a in pe.give(Received(0, heard_state(1, b"state")[0], 900 * MS)) if isinstance(a, Send)]
    assert sends.until_ns == pe.now_ns - 900 * MS + 2 * WAIT_NS


def forwarded(pe: OnePe, port: int, frame: Frame) -> list[tuple[int, Frame]]:
    actions = pe.give(Received(port, frame, 0))
    return [(action.port, action.frame) for action in actions if isinstance(action, Send)]


def test_a_gateway_forwards_a_state_towards_the_possible_pes_that_are_counted_on() -> None:
    elsewhere = replace(BOTH_SIDES, module=0)  # `gyro`, which cannot run here
    pe = OnePe(replace(GATEWAY_TABLE, ports=WIRED, checkpoints=(elsewhere,)))
    pe.configure(MONITORING, 7)
    from_here, from_beyond = heard_state(1, b"state")[0], heard_state(1, b"state", FAR)[0]
    assert forwarded(pe, 0, from_here) == []  # node 94 is not counted on
    assert forwarded(pe, 1, from_beyond) == [(0, from_beyond)]
    pe.command(Alive(1, 2, frozenset({NODE, NEIGHBOUR, FAR})))
    assert forwarded(pe, 0, from_here) == [(1, from_here)]
    assert forwarded(pe, 1, from_here) == []  # node 92 is not on that side
    assert counted(pe, "foreign or malformed checkpoint") == 1


def test_a_gateway_that_runs_the_module_sends_its_state_both_ways() -> None:
    pe = OnePe(replace(GATEWAY_TABLE, ports=WIRED, checkpoints=(BOTH_SIDES,)))
    pe.configure(CONTROLLING, 7)
    pe.command(Alive(1, 2, frozenset({NODE, NEIGHBOUR, FAR})))
    pe.hear(neighbour_state(7))
    pe.pass_time(0)
    saved(pe, b"x")
    actions = pe.pass_time(10 * MS)
    assert len(sent(actions, OWN, 0)) == len(sent(actions, OWN, 1)) == 2
