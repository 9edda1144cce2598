"""A PE requests a mission phase: because a module does, or because a value that it gives meets a phase's rule."""

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
    TABLE,
    WATCHED,
    OnePe,
    emergencies,
)
from heronry_agent.core.vocabulary import Action
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import (
    FORWARD_ONLY,
    Control,
    ElementKind,
    FaultCode,
    Operation,
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


def requests(actions: list[Action]) -> list[tuple[int, int]]:
    """Phase and detail of every request that goes out."""
    return [(e.index, e.detail) for e in emergencies(actions, FaultCode.PHASE_REQUEST)]


def heard(pe: OnePe, detail: int) -> None:
    pe.command(Control(1, NODE, Operation.ACKNOWLEDGE, ElementKind.PHASE, detail))


class Asking(OnePe):
    """A PE, and the requests that it has sent."""

    def __init__(self) -> None:
        super().__init__(WITH_PHASES)
        self.asked: list[tuple[int, int]] = []


def flying(wanted: Slice = FLYING) -> Asking:
    pe = Asking()
    pe.outputs[CONTROL] = {"demand": 0.0}
    pe.configure(wanted, 7)
    return pe


def give(pe: OnePe, value: float, duration_ns: int) -> list[tuple[int, int]]:
    """Let control give a value for some time; gives the requests that are sent meanwhile."""
    pe.outputs[CONTROL] = {"demand": value}
    return requests(pe.pass_time(duration_ns))


def test_of_two_rules_that_fire_together_the_later_phase_is_requested() -> None:
    pe = flying()
    assert {phase for phase, _ in give(pe, 3.0, 400 * MS)} == {LAND}


def ask(pe: Asking, module: int, *phases: str) -> list[tuple[int, int]]:
    """A module requests phases in its next step."""
    pe.phases[module] = phases
    actions = pe.pass_time(40 * MS)
    del pe.phases[module]
    told = [request for request in requests(actions) if request not in pe.asked]
    pe.asked += told
    return list(dict.fromkeys(told))


def test_an_unknown_phase_is_counted() -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    assert ask(pe, CONTROL, "moon") == []
    assert pe.core.counts["request of an unknown phase", CONTROL] > 0


def test_a_module_that_stops_withdraws_only_its_own_request() -> None:
    pe = flying(WATCHED)
    ask(pe, CONTROL, "land")
    pe.configure(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}), 8)
    assert (LAND, 1) in requests(pe.pass_time(3 * BEAT_NS))
    assert MONITOR not in pe.running


# Rules that lead back


LOW, HIGH = range(2)
THERE_AND_BACK = replace(
    TABLE,
    phases=(
        PhaseEntry("low", "demand", below=1.5, hold_ns=100 * MS, origins=(HIGH,)),
        PhaseEntry("high", "demand", above=1.5, hold_ns=100 * MS, origins=(LOW,)),
    ),
)


def high_and_low() -> OnePe:
    """A PE whose rule for the high phase has fired, in the low phase."""
    pe = OnePe(THERE_AND_BACK)
    pe.outputs[CONTROL] = {"demand": 0.0}
    pe.configure(FLYING, 7)
    tell(pe, LOW)
    give(pe, 0.0, 200 * MS)
    assert (HIGH, FORWARD_ONLY | 2) in give(pe, 3.0, 200 * MS)
    return pe


def tell(pe: OnePe, phase: int) -> list[tuple[int, int]]:
    """The manager tells the phase; gives the requests that follow."""
    return requests(pe.command(Control(1, 0, Operation.HOLDS, ElementKind.PHASE, phase)))


def test_a_rule_fires_again_when_its_origin_begins_while_its_condition_holds() -> None:
    pe = high_and_low()
    heard(pe, FORWARD_ONLY | 2)
    assert tell(pe, HIGH) == []
    assert tell(pe, LOW) == [(HIGH, FORWARD_ONLY | 3)]
    assert tell(pe, LOW) == []  # the same phase, in its turn


def test_a_rule_whose_condition_holds_no_more_does_not_fire_again() -> None:
    pe = high_and_low()
    tell(pe, HIGH)
    assert (LOW, FORWARD_ONLY | 3) in give(pe, 0.0, 300 * MS)
    assert tell(pe, LOW) == []


def test_where_a_rule_leads_back_no_rule_repeats_in_a_new_term_what_is_over() -> None:
    pe = high_and_low()
    heard(pe, FORWARD_ONLY | 2)
    assert requests(pe.command(Control(2, NODE, Operation.RENEW))) == [(HIGH, FORWARD_ONLY | 2)]
    heard(pe, FORWARD_ONLY | 2)
    pe.command(Control(2, NODE, Operation.ACKNOWLEDGE, ElementKind.PHASE, FORWARD_ONLY | 2))
    pe.outputs[CONTROL] = {"demand": 1.5}  # neither above nor below
    pe.pass_time(300 * MS)
    assert requests(pe.command(Control(3, NODE, Operation.RENEW))) == []


@given(st.lists(st.tuples(st.floats(0, 4), st.integers(1, 400)), max_size=20))
def test_whatever_is_given_a_rule_asks_only_for_what_held(values: list[tuple[float, int]]) -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    highest = 0.0
    for value, duration_ms in values:
        highest = max(highest, value)
        for phase, detail in give(pe, value, duration_ms * MS):
            assert detail & FORWARD_ONLY
            assert (phase, True) in {(GLIDE, highest > 1.5), (LAND, highest > 2.5)}
