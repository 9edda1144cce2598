"""What checkpoints cost: which buses carry them, how much of them, and how late a state may arrive."""

from dataclasses import replace

import pytest

from heronry_dg.bus_schedule import bus_schedules
from heronry_dg.check.assess import assess
from heronry_dg.check.wire import check
from heronry_dg.checkpoints import carriers, frames_mbit_per_s, gap_ns, late_ns, loads_mbit_per_s, numbers, wait_ns
from heronry_dg.configuration import Configuration, Running
from heronry_dg.loader import loads
from heronry_dg.losses import receivers
from heronry_dg.model import Spec
from heronry_dg.rules.wire import FAMILY, OLD_STATES
from heronry_dg.situation import Situation, survivors
from heronry_dg.verify import verify

TEXT = """
dg: 1
name: kept
buses:
  near: {bitrate: 100000}
  far: {bitrate: 100000}
  air: {bitrate: 100000, kind: wireless}
pes:
  a: {node_id: 92, buses: [near], cpu: 1, ram: 1MiB, flash: 1MiB}
  b: {node_id: 93, buses: [near, far], cpu: 1, ram: 1MiB, flash: 1MiB}
  c: {node_id: 94, buses: [far], cpu: 1, ram: 1MiB, flash: 1MiB}
  d: {node_id: 95, buses: [far, air], cpu: 1, ram: 1MiB, flash: 1MiB}
  e: {node_id: 96, buses: [air], cpu: 1, ram: 1MiB, flash: 1MiB}
variables: {x: {type: FLOAT}}
modules:
  plain: {cpu: 0.1, ram: 1KiB, rate_hz: 10, gives: {x: 1}}
  m: {runs_on: [a, c], cpu: 0.1, ram: 1KiB, rate_hz: 10, checkpoint: {bytes: 12, hz: 2.5, max_age_ms: 900}}
  n: {runs_on: [a, b, e], cpu: 0.1, ram: 1KiB, rate_hz: 10, checkpoint: {bytes: 1275, hz: 5, max_age_ms: 900}}
  o: {runs_on: [b], cpu: 0.1, ram: 1KiB, rate_hz: 10, checkpoint: {bytes: 1, hz: 5, max_age_ms: 900}}
functions: {f: {output: m}, g: {output: n}, h: {output: o}, i: {output: plain}}
"""
SPEC = loads(TEXT, "kept.dg.yaml")


def carrying(module: str, pe: str, *down: str, spec: Spec = SPEC) -> tuple[str, ...]:
    return carriers(survivors(spec, Situation(frozenset(down))), spec.modules[module], pe)


def test_modules_are_numbered_in_the_order_of_the_spec() -> None:
    assert numbers(SPEC) == {"m": 0, "n": 1, "o": 2}


def test_wired_buses_towards_other_possible_pes_that_are_up_carry_a_state() -> None:
    assert carrying("m", "a") == ("near", "far")
    assert carrying("m", "c") == ("near", "far")
    assert carrying("m", "a", "pe:c") == ()
    assert carrying("m", "a", "bus:far") == ()
    assert carrying("n", "a") == ("near", "far")  # on the way to e, which is beyond a radio
    assert carrying("n", "a", "pe:e") == ("near",)
    assert carrying("n", "a", "pe:d") == ("near",)
    assert carrying("o", "b") == ()
    assert carrying("plain", "a") == ()


def test_the_load_is_that_of_all_frames_and_adds_up() -> None:
    assert frames_mbit_per_s(SPEC.modules["m"].checkpoint) == 4 * 135 * 2500  # type: ignore[arg-type]
    runs = Configuration({"m": Running("a", "only", {}), "n": Running("b", "only", {})})
    loads_now = loads_mbit_per_s(survivors(SPEC, Situation()), runs)
    assert loads_now == {"near": 4 * 135 * 2500 + 256 * 135 * 5000, "far": 4 * 135 * 2500 + 256 * 135 * 5000}


