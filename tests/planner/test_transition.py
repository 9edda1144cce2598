"""Transitions: the verifier accepts what `transition` chooses, and the slices of the agents confirm both.

`loads_of` is a third opinion, without any knowledge of transitions: it puts PE by PE into its state, and sums what the
PEs' slices then publish and forward.
"""

import itertools
import random
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, situation, survivors
from heronry_dg.traffic import source_mbit_per_s
from heronry_dg.transition import Transition, Transitions, transition
from heronry_dg.verify_transition import MOST_MIXTURES, verify_transition
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.planner.exact import plan
from heronry_wire.configuration_slice import Slice, decode_slice
from heronry_wire.management import Step
from planner.comparison import crossing_case
from planner.random_specs import random_case, random_running, random_situation
from thoroughness import part_of

# Two sensors that do not fit on the bus together; which one is read is decided on `sink`, and nothing moves.
SWAP = """
dg: 1
name: swap
buses: {can0: {bitrate: 100000}}
pes:
  left:  {node_id: 92, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  right: {node_id: 93, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  sink:  {node_id: 94, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  key:   {node_id: 95, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
devices:
  eye_left:  {kind: sensor, pe: left}
  eye_right: {kind: sensor, pe: right}
  key_1: {kind: sensor, pe: key}
  screen_left: {kind: actuator, pe: sink}
  screen_right: {kind: actuator, pe: sink}
variables:
  view_left: {type: FLOAT, deadline_ms: 100}
  view_right: {type: FLOAT, deadline_ms: 100}
  unlocked: {type: UCHAR}
modules:
  look_left:  {device: eye_left, gives: {view_left: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 300}
  look_right: {device: eye_right, gives: {view_right: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 300}
  unlock: {device: key_1, gives: {unlocked: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  show_left: {device: screen_left, needs: {and: [view_left, unlocked]}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  show_right: {device: screen_right, needs: view_right, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions:
  left:  {output: show_left, criticality: A, priority: 100}
  right: {output: show_right, criticality: B, priority: 50}
"""


def direct(way: Transition) -> Transition:
    """The same without waiting for any PE."""
    return replace(way, steps=(Step.GO_ALL,), wait_for={}, hold=())


def slices_of(spec: Spec, configuration: Configuration) -> dict[str, Slice]:
    compiler = Compiler(spec)
    compiled = compiler.configuration(configuration)
    decoded = {}
    for pe in spec.pes.values():
        leaves = {
            (module.index, number): len(mode.leaves)
            for module in compiler.table(pe.name).modules
            for number, mode in enumerate(module.modes)
        }
        decoded[pe.name] = decode_slice(compiled.slices[pe.node_id], leaves)
    return decoded


def agents_slice(before: Slice, after: Slice, state: str) -> Slice:
    """What an agent publishes and forwards, and the modules that it really runs."""
    if state == "before":
        return before
    if state == "after":
        return after
    then = {module.module: module.mode for module in after.modules}
    kept = tuple(module for module in before.modules if then.get(module.module) == module.mode)
    return replace(after.restricted_to(before), modules=kept)


def loads_of(spec: Spec, slices: Mapping[str, Slice]) -> dict[str, int]:
    """Let the agents hold these slices; what is published on each bus, in thousandths of a bit/s."""
    sources, modules = list(spec.sources()), list(spec.modules.values())
    loads = dict.fromkeys(spec.buses, 0)
    for pe, held in slices.items():
        node = spec.pes[pe].node_id
        for running in held.modules:
            module = modules[running.module]
            mode = list(module.modes.values())[running.mode]
            for variable in mode.gives:
                index = sources.index((module.name, variable))
                buses = {bus for port, bus in enumerate(spec.pes[pe].buses) if held.publish.get(index, 0) >> port & 1}
                grown = True
                while grown:
                    onto = {
                        bus
                        for other, theirs in slices.items()
                        if other != pe
                        and theirs.forward.get(index, (0, 0))[0] == node
                        and buses & set(spec.pes[other].buses)
                        for port, bus in enumerate(spec.pes[other].buses)
                        if theirs.forward[index][1] >> port & 1
                    }
                    grown = not onto <= buses
                    buses |= onto
                for bus in buses:
                    loads[bus] += source_mbit_per_s(spec, variable, mode)
    return loads


