"""A PE asks for a mission phase: by the word of a module, or because what a module gives satisfies a phase's rule."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from agent.one_pe import (
    BEAT_NS,
    CONTROL,
    FLYING,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_CONTROL,
    RUN_MONITOR,
    TABLE,
    OnePe,
    sent,
)
from heronry_agent.core.vocabulary import Action, PartitionEnded
from heronry_wire.configuration_slice import Slice
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import (
    FORWARD_ONLY,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Step,
    decode_emergency,
)
from heronry_wire.pe_table import PhaseEntry

CLIMB, GLIDE, LAND = range(3)
WITH_PHASES = replace(
    TABLE,
    phases=(
        PhaseEntry("climb"),
        PhaseEntry("glide", "demand", above=1.5, hold_ns=100 * MS),
        PhaseEntry("land", "demand", above=2.5, hold_ns=100 * MS),
    ),
)
BOTH = Slice((RUN_CONTROL, RUN_MONITOR), remote={RATE: NEIGHBOUR})


def requests(actions: list[Action]) -> list[tuple[int, int]]:
    """Phase and detail of every request that goes out."""
    told = [decode_emergency(frame.data) for frame in sent(actions, emcy_id(NODE))]
    return [(e.index, e.detail) for e in told if isinstance(e, Emergency) and e.code is FaultCode.PHASE_REQUEST]


def heard(pe: OnePe, detail: int) -> None:
    pe.command(Control(1, NODE, Operation.ACKNOWLEDGE, ElementKind.PHASE, detail))


class Asking(OnePe):
    """A PE, and what it has been heard to ask for."""

    def __init__(self) -> None:
        super().__init__(WITH_PHASES)
        self.asked: list[tuple[int, int]] = []


def flying(wanted: Slice = FLYING) -> Asking:
    pe = Asking()
    pe.outputs[CONTROL] = {"demand": 0.0}
    pe.configure(wanted, 7)
    return pe


def give(pe: OnePe, value: float, duration_ns: int) -> list[tuple[int, int]]:
    """Let control give a value for some time; what is asked for meanwhile."""
    pe.outputs[CONTROL] = {"demand": value}
    return requests(pe.pass_time(duration_ns))


def test_a_rule_fires_once_it_has_held_and_is_said_until_it_is_acknowledged() -> None:
    pe = flying()
    assert give(pe, 2.0, 90 * MS) == []
    told = give(pe, 2.0, 200 * MS)
    assert set(told) == {(GLIDE, FORWARD_ONLY | 1)}
    assert len(told) > 3
    heard(pe, FORWARD_ONLY | 1)
    assert give(pe, 2.0, 500 * MS) == []


def test_of_two_rules_that_fire_at_once_the_later_phase_is_asked_for() -> None:
    pe = flying()
    assert {phase for phase, _ in give(pe, 3.0, 400 * MS)} == {LAND}


def test_what_does_not_hold_on_does_not_fire() -> None:
    pe = flying()
    for _ in range(5):
        assert give(pe, 2.0, 80 * MS) == []
        assert give(pe, 0.0, 30 * MS) == []


def test_a_rule_fires_again_only_after_the_value_has_been_back_for_as_long() -> None:
    pe = flying()
    give(pe, 2.0, 200 * MS)
    heard(pe, FORWARD_ONLY | 1)
    assert give(pe, 0.0, 60 * MS) == []
    assert give(pe, 2.0, 300 * MS) == []
    assert give(pe, 0.0, 200 * MS) == []
    assert (GLIDE, FORWARD_ONLY | 2) in give(pe, 2.0, 300 * MS)


def test_a_value_that_is_not_given_for_a_while_begins_anew() -> None:
    pe = flying()
    assert give(pe, 2.0, 80 * MS) == []
    pe.outputs[CONTROL] = {}
    pe.pass_time(200 * MS)
    assert give(pe, 2.0, 80 * MS) == []
    assert give(pe, 2.0, 80 * MS) != []


def test_below_is_a_rule_too_and_what_is_no_number_satisfies_none() -> None:
    phases = (PhaseEntry("up"), PhaseEntry("down", "demand", below=1.0, hold_ns=0))
    pe = OnePe(replace(TABLE, phases=phases))
    pe.configure(FLYING, 7)
    assert give(pe, 1.0, 50 * MS) == []
    assert give(pe, 0.5, 50 * MS) != []


def ask(pe: Asking, module: int, *phases: str) -> list[tuple[int, int]]:
    """A module asks for phases in its next step."""
    pe.phases[module] = phases
    actions = pe.pass_time(40 * MS)
    del pe.phases[module]
    told = [request for request in requests(actions) if request not in pe.asked]
    pe.asked += told
    return list(dict.fromkeys(told))


def test_a_module_may_ask_for_any_phase_and_asks_once() -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    assert ask(pe, CONTROL, "land") == [(LAND, 1)]
    assert ask(pe, CONTROL, "land") == []
    assert ask(pe, CONTROL, "climb") == [(CLIMB, 2)]


def test_the_newer_request_takes_the_place_of_the_older_and_an_answer_to_that_ends_nothing() -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    ask(pe, CONTROL, "land")
    ask(pe, CONTROL, "glide")
    heard(pe, 1)
    assert set(requests(pe.pass_time(3 * BEAT_NS))) == {(GLIDE, 2)}
    heard(pe, 2)
    assert requests(pe.pass_time(3 * BEAT_NS)) == []


def test_an_unknown_phase_is_counted() -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    assert ask(pe, CONTROL, "moon") == []
    assert pe.core.counts["request of an unknown phase", CONTROL] > 0


def test_a_module_that_stops_asks_no_more() -> None:
    pe = flying(BOTH)
    ask(pe, CONTROL, "land")
    pe.configure(Slice((RUN_MONITOR,), remote={RATE: NEIGHBOUR}), 8)
    assert requests(pe.pass_time(3 * BEAT_NS)) == []
    pe.command(Lease(2, 8, Step.GO_ALL, 1008), Alive(2, 0, frozenset({NODE})))
    assert requests(pe.pass_time(3 * BEAT_NS)) == []


def test_a_module_that_stops_takes_nobody_elses_request_back() -> None:
    pe = flying(BOTH)
    ask(pe, CONTROL, "land")
    pe.configure(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}), 8)
    assert (LAND, 1) in requests(pe.pass_time(3 * BEAT_NS))
    assert MONITOR not in pe.running


def test_a_module_that_begins_again_because_its_partition_has_ended_has_asked_for_nothing() -> None:
    pe = flying(BOTH)
    ask(pe, CONTROL, "land")
    pe.give(PartitionEnded(TABLE.modules[0].partition, "killed by SIGKILL", MONITOR))
    assert CONTROL in pe.running
    assert requests(pe.pass_time(3 * BEAT_NS)) == []
    assert ask(pe, CONTROL, "land") == [(LAND, 2)]


def test_a_new_reign_is_told_again_under_the_same_number_and_then_only_forward() -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    ask(pe, CONTROL, "land")
    heard(pe, 1)
    assert requests(pe.pass_time(3 * BEAT_NS)) == []
    told = requests(pe.command(Lease(2, 7, Step.GO_ALL, 1007)))
    assert told == [(LAND, FORWARD_ONLY | 1)]


def test_what_nobody_has_acknowledged_is_asked_of_a_new_reign_as_it_was() -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    assert ask(pe, CONTROL, "land") == [(LAND, 1)]
    assert requests(pe.command(Lease(2, 7, Step.GO_ALL, 1007))) == []
    assert set(requests(pe.pass_time(3 * BEAT_NS))) == {(LAND, 1)}


@given(st.lists(st.tuples(st.floats(0, 4), st.integers(1, 400)), max_size=20))
def test_whatever_is_given_a_rule_asks_only_for_what_held(values: list[tuple[float, int]]) -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    highest = 0.0
    for value, duration_ms in values:
        highest = max(highest, value)
        for phase, detail in give(pe, value, duration_ms * MS):
            assert detail & FORWARD_ONLY
            assert (phase, True) in {(GLIDE, highest > 1.5), (LAND, highest > 2.5)}
