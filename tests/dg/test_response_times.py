"""How late data can be over gateways, calculated by hand; and the order of urgency: the identifiers."""

from dataclasses import replace
from fractions import Fraction

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.response_times import ResponseTimes
from heronry_dg.situation import Survivors, situation, survivors
from heronry_dg.traffic import Hop, bus_loads_mbit_per_s, hops, identifiers

# A chain: nose, bus `fast`, mid, bus `slow`, tail, wireless bus `air`, ground, bus `lab`, desk.
CHAIN = """
dg: 1
buses:
  fast: {bitrate: 500000}
  slow: {bitrate: 125000}
  air: {bitrate: 50000, kind: wireless}
  lab: {bitrate: 125000}
pes:
  nose: {node_id: 92, buses: [fast], cpu: 1, ram: 1KiB, flash: 1KiB}
  mid: {node_id: 93, buses: [fast, slow], cpu: 1, ram: 1KiB, flash: 1KiB}
  tail: {node_id: 94, buses: [slow, air], cpu: 1, ram: 1KiB, flash: 1KiB}
  ground: {node_id: 95, buses: [air, lab], cpu: 1, ram: 1KiB, flash: 1KiB}
  desk: {node_id: 96, buses: [lab], cpu: 1, ram: 1KiB, flash: 1KiB}
variables:
  ahead: {type: FLOAT, deadline_ms: 1000}
  back: {type: FLOAT}
modules:
  sender: {gives: {ahead: 1}, cpu: 0, ram: 0, rate_hz: 10}
  answerer: {gives: {back: 1}, cpu: 0, ram: 0, rate_hz: 10}
  taker: {needs: ahead, cpu: 0, ram: 0, rate_hz: 10}
  asker: {needs: back, cpu: 0, ram: 0, rate_hz: 10}
functions:
  forwards: {output: taker, criticality: A}
  backwards: {output: asker, criticality: B}
"""

# What everything waits for on a bus of two PEs: one frame that has started, two states, LEASE and ALIVE.
WAIT_BITS = 5 * 135
FAST_NS, SLOW_NS = 2_000, 8_000  # one bit


def chain(sender_mhz: int = 10_000) -> Spec:
    spec = loads(CHAIN, "chain.dg.yaml")
    sender = spec.modules["sender"]
    mode = replace(sender.modes["only"], rate_mhz=sender_mhz)
    return replace(spec, modules={**spec.modules, "sender": replace(sender, modes={"only": mode})})


def placed(**places: str) -> Configuration:
    """Modules on PEs; the consumers of those that are given are wired to them."""
    wires = {"taker": Wire("sender", "ahead", 1), "asker": Wire("answerer", "back", 1)}
    return Configuration({m: Running(pe, "only", {"": wires[m]} if m in wires else {}) for m, pe in places.items()})


def left(spec: Spec) -> Survivors:
    return survivors(spec, situation(spec))


def responses_ns(spec: Spec, configuration: Configuration) -> dict[tuple[str, str], int | None]:
    """Response time by (variable, bus)."""
    found = ResponseTimes(spec).responses(hops(left(spec), configuration))
    return {(response.hop.variable, response.hop.bus): response.response_ns for response in found}


def test_the_jitter_of_one_bus_is_that_of_the_bus_before() -> None:
    first = (WAIT_BITS + 135) * FAST_NS
    assert responses_ns(chain(), placed(sender="nose", taker="tail")) == {
        ("ahead", "fast"): first,
        ("ahead", "slow"): first + (WAIT_BITS + 135) * SLOW_NS,
    }


def test_a_wireless_bus_is_not_analysed_and_takes_no_time() -> None:
    to_the_ground = responses_ns(chain(), placed(sender="mid", taker="ground"))
    assert to_the_ground == {("ahead", "slow"): (WAIT_BITS + 135) * SLOW_NS}
    to_the_desk = responses_ns(chain(), placed(sender="mid", taker="desk"))
    assert to_the_desk[("ahead", "lab")] == 2 * (WAIT_BITS + 135) * SLOW_NS


def test_data_that_cross_the_same_buses_in_both_directions() -> None:
    both = responses_ns(chain(), placed(sender="nose", taker="tail", answerer="tail", asker="nose"))
    ahead_on_fast, back_on_slow = (WAIT_BITS + 135) * FAST_NS, (WAIT_BITS + 2 * 135) * SLOW_NS
    assert both == {
        ("ahead", "fast"): ahead_on_fast,
        ("ahead", "slow"): ahead_on_fast + (WAIT_BITS + 135) * SLOW_NS,
        ("back", "slow"): back_on_slow,
        ("back", "fast"): back_on_slow + (WAIT_BITS + 2 * 135) * FAST_NS,
    }


def test_jitter_from_a_gateway_brings_one_more_frame_of_higher_priority() -> None:
    often = chain(sender_mhz=125_000)  # every 8 ms
    near = responses_ns(often, placed(sender="mid", taker="tail", answerer="tail", asker="mid"))
    far = responses_ns(often, placed(sender="nose", taker="tail", answerer="tail", asker="mid"))
    assert near[("back", "slow")] == (WAIT_BITS + 2 * 135) * SLOW_NS
    assert far[("back", "slow")] == (WAIT_BITS + 3 * 135) * SLOW_NS


