"""The paths behind a DEMUX: what belongs to a branch, and what `to` may and must name."""

import random
from collections import Counter
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dg.marked_spec import RUNS
from heronry_dg.demux_paths import DemuxPaths, end_mistakes
from heronry_dg.findings import SpecError
from heronry_dg.loader import load, loads
from heronry_dg.model import Demux, Device, Function, Spec
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


CASCADE = (
    f"  ramp_a: {{needs: filling, device: valve_a, {RUNS}}}\n"
    f"  ramp_b: {{needs: filling, gives: {{stroke_b: 1}}, {RUNS}}}\n"
    f"  valve_driver_b: {{device: valve_b, needs: second_filling, {RUNS}}}\n"
    f"  valve_driver_c: {{device: valve_b, needs: second_filling, {RUNS}}}\n"
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


@pytest.mark.parametrize("function", ["filling", "gauge_driver"])
def test_an_end_before_another_demux_is_refused_whether_or_not_a_function_names_it(function: str) -> None:
    text = f"{HEAD}gates: {{filling: {to('ramp_a', 'ramp_b')}, second_filling: {{demux: stroke_b}}}}\nmodules:\n"
    text = (text + GAUGE + CASCADE).replace("output: filling", f"output: {function}")
    with pytest.raises(SpecError, match=r"'ramp_b' cannot be an end: it drives no actuator, and leads on to valve_dr"):
        loads(text, "x.dg.yaml")
    loads(text.replace("second_filling: {demux: stroke_b}", "second_filling: stroke_b").replace(
        to("ramp_a", "ramp_b"), to("ramp_a", "valve_driver_c")), "x.dg.yaml")  # fmt: skip


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


def with_some_ends(rng: random.Random, spec: Spec) -> Spec:
    """Draw a DEMUX with or without `to`, with ends right and wrong, and put some modules on actuators."""
    devices = {name: Device(name, "actuator", device.pe) for name, device in spec.devices.items()}
    modules = {
        name: replace(module, device=rng.choice(list(devices)), runs_on=None) if rng.random() < 0.25 else module
        for name, module in spec.modules.items()
    }
    demuxes = {}
    for demux in spec.demuxes.values():
        ends = list(demux.to or demux.branches)
        match rng.randrange(6):
            case 0:
                ends = []
            case 1:
                ends = rng.sample(list(modules), 2)
            case 2:
                ends = list(demux.branches)
            case 3:
                ends = list(dict.fromkeys((demux.branches[0], ends[1])))
        demuxes[demux.name] = replace(demux, to=tuple(ends))
    functions = spec.functions
    if demuxes and rng.random() < 0.7:
        functions = {**functions, "moving": Function("moving", "x0", (), {None: "E"}, {None: rng.randrange(2)})}
    return replace(spec, devices=devices, modules=modules, demuxes=demuxes, functions=functions)


def is_broken(spec: Spec, demux: Demux) -> bool:
    """Tell whether the ends' rule of docs/semantics.md, section 2, is broken, read from the page word by word."""
    moving = {name for name, module in spec.modules.items() if module.device in spec.devices}  # all are actuators
    everything = can_run(spec, ())
    belongs = {branch: everything - can_run(spec, (branch,)) for branch in demux.branches}
    if demux.to:
        owners = [[branch for branch in demux.branches if end in belongs[branch]] for end in demux.to]
        if len(demux.to) != len(demux.branches) or any(len(own) != 1 for own in owners):
            return True
        if len({own[0] for own in owners}) < len(owners):
            return True
        return any(end not in moving and belongs[own[0]] & moving for end, own in zip(demux.to, owners, strict=True))
    if all(function.output != demux.name for function in spec.functions.values()):
        return False
    stuck = moving - can_run(spec, demux.branches)
    return any(
        belongs[branch] & moving or beyond(spec, branch) & stuck for branch in demux.branches if branch not in moving
    )


def beyond(spec: Spec, module: str) -> set[str]:
    """Modules to which a module may give data, directly or through others."""
    found: set[str] = set()
    while True:
        more = {
            reader.name
            for giver in {module, *found}
            for giving in spec.modules[giver].modes.values()
            for reader in spec.modules.values()
            for mode in reader.modes.values()
            for _, leaf in mode.leaves()
            if leaf.best <= giving.gives.get(leaf.variable, 0) <= leaf.worst
        }
        if more <= found:
            return found
        found |= more


def test_the_rule_of_ends_is_what_the_page_says() -> None:
    """Compare the rule with a second reading of the page, over random specs in which it is often broken."""
    counts: Counter[tuple[bool, bool]] = Counter()
    for seed in range(part_of(1_000, share=4)):
        rng = random.Random(seed)
        spec = with_some_ends(rng, random_spec(rng))
        found = {mistake.demux for mistake in end_mistakes(spec)}
        for demux in spec.demuxes.values():
            broken = is_broken(spec, demux)
            assert (demux.name in found) == broken, (seed, found)
            counts[bool(demux.to), broken] += 1
    assert min(counts[which] for which in ((True, True), (True, False), (False, True), (False, False))) >= 3