def mixtures(spec: Spec, now: Situation, way: Transition) -> Iterator[dict[str, str]]:
    """Every state of every PE that can be commanded, step by step."""
    states = {pe: {"before"} for pe in survivors(spec, now).pe_cpu_millis}
    for step in way.steps:
        for possible in states.values():
            possible.add("broken" if step is Step.BREAK else "after")
        yield from (dict(zip(states, each, strict=True)) for each in itertools.product(*map(sorted, states.values())))
        if step is Step.BREAK:
            for pe in way.wait_for:
                states[pe] = {"broken"}


def worst_of(
    spec: Spec, before: Configuration, after: Configuration, now: Situation, way: Transition
) -> dict[str, int]:
    """The most on each bus on the way, as the agents would have it."""
    old, new = slices_of(spec, before), slices_of(spec, after)
    worst = dict.fromkeys(spec.buses, 0)
    for states in mixtures(spec, now, way):
        held = {pe: agents_slice(old[pe], new[pe], state) for pe, state in states.items()}
        for bus, carried in loads_of(spec, held).items():
            worst[bus] = max(worst[bus], carried)
    return worst


def limits_of(spec: Spec, before: Configuration, now: Situation) -> dict[str, int]:
    left = survivors(spec, now)
    carried = loads_of(spec, {pe: held for pe, held in slices_of(spec, before).items() if pe in left.pe_cpu_millis})
    return {bus: max(room, carried[bus]) for bus, room in left.bus_mbit_per_s.items()}


def pair(rng: random.Random) -> tuple[Spec, Configuration, Configuration, Situation]:
    """A spec, what runs, and what is to run after something has happened, on buses that just carry either."""
    case = crossing_case(rng) if rng.random() < 0.7 else random_case(rng, modules=6)
    spec, now = case.spec, random_situation(rng, case.spec)
    before = plan(spec, random_situation(rng, spec), case.running).configuration
    after = plan(spec, now, placement(before) if rng.random() < 0.5 else None).configuration
    return tight(rng, spec, before, after), before, after, replace(now, limits={})


@settings(max_examples=part_of(60), deadline=None)
@given(st.randoms(use_true_random=False))
def test_what_is_chosen_is_accepted_and_the_agents_exceed_nothing(rng: random.Random) -> None:
    spec, before, after, now = pair(rng) if rng.random() < 0.3 else squeezed(rng, buses=rng.randint(1, 3))
    way = transition(spec, before, after, now)
    assert verify_transition(spec, before, after, now, way) == []
    limits = limits_of(spec, before, now)
    worst = worst_of(spec, before, after, now, way)
    assert {bus: worst[bus] for bus in limits if worst[bus] > limits[bus]} == {}
    assert all(way.peaks[bus].mbit_per_s >= worst[bus] for bus in limits) or way.wait_for
    blind = transition(spec, placement(before), after, now)
    assert verify_transition(spec, placement(before), after, now, blind) == []
    assert verify_transition(spec, before, after, now, blind) == []
    assert len(blind.steps) >= len(way.steps)


@settings(max_examples=part_of(40), deadline=None)
@given(st.randoms(use_true_random=False))
def test_from_anything_that_a_user_says_runs_there_is_a_way_that_the_verifier_accepts(rng: random.Random) -> None:
    case = random_case(rng, modules=6)
    before, after = random_running(rng, case.spec) or {}, plan(case.spec, case.now, case.running).configuration
    way = transition(case.spec, before, after, case.now)
    assert verify_transition(case.spec, before, after, case.now, way) == []
    configured = Configuration({name: Running(pe, mode) for name, (mode, pe) in before.items()})
    way = transition(case.spec, configured, after, case.now)
    assert verify_transition(case.spec, configured, after, case.now, way) == []


