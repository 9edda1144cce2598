"""The paths behind a DEMUX: what belongs to a branch, and what `to` may and must name."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dg.marked_spec import RUNS
from heronry_dg.demux_paths import DemuxPaths
from heronry_dg.findings import SpecError
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from planner.random_specs import can_run, random_spec
from thoroughness import part_of

HEAD = """
dg: 1
buses: {can0: {bitrate: 500000}}
pes:
  nose: {node_id: 92, buses: [can0], cpu: 1, ram: 8KiB, flash: 8KiB}
  tail: {node_id: 93, buses: [can0], cpu: 1, ram: 8KiB, flash: 8KiB}
devices:
  gauge: {kind: sensor, pe: nose}
  valve_a: {kind: actuator, pe: nose}
  valve_b: {kind: actuator, pe: tail}
variables:
  level: {type: FLOAT}
  other: {type: FLOAT, initial: 0}
  stroke_a: {type: FLOAT, initial: 0}
  stroke_b: {type: FLOAT, initial: 0}
functions:
  refuelling: {output: filling}
"""
GAUGE = f"  gauge_driver: {{device: gauge, gives: {{level: 1}}, {RUNS}}}\n"
RAMPS = (
    f"  ramp_a: {{needs: filling, gives: {{stroke_a: 1}}, {RUNS}}}\n"
    f"  ramp_b: {{needs: filling, gives: {{stroke_b: 1}}, {RUNS}}}\n"
)
VALVES = (
    f"  valve_driver_a: {{device: valve_a, needs: stroke_a, {RUNS}}}\n"
    f"  valve_driver_b: {{device: valve_b, needs: stroke_b, {RUNS}}}\n"
)


def spec_of(demux: str, modules: str) -> Spec:
    return loads(f"{HEAD}gates: {{filling: {demux}}}\nmodules:\n{modules}", "x.dg.yaml")


def refused(demux: str, modules: str) -> list[str]:
    with pytest.raises(SpecError) as caught:
        spec_of(demux, modules)
    return [f"{finding.code}: {finding.sentence}" for finding in caught.value.findings]


def to(*ends: str) -> str:
    return f"{{demux: level, to: [{', '.join(ends)}]}}"


def test_a_function_is_served_by_the_ends_in_the_order_of_the_list() -> None:
    spec = spec_of(to("valve_driver_b", "valve_driver_a"), GAUGE + RAMPS + VALVES)
    assert spec.demuxes["filling"].branches == ("ramp_a", "ramp_b")
    assert spec.functions["refuelling"].outputs == ("valve_driver_b", "valve_driver_a")
    assert load(shipped_spec_path("elevator_and_chute")).demuxes["elevator_out"].to == ()


def test_an_end_may_be_its_branch() -> None:
    direct = f"  ramp_a: {{device: valve_a, needs: filling, {RUNS}}}\n"
    spec = spec_of(
        to("valve_driver_b", "ramp_a"), GAUGE + direct + RAMPS.splitlines()[1] + "\n" + VALVES.splitlines()[1]
    )
    assert spec.functions["refuelling"].outputs == ("valve_driver_b", "ramp_a")


def test_there_are_as_many_ends_as_branches() -> None:
    assert refused(to("valve_driver_a"), GAUGE + RAMPS + VALVES) == [
        "DG228: DEMUX 'filling' has 2 branches, and 'to' names 1 modules: ramp_a and ramp_b"
    ]


@pytest.mark.parametrize(
    ("ends", "sentence"),
    [
        (("valve_driver_a", "ramp_a"), "'valve_driver_a' and 'ramp_a' are both ends of branch 'ramp_a'"),
        (("valve_driver_a", "gauge_driver"), "'gauge_driver' cannot be an end: it depends on no branch of the DEMUX"),
        (("valve_driver_a", "both"), "'both' cannot be an end: it depends on ramp_a and ramp_b of the DEMUX"),
        (("valve_driver_a", "either"), "'either' cannot be an end: it depends on no branch of the DEMUX"),
        (("valve_driver_a", "never"), "'never' cannot be an end: it never runs"),
    ],
)  # fmt: skip
def test_each_end_belongs_to_a_branch_of_its_own(ends: tuple[str, ...], sentence: str) -> None:
    odd = (
        f"  both: {{needs: {{and: [stroke_a, stroke_b]}}, {RUNS}}}\n"
        f"  either: {{needs: {{or: {{k: 1, of: [stroke_a, stroke_b]}}}}, {RUNS}}}\n"
        f"  never: {{needs: {{and: [stroke_b, other]}}, {RUNS}}}\n"
    )
    assert refused(to(*ends), GAUGE + RAMPS + VALVES + odd) == [f"DG228: {sentence}"]


def test_a_branch_without_an_actuator_that_leads_on_to_one_asks_for_ends() -> None:
    assert refused("{demux: level}", GAUGE + RAMPS + VALVES) == [
        "DG229: branch 'ramp_a' of DEMUX 'filling' drives no actuator, and leads on to valve_driver_a"
    ]


def test_so_does_one_of_several_branches_that_lead_on_to_one_actuator() -> None:
    ramps = RAMPS.replace("stroke_b", "stroke_a")
    valve = VALVES.splitlines()[0] + "\n"
    found = refused("{demux: level}", GAUGE + ramps + valve)
    assert [one.rpartition(" ")[2] for one in found] == ["valve_driver_a"]


def test_a_branch_whose_data_are_optional_to_the_actuator_is_an_output_by_itself() -> None:
    optional = VALVES.replace("needs: stroke_a", "needs: {and: [level, {or: {k: 0, of: [stroke_a]}}]}")
    optional = optional.replace("needs: stroke_b", "needs: {and: [level, {or: {k: 0, of: [stroke_b]}}]}")
    assert spec_of("{demux: level}", GAUGE + RAMPS + optional).functions["refuelling"].outputs == ("ramp_a", "ramp_b")


def test_feedback_counts_as_a_supply() -> None:
    loop = RAMPS.replace("needs: filling, gives: {stroke_a: 1}", "needs: {and: [filling, other]}, gives: {stroke_a: 1}")
    echo = f"  echo: {{needs: stroke_a, gives: {{other: 1}}, {RUNS}}}\n"
    spec = spec_of(to("valve_driver_a", "valve_driver_b"), GAUGE + loop + VALVES + echo)
    assert DemuxPaths(spec).belongs("echo", "ramp_a")


@settings(max_examples=part_of(100), deadline=None)
@given(st.randoms(use_true_random=False))
def test_what_can_run_is_what_the_slow_search_finds(rng: random.Random) -> None:
    spec = random_spec(rng)
    paths = DemuxPaths(spec)
    for failed in [(), *((name,) for name in spec.modules), tuple(rng.sample(list(spec.modules), 2))]:
        assert {name for name in spec.modules if paths.can_run(name, without=failed)} == can_run(spec, failed)