def test_behind_an_overloaded_bus_nothing_has_a_bound() -> None:
    spec = chain()
    slow = replace(spec.buses["slow"], bitrate=20_000)  # management alone needs 27 000
    spec = replace(spec, buses={**spec.buses, "slow": slow})
    both = responses_ns(spec, placed(sender="tail", taker="nose", answerer="nose", asker="mid"))
    assert both == {("ahead", "slow"): None, ("ahead", "fast"): None, ("back", "fast"): None}


def test_a_late_datum_names_all_that_makes_it_late_and_nothing_else() -> None:
    spec = chain(sender_mhz=125_000)
    back = replace(spec.variables["back"], deadline_ns=(WAIT_BITS + 3 * 135) * SLOW_NS - 1)
    spec = replace(spec, variables={**spec.variables, "back": back})
    published = hops(left(spec), placed(sender="nose", taker="tail", answerer="tail", asker="mid"))
    (late,) = ResponseTimes(spec).late(published)
    assert late.hop == Hop("answerer", "back", "only", "slow", None)
    assert late.response_ns == late.deadline_ns + 1
    assert late.causes == {
        late.hop,
        Hop("sender", "ahead", "only", "slow", "fast"),
        Hop("sender", "ahead", "only", "fast", None),
    }
    assert [again.hop for again in ResponseTimes(spec).late(late.causes)] == [late.hop]
    assert ResponseTimes(spec).late(late.causes - {Hop("sender", "ahead", "only", "slow", "fast")}) == []


def test_the_deadline_is_the_period_where_none_is_given() -> None:
    spec = chain()
    answerer = spec.modules["answerer"]
    three_hz = replace(answerer, modes={"only": replace(answerer.modes["only"], rate_mhz=3_000)})
    spec = replace(spec, modules={**spec.modules, "answerer": three_hz})
    (response,) = ResponseTimes(spec).responses(hops(left(spec), placed(answerer="mid", asker="tail")))
    assert response.deadline_ns == 333_333_333
    assert response.meets_deadline


def test_a_source_is_published_once_per_bus_and_not_at_home() -> None:
    spec = chain()
    one = placed(sender="mid", taker="tail").modules
    two = Configuration({**one, "asker": Running("nose", "only", {"": Wire("sender", "ahead", 1)})})
    three = Configuration({**two.modules, "answerer": Running("tail", "only", {"": Wire("sender", "ahead", 1)})})
    published = hops(left(spec), three)
    assert {hop.bus for hop in published} == {"fast", "slow"}
    assert hops(left(spec), placed(sender="mid", taker="mid")) == ()
    assert bus_loads_mbit_per_s(spec, published) == {"fast": 1_350_000, "slow": 1_350_000, "air": 0, "lab": 0}


PRODUCERS = """
dg: 1
buses: {can0: {bitrate: 500000}}
pes: {only: {node_id: 92, buses: [can0], cpu: 1, ram: 1KiB, flash: 1KiB}}
variables:
  altitude: {type: FLOAT, versions: 2, identifier: 322}
  comfort: {type: FLOAT}
  stick: {type: FLOAT}
  trim: {type: FLOAT}
  unused: {type: FLOAT}
modules:
  worse: {gives: {altitude: 2}, cpu: 0, ram: 0, rate_hz: 10}
  better:
    modes:
      coarse: {gives: {comfort: 1}, cpu: 0, ram: 0, rate_hz: 10}
      fine: {gives: {altitude: 1}, cpu: 0, ram: 0, rate_hz: 10}
  spare: {gives: {unused: 1}, cpu: 0, ram: 0, rate_hz: 100}
  slow_stick: {gives: {stick: 1}, cpu: 0, ram: 0, rate_hz: 10}
  fast_trim: {gives: {trim: 1}, cpu: 0, ram: 0, rate_hz: 50}
  cabin: {needs: comfort, cpu: 0, ram: 0, rate_hz: 10}
  flaps: {needs: {or: {k: 1, of: [stick, trim, altitude@2]}}, cpu: 0, ram: 0, rate_hz: 10}
functions:
  air: {output: cabin, criticality: {default: A, cruise: C}, priority: {default: 0, cruise: 1}}
  lift: {output: flaps, criticality: {default: B, cruise: E}}
phases: {cruise: {}, landing: {}}
"""


def test_identifiers_go_by_what_a_producer_could_serve_then_by_period() -> None:
    spec = loads(PRODUCERS, "producers.dg.yaml")
    found = identifiers(spec)
    assert found[("better", "altitude")] == 322
    allocated = sorted(found.keys() - {("better", "altitude")}, key=found.__getitem__)
    assert allocated == [
        ("fast_trim", "trim"),  # B in landing
        ("worse", "altitude"),
        ("slow_stick", "stick"),
        ("better", "comfort"),  # A only while it is not wanted, else C
        ("spare", "unused"),  # serves nothing
    ]
    assert found[("fast_trim", "trim")] == 1536


def test_a_share_of_a_bus_is_taken_from_what_is_for_data() -> None:
    spec = chain()
    half = survivors(spec, situation(spec, limits=["bus:slow=50%"]))
    assert half.bus_mbit_per_s["slow"] == Fraction(125_000_000) * Fraction(7, 10) / 2