def test_waiting_for_fewer_would_not_do() -> None:
    seen = {"exclusive": 0, "budget": 0, "one step": 0}
    for seed in range(160):
        spec, before, after, now = squeezed(random.Random(seed))
        way = transition(spec, before, after, now)
        assert verify_transition(spec, before, after, now, way) == [], seed
        seen["one step"] += way.steps == (Step.GO_ALL,)
        for pe, why in way.wait_for.items():
            seen["budget" if all(one.startswith("makes room") for one in why) else "exclusive"] += 1
            fewer = {other: reason for other, reason in way.wait_for.items() if other != pe}
            steps = way.steps if fewer else way.steps[1:]
            assert verify_transition(spec, before, after, now, replace(way, wait_for=fewer, steps=steps)), (seed, pe)
    assert min(seen.values()) > 8, seen


def test_the_verifier_accepts_the_same_where_it_can_play_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("heronry_dg.verify_transition.MOST_MIXTURES", 1)
    refused = 0
    for seed in range(60):
        spec, before, after, now = squeezed(random.Random(seed), buses=3)
        way = transition(spec, before, after, now)
        assert verify_transition(spec, before, after, now, way) == [], seed
        refused += bool(way.wait_for) and bool(verify_transition(spec, before, after, now, direct(way)))
    assert refused > 10