def test_the_verifier_counts_them() -> None:
    runs = Configuration({"n": Running("a", "only", {}), "m": Running("a", "only", {})})
    found = [str(one) for one in verify(SPEC, Situation(), runs)]
    assert len(found) == 2
    sentence = (
        "modules publish 0.000 bit/s, and their checkpoints take 174150.000 bit/s, but data may take only 70000.000"
    )
    assert all(sentence in one for one in found)
    assert not verify(SPEC, Situation(frozenset({"pe:c", "pe:d", "pe:b"})), Configuration({"m": runs.modules["m"]}))


def test_a_pe_to_which_states_are_sent_is_told() -> None:
    assert receivers(SPEC) == {"pe:a", "pe:b", "pe:c", "pe:e"}


def test_a_round_never_lasts_longer_than_a_period() -> None:
    short, long = SPEC.modules["m"].checkpoint, SPEC.modules["n"].checkpoint
    assert short is not None
    assert long is not None
    assert gap_ns(short) == 1_000_000
    assert gap_ns(long) == 200_000_000 // 256
    waits_ns = (1 + (4 + 256 + 2) + 2 + 4 * 5 + 1) * 135 * 10**9 // 20_000
    assert late_ns(SPEC, short, ("near",)) == 3_000_000 + waits_ns
    assert late_ns(SPEC, short, ("near", "far")) == 3_000_000 + 2 * waits_ns
    assert late_ns(SPEC, short, ()) == 3_000_000
    assert wait_ns(SPEC, SPEC.buses["near"]) == waits_ns - 135 * 10**9 // 100_000
    assert wait_ns(SPEC, SPEC.buses["air"]) == 0
    assert late_ns(SPEC, long, ()) == 255 * (200_000_000 // 256)


@pytest.mark.parametrize("bus", ["air", "full"])
def test_over_a_radio_or_a_bus_that_may_be_full_there_is_no_bound(bus: str) -> None:
    text = TEXT.replace("  far: {bitrate: 100000}", "  far: {bitrate: 100000}\n  full: {bitrate: 100000, max_load: 1}")
    spec = loads(text, "kept.dg.yaml")
    checkpoint = spec.modules["m"].checkpoint
    assert checkpoint is not None
    assert late_ns(spec, checkpoint, ("near", bus)) is None


def test_the_schedule_of_a_bus_has_each_state_as_one_message_with_its_bound() -> None:
    runs = Configuration({"m": Running("a", "only", {}), "o": Running("b", "only", {})})
    near, far, air = bus_schedules(SPEC, Situation(), runs)
    states = [[one for one in bus.messages if one.kind == "checkpoint"] for bus in (near, far, air)]
    assert [[(one.identifier, one.producer, one.bits) for one in there] for there in states] == [
        [(1954, "m", 540)],
        [(1954, "m", 540)],
        [],
    ]
    checkpoint = SPEC.modules["m"].checkpoint
    assert checkpoint is not None
    assert states[0][0].response_ns == late_ns(SPEC, checkpoint, ("near",))
    assert states[1][0].response_ns == late_ns(SPEC, checkpoint, ("near", "far"))
    assert near.checkpoints == near.share(states[0][0])
    assert near.together == near.data + near.management + near.checkpoints
    assert near.data_fit
    rest = replace(near, checkpoints=near.data_limit)
    assert rest.data_fit == (near.data == 0)


# What the check says of them


def checked(text: str) -> list[str]:
    found = assess(text.encode(), "kept.dg.yaml", {FAMILY.prefix: check}, FAMILY.rules).findings
    return [one.sentence for one in found if one.code == OLD_STATES.code]


def test_a_state_that_may_be_too_old_when_the_next_one_arrives_is_found() -> None:
    fast = TEXT.replace("bitrate: 100000", "bitrate: 1000000")
    assert checked(fast) == []
    (n,) = checked(fast.replace("1275, hz: 5, max_age_ms: 900", "1275, hz: 5, max_age_ms: 500"))
    assert n.startswith("a state of 'n' may be ")
    assert n.endswith(" ms old when the next one arrives, but only 500 ms are allowed")


def test_a_way_without_a_bound_is_found() -> None:
    (m, n) = checked(TEXT.replace("near: {bitrate: 100000}", "near: {bitrate: 100000, max_load: 1}"))
    assert m == "no state of 'm' can be used on another PE: a bus on its way has max_load: 1"
    assert n.startswith("no state of 'n'")
