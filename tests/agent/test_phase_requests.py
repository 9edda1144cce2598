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
    RUN_MONITOR,
    TABLE,
    OnePe,
    sent,
)
from heronry_agent.core.vocabulary import Action
from heronry_wire.configuration_slice import Slice
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import (
    FORWARD_ONLY,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Operation,
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
    pe = flying(BOTH)
    ask(pe, CONTROL, "land")
    pe.configure(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}), 8)
    assert (LAND, 1) in requests(pe.pass_time(3 * BEAT_NS))
    assert MONITOR not in pe.running


@given(st.lists(st.tuples(st.floats(0, 4), st.integers(1, 400)), max_size=20))
def test_whatever_is_given_a_rule_asks_only_for_what_held(values: list[tuple[float, int]]) -> None:
    pe = flying(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    highest = 0.0
    for value, duration_ms in values:
        highest = max(highest, value)
        for phase, detail in give(pe, value, duration_ms * MS):
            assert detail & FORWARD_ONLY
            assert (phase, True) in {(GLIDE, highest > 1.5), (LAND, highest > 2.5)}