def test_a_pe_that_is_not_needed_once_others_wait_is_not_waited_for() -> None:
    lines = ["dg: 1", "name: two", "buses: {b0: {bitrate: 1000000}, b1: {bitrate: 1000000}}", "manager: {bus: b0}"]
    places = {"both": "b0, b1", "old0": "b0", "new0": "b0", "read0": "b0", "old1": "b1", "new1": "b1", "read1": "b1"}
    lines += ["pes:"]
    lines += [
        f"  {pe}: {{node_id: {92 + i}, buses: [{on}], cpu: 1, ram: 1MiB, flash: 1MiB}}"
        for i, (pe, on) in enumerate(places.items())
    ]
    rates = {"both": 300, "old0": 400, "old1": 400, "new0": 400, "new1": 400}
    reads = {
        "r0": ("read0", "both"), "r1": ("read1", "both"), "r2": ("read0", "old0"),
        "r3": ("read1", "old1"), "r4": ("read0", "new0"), "r5": ("read1", "new1"),
    }  # fmt: skip
    lines += ["variables:", *(f"  v_{pe}: {{type: FLOAT}}" for pe in rates), "modules:"]
    lines += [
        f"  m_{pe}: {{runs_on: [{pe}], gives: {{v_{pe}: 1}}, cpu: 0.1, ram: 1KiB, rate_hz: {rate}}}"
        for pe, rate in rates.items()
    ]
    lines += [
        f"  {name}: {{needs: v_{what}, runs_on: [{pe}], cpu: 0.1, ram: 1KiB, rate_hz: 1}}"
        for name, (pe, what) in reads.items()
    ]
    lines += ["functions:", *(f"  f_{name}: {{output: {name}}}" for name in reads)]
    spec = loads("\n".join(lines) + "\n", "two.dg.yaml")

    def running(*names: str) -> Configuration:
        sources = {f"m_{reads[name][1]}": Running(reads[name][1], "only") for name in names}
        readers = {
            name: Running(reads[name][0], "only", {"": Wire(f"m_{reads[name][1]}", f"v_{reads[name][1]}", 1)})
            for name in names
        }
        return Configuration(sources | readers)

    before, after = running("r0", "r1", "r2", "r3"), running("r4", "r5")
    just = {name: replace(bus, bitrate=1 + 700 * 135 * 10 // 7) for name, bus in spec.buses.items()}
    spec = replace(spec, buses=just)
    way = transition(spec, before, after, situation(spec))
    assert way.wait_for.keys() == {"old0", "old1"}  # what is on both buses helps most at first, and is not needed then
    assert verify_transition(spec, before, after, situation(spec), way) == []


def test_the_verifier_looks_at_the_pes_and_at_the_steps_themselves() -> None:
    spec = load(shipped_spec_path("elevator_and_chute"))
    after, now = plan(spec, situation(spec)).configuration, situation(spec, [], ["pe:tail_pe=1%"])
    way = transition(spec, {}, after, now)
    assert {v.rule for v in verify_transition(spec, {}, after, now, way)} == {"t.cpu"}
    assert verify_transition(spec, after, after, now, transition(spec, after, after, now)) == []
    broken = replace(way, steps=(Step.BREAK, Step.GO_ALL))
    assert "t.wait" in {v.rule for v in verify_transition(spec, {}, after, now, broken)}
    assert "t.steps" in {v.rule for v in verify_transition(spec, {}, after, now, replace(way, steps=()))}


def squeezed(rng: random.Random, *, buses: int = 1) -> tuple[Spec, Configuration, Configuration, Situation]:
    """Two configurations of sensors and readers on a chain of buses that just carry either; few of them move."""
    pes = {f"p{i}": [f"b{rng.randrange(buses)}"] for i in range(rng.randint(2, 4))}
    pes |= {f"g{i}": [f"b{i}", f"b{i + 1}"] for i in range(buses - 1)}
    count = rng.randint(2, 4)
    lines = ["dg: 1", "name: squeezed", "buses:", *(f"  b{i}: {{bitrate: 1000000}}" for i in range(buses))]
    lines += ["manager: {bus: b0}", "pes:"]
    lines += [
        f"  {pe}: {{node_id: {92 + i}, buses: [{', '.join(on)}], cpu: 4, ram: 1MiB, flash: 1MiB}}"
        for i, (pe, on) in enumerate(pes.items())
    ]
    lines += ["variables:", *(f"  v{i}: {{type: FLOAT, versions: 2}}" for i in range(count)), "modules:"]
    for i in range(count):
        lines += [f"  m{i}:", "    modes:"]
        for mode, (version, rate) in {"fast": (1, rng.randint(100, 300)), "slow": (2, rng.randint(10, 80))}.items():
            lines.append(f"      {mode}: {{gives: {{v{i}: {version}}}, cpu: 0.01, ram: 1KiB, rate_hz: {rate}}}")
        for pe in pes:
            lines.append(f"  r{i}_{pe}: {{needs: v{i}, runs_on: [{pe}], cpu: 0.01, ram: 1KiB, rate_hz: 10}}")
    lines += ["functions:", *(f"  f{i}_{pe}: {{output: r{i}_{pe}}}" for i in range(count) for pe in pes)]
    spec = loads("\n".join(lines) + "\n", "squeezed.dg.yaml")
    homes = rng.choices(list(pes), k=count)
    later = [rng.choice(list(pes)) if rng.random() < 0.1 else home for home in homes]
    before, after = (_drawn(rng, list(pes), there) for there in (homes, later))
    return tight(rng, spec, before, after), before, after, situation(spec)


def _drawn(rng: random.Random, pes: list[str], homes: list[str]) -> Configuration:
    """Some of the sensors, in drawn modes, and some of the readers."""
    modules = {}
    for i, home in enumerate(homes):
        version, mode = rng.choice(((1, "fast"), (1, "fast"), (2, "slow")))
        readers = rng.sample(pes, rng.randint(0, 2))
        if readers:
            modules[f"m{i}"] = Running(home, mode)
            modules |= {f"r{i}_{pe}": Running(pe, "only", {"": Wire(f"m{i}", f"v{i}", version)}) for pe in readers}
    return Configuration(modules)


def tight(rng: random.Random, spec: Spec, *configurations: Configuration) -> Spec:
    """The spec, with buses that just carry each of these configurations."""
    carried = [loads_of(spec, slices_of(spec, one)) for one in configurations]
    buses = {
        name: replace(bus, bitrate=1 + max(load[name] for load in carried) * rng.choice((10, 11, 13)) // 7_000)
        for name, bus in spec.buses.items()
    }
    return replace(spec, buses={name: replace(bus, max_load=Fraction(8, 10)) for name, bus in buses.items()})


@pytest.fixture
def swap() -> tuple[Spec, Configuration, Configuration, Situation]:
    spec = loads(SWAP, "swap.dg.yaml")
    now = situation(spec, ["pe:key"])
    before = plan(spec, situation(spec)).configuration
    return spec, before, plan(spec, now, placement(before)).configuration, now


def test_a_pe_that_fills_the_bus_stops_before_another_one_fills_it(
    swap: tuple[Spec, Configuration, Configuration, Situation],
) -> None:
    spec, before, after, now = swap
    assert {"look_left"} <= before.modules.keys()
    assert {"look_right"} <= after.modules.keys()
    way = transition(spec, before, after, now)
    assert way.steps == (Step.BREAK, Step.GO_ALL)
    assert way.wait_for == {"left": ("makes room on can0",)}
    assert way.interrupted == ()
    assert way.peaks["can0"].mbit_per_s == 135 * 300_000
    (refusal,) = verify_transition(spec, before, after, now, direct(way))
    assert (refusal.rule, refusal.where) == ("t.bus", "bus can0")
    assert "81000.000 bit/s in transition, but its limit is 70000.000" in refusal.sentence


def test_where_the_wires_are_not_known_everything_given_may_be_on_the_bus(
    swap: tuple[Spec, Configuration, Configuration, Situation],
) -> None:
    spec, before, after, now = swap
    blind = transition(spec, placement(before), after, now)
    assert blind.wait_for.keys() == {"left"}
    strangers = dict(placement(before)) | {
        "nobody": ("only", "left"),
        "look_right": ("fast", "right"),
        "unlock": ("only", "-"),
    }
    assert transition(spec, strangers, after, now) == blind
    of_nobody = {"": Wire("look_left", "view_right", 1), "0": Wire("nobody", "view_left", 1)}
    misread = Configuration({**before.modules, "nobody": Running("left", "only", of_nobody)})
    misread = Configuration({**misread.modules, "unlock": Running("key", "only", of_nobody)})
    assert transition(spec, misread, after, now) == transition(spec, before, after, now)
    assert verify_transition(spec, misread, after, now, transition(spec, misread, after, now)) == []


def test_a_silent_pe_keeps_its_demux_until_it_has_certainly_stopped() -> None:
    spec = load(shipped_spec_path("big_blue"))
    before = plan(spec, situation(spec, phase="glide")).configuration
    now = situation(spec, ["pe:tail_a"], phase="glide")
    after = plan(spec, now, placement(before)).configuration
    way = transition(spec, before, after, now)
    assert "elevator_out" in way.hold
    assert way.steps[-2:] == (Step.GO, Step.GO_ALL)
    assert "elevator" in way.interrupted
    assert verify_transition(spec, before, after, now, way) == []
    rash = replace(way, steps=tuple(step for step in way.steps if step is not Step.GO))
    assert {v.rule for v in verify_transition(spec, before, after, now, rash)} == {"t.exclusive"}


def test_what_moves_is_given_up_first_and_the_verifier_says_so_too() -> None:
    spec = load(shipped_spec_path("elevator_and_chute"))
    after = plan(spec, situation(spec)).configuration
    mover = next(m for m in after.modules if spec.modules[m].device is None)
    here = after.modules[mover].pe
    there = next(pe for pe in spec.pes if pe != here)
    before = Configuration({**after.modules, mover: replace(after.modules[mover], pe=there)})
    way = transition(spec, before, after, situation(spec))
    assert way.wait_for == {there: (f"{mover} moves to {here}",)}
    assert way.interrupted
    assert verify_transition(spec, before, after, situation(spec), way) == []
    (refusal,) = verify_transition(spec, before, after, situation(spec), direct(way))
    assert refusal.rule == "t.exclusive"
    assert verify_transition(spec, before, after, situation(spec), replace(way, steps=(Step.GO_ALL, Step.BREAK)))
    stranger = replace(way, wait_for={**way.wait_for, "tail_pe": ()})
    assert verify_transition(spec, before, after, situation(spec, ["pe:tail_pe"]), stranger)


def test_from_nothing_to_something_takes_one_step() -> None:
    spec = load(shipped_spec_path("big_blue"))
    after = plan(spec, situation(spec)).configuration
    way = transition(spec, {}, after, situation(spec))
    assert (way.steps, way.wait_for, way.interrupted) == ((Step.GO_ALL,), {}, ())
    assert Transitions(spec).must_break({}, after, situation(spec), {"nav"}) == {"nav"}


def test_where_there_are_too_many_mixtures_to_play_the_verifier_takes_the_worst_of_each() -> None:
    lines = ["dg: 1", "name: many", "buses: {can0: {bitrate: 100000}}", "pes:"]
    lines += [f"  p{i}: {{node_id: {92 + i}, buses: [can0], cpu: 1, ram: 1MiB, flash: 1MiB}}" for i in range(15)]
    lines += ["variables:", *(f"  v{i}: {{type: FLOAT}}" for i in range(14)), "modules:"]
    lines += [f"  m{i}: {{runs_on: [p{i}], gives: {{v{i}: 1}}, cpu: 0.1, ram: 1KiB, rate_hz: 64}}" for i in range(14)]
    lines += [f"  r{i}: {{needs: v{i}, runs_on: [p14], cpu: 0.01, ram: 1KiB, rate_hz: 10}}" for i in range(14)]
    lines += ["functions:", *(f"  f{i}: {{output: r{i}}}" for i in range(14))]
    spec = loads("\n".join(lines) + "\n", "many.dg.yaml")
    first, last = some_of(range(8)), some_of(range(7, 14))
    assert MOST_MIXTURES < 2**13
    way = transition(spec, first, last, situation(spec))
    assert way.steps == (Step.BREAK, Step.GO_ALL)
    assert verify_transition(spec, first, last, situation(spec), way) == []
    (refusal,) = verify_transition(spec, first, last, situation(spec), direct(way))
    assert refusal.rule == "t.bus"
    assert f"{14 * 64 * 135}.000 bit/s" in refusal.sentence


def some_of(numbers: range) -> Configuration:
    modules = {f"m{i}": Running(f"p{i}", "only") for i in numbers}
    return Configuration(modules | {f"r{i}": Running("p14", "only", {"": Wire(f"m{i}", f"v{i}", 1)}) for i in numbers})


def test_the_ends_of_a_demux_are_exclusive_though_its_branches_share_a_pe() -> None:
    spec = load("dg_specs/examples/demux_paths.dg.yaml")
    before = plan(spec, situation(spec)).configuration
    switched = situation(spec, ["device:elevator_servo_1"])
    after = plan(spec, switched, placement(before)).configuration
    way = transition(spec, before, after, switched)
    assert way.wait_for == {"tail_a": ("limited_servo_1 gives elevator_out.to up to tail_b",)}
    assert verify_transition(spec, before, after, switched, way) == []
    assert {v.rule for v in verify_transition(spec, before, after, switched, direct(way))} == {"t.exclusive"}
    silent = situation(spec, ["pe:tail_a"])
    way = transition(spec, before, after, silent)
    assert (way.steps, way.hold) == ((Step.GO, Step.GO_ALL), ("elevator_out",))
    assert verify_transition(spec, before, after, silent, way) == []
    assert {v.where for v in verify_transition(spec, before, after, silent, direct(way))} == {
        "end of demux elevator_out"
    }
