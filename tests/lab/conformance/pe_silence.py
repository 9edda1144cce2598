"""What a PE tells of silent inputs and outputs of its modules: in time, again while they last, and their end."""

from dataclasses import replace

from heronry_wire.configuration_slice import ModuleSlice, Slice
from heronry_wire.silence import Silence
from lab.conformance import puppets
from lab.conformance.pe_under_test import (
    CONTROL,
    EVERYTHING,
    GAUGE,
    HEIGHT,
    LAMP,
    LEASE_NS,
    NEIGHBOUR,
    PERIOD_NS,
    SERVO,
    PeUnderTest,
    datum,
)
from lab.conformance.player import MS, demand, equal

_HEIGHT_OUT, _DEMAND_OUT = Silence(0, is_output=True), Silence(1, is_output=True)
_INPUT = Silence(0)
_LONGEST_NS = 5 * 40 * MS  # of `demand`, as its readers know its period


def _flying(part: Slice = EVERYTHING) -> PeUnderTest:
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies(part)
    pe.run(600)
    equal(pe.stale(0), [], "silences while everything comes")
    return pe


def an_output_that_is_left_out_is_told_with_its_readers_and_the_end() -> None:
    """The output after five periods of its module, its readers after five periods of the source; T_lease at least."""
    pe = _flying()
    began_ns = pe.now_ns
    puppets.BEHAVIOUR["control"] = puppets.giving()
    pe.run(_LONGEST_NS / MS + 10 * PERIOD_NS / MS)
    first: dict[tuple[int, Silence], int] = {}
    for t_ns, module, silence in pe.stale(began_ns):
        first.setdefault((module, silence), t_ns)
    equal(set(first), {(CONTROL, _DEMAND_OUT), (SERVO, _INPUT), (LAMP, _INPUT)}, "what is silent")
    waited_ns = first[CONTROL, _DEMAND_OUT] - began_ns
    demand(LEASE_NS - PERIOD_NS <= waited_ns <= LEASE_NS + 3 * PERIOD_NS, f"the output is told after {waited_ns} ns")
    for reader in (SERVO, LAMP):
        waited_ns = first[reader, _INPUT] - began_ns
        in_time = _LONGEST_NS - PERIOD_NS <= waited_ns <= _LONGEST_NS + 4 * PERIOD_NS
        demand(in_time, f"an input is told after {waited_ns} ns")
    began_ns = pe.run(1000)
    equal(len(pe.stale(began_ns)), 3, "reports in a second in which the silences last")
    puppets.behave_normally()
    began_ns = pe.run(300)
    over = {(module, silence) for _, module, silence in pe.stale(began_ns)}
    equal(over, {(module, replace(silence, is_over=True)) for module, silence in first}, "what is over")
    began_ns = pe.run(1500)
    equal(pe.stale(began_ns), [], "silences after their end")


def a_module_that_lacks_an_input_is_not_told_for_its_output() -> None:
    """Only the gauge is silent, and what reads it."""
    pe = _flying()
    began_ns = pe.now_ns
    puppets.BEHAVIOUR["gauge"] = puppets.giving()
    pe.run(1500)
    told = {(module, silence) for _, module, silence in pe.stale(began_ns)}
    demand((GAUGE, _HEIGHT_OUT) in told and (CONTROL, _INPUT) in told, f"the gauge and its reader are not told: {told}")
    demand((CONTROL, _DEMAND_OUT) not in told, "a module without its input is told for its output")


def an_input_of_a_silent_pe_is_not_told() -> None:
    """The PE of the producer sends its states, or does not; only in the first case its data are missed."""
    part = Slice((ModuleSlice(CONTROL, 0, (HEIGHT,)),), remote={HEIGHT: NEIGHBOUR})
    for is_heard in (True, False):
        pe = PeUnderTest().attended()
        puppets.behave_normally()
        pe.said = lambda pe=pe: pe.main.say(datum(322, 50.0))
        pe.flies(part)
        pe.run(600)
        pe.said = None
        if not is_heard:
            pe.neighbour = None
        began_ns = pe.run(600)
        told = [(module, silence) for _, module, silence in pe.stale(began_ns)]
        equal(set(told), {(CONTROL, _INPUT)} if is_heard else set(), "silences")
