"""What a change of the spec does to running modules, judged by the tables and slices that the PEs would get.

The judge shares no code with `spec_change`: it takes two tables of one PE and two slices, turns indices into names and
identifiers, and compares what is said of a module.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.configuration import Configuration
from heronry_dg.field_types import Criticality
from heronry_dg.loader import load, loads
from heronry_dg.model import Checkpoint, Device, Function, Mode, Module, Pe, Spec
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_dg.spec_change import SpecChange, spec_change
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.planner.exact import plan
from heronry_wire.configuration_slice import decode_slice
from planner.random_specs import random_spec
from thoroughness import part_of

SPEC = load(shipped_spec_path("elevator_and_chute"))


def what_pes_are_told(spec: Spec, running: Configuration) -> dict[str, object]:
    """Say of each running module what its PE is told: its entry, what it sends, and the identifiers that it reads."""
    compiler = Compiler(spec)
    slices = compiler.configuration(running).slices
    told: dict[str, object] = {}
    for pe in spec.pes.values():
        table = compiler.table(pe.name)
        entries = {entry.index: entry for entry in table.modules}
        for one in decode_slice(slices[pe.node_id], table.leaf_counts()).modules:
            entry = entries[one.module]
            leaves = entry.modes[one.mode].leaves
            reads = [
                (leaf, None if source is None else replace(table.sources[source], period_ns=1, movable=False))
                for leaf, source in zip(leaves, one.sources, strict=True)
            ]
            sends = [
                (source.variable, source.identifier)
                for source in table.sources
                if source.module == entry.name  # its own data, in whichever mode
            ]
            told[entry.name] = (pe.name, one.mode, replace(entry, index=0), reads, sends)
    return told


def changed(rng: random.Random, spec: Spec) -> Spec:
    """Change a spec as a developer does: rates, budgets, images, devices, classes; modules and PEs come and go."""
    for change in rng.sample(CHANGES, rng.randint(0, 2)):
        spec = change(rng, spec)
    return spec


def _module(rng: random.Random, spec: Spec) -> Module:
    return spec.modules[rng.choice(list(spec.modules))]


def _with(spec: Spec, module: Module) -> Spec:
    return replace(spec, modules={**spec.modules, module.name: module})


def another_rate(rng: random.Random, spec: Spec) -> Spec:
    module = _module(rng, spec)
    modes = {name: replace(mode, rate_mhz=mode.rate_mhz // 2) for name, mode in module.modes.items()}
    return _with(spec, replace(module, modes=modes))


def another_budget(rng: random.Random, spec: Spec) -> Spec:
    module = _module(rng, spec)
    modes = {name: replace(mode, cpu_millis=mode.cpu_millis + 1) for name, mode in module.modes.items()}
    return _with(spec, replace(module, modes=modes))


def another_image(rng: random.Random, spec: Spec) -> Spec:
    return _with(spec, replace(_module(rng, spec), image="other"))


def another_class(rng: random.Random, spec: Spec) -> Spec:
    name = rng.choice(list(spec.functions))
    criticality: Criticality = rng.choice(("A", "B", "E"))
    function = replace(spec.functions[name], criticality={None: criticality})
    return replace(spec, functions={**spec.functions, name: function})


def pe_joins(_: random.Random, spec: Spec) -> Spec:
    bus = next(iter(spec.buses))
    return replace(spec, pes={**spec.pes, "px": Pe("px", 120, (bus,), 600, 400, 400, frozenset(("fpu", "camera")))})


def module_joins(rng: random.Random, spec: Spec) -> Spec:
    """A module comes first in the file, so that all indices and many identifiers are others."""
    variable = rng.choice(list(spec.variables))
    modes = {"only": Mode("only", None, {variable: 1}, 5, 5, 50_000)}
    module = Module("mx", "mx", modes, runs_on=(next(iter(spec.pes)),))
    function = Function("gx", "mx", ("mx",), {None: "A"}, {None: 1}, None)
    return replace(spec, modules={"mx": module, **spec.modules}, functions={"gx": function, **spec.functions})


def device_joins(_: random.Random, spec: Spec) -> Spec:
    return replace(spec, devices={"dx": Device("dx", "sensor", next(iter(spec.pes))), **spec.devices})


CHANGES: tuple[Callable[[random.Random, Spec], Spec], ...] = (
    another_rate,
    another_budget,
    another_image,
    another_class,
    pe_joins,
    module_joins,
    device_joins,
)


def compared(old: Spec, new: Spec, at: Situation | None = None) -> tuple[SpecChange, Configuration, Configuration]:
    now = at or Situation(phase=old.initial_phase())
    before = plan(old, now).configuration
    after = plan(new, now, placement(before)).configuration
    return spec_change(old, before, new, after), before, after


@given(st.randoms(use_true_random=False))
@settings(max_examples=part_of(400), deadline=None)
def test_a_module_is_unchanged_if_its_pe_is_told_the_same(rng: random.Random) -> None:
    old = random_spec(rng, modules=6)
    new = changed(rng, old)
    found, before, after = compared(old, new)
    was, becomes = what_pes_are_told(old, before), what_pes_are_told(new, after)
    for name in found.with_fate("unchanged"):
        assert was[name] == becomes[name], name
    for name in found.with_fate("rewired"):
        (*_, entry, _, sends), (*_, entry_then, _, sends_then) = _parts(was[name]), _parts(becomes[name])
        assert (entry, sends) == (entry_then, sends_then)
    for name in found.with_fate("changed"):
        assert before.modules[name].pe == after.modules[name].pe
    same = {name for name in was.keys() & becomes.keys() if was[name] == becomes[name]}
    untold = {"data", "needs", "memory", "device", "checkpoint", "silence", "exclusive"}  # the entry has not all of it
    for one in found.modules:
        if one.module in same:
            assert one.fate in ("unchanged", "rewired") or set(one.differs) <= untold


def _parts(told: object) -> tuple[object, ...]:
    assert isinstance(told, tuple)
    return told


@given(st.randoms(use_true_random=False))
@settings(max_examples=part_of(200), deadline=None)
def test_each_running_module_has_one_fate_and_the_way_back_is_the_mirror(rng: random.Random) -> None:
    old = random_spec(rng, modules=6)
    new = changed(rng, old)
    there, before, after = compared(old, new)
    assert sorted(one.module for one in there.modules) == sorted({**before.modules, **after.modules})
    back = spec_change(new, after, old, before)
    mirror = {"started": "stopped", "stopped": "started"}
    assert {one.module: mirror.get(one.fate, one.fate) for one in there.modules} == {
        one.module: one.fate for one in back.modules
    }
    assert [(one.identifier, one.new, one.old, one.is_driven) for one in there.passing] == [
        (one.identifier, one.old, one.new, one.is_driven) for one in back.passing
    ]
    ends = {"joins": "leaves", "leaves": "joins"}
    assert {(one.element, ends.get(one.change, one.change)) for one in there.hardware} == {
        (one.element, one.change) for one in back.hardware
    }


@given(st.randoms(use_true_random=False))
@settings(max_examples=part_of(100), deadline=None)
def test_the_same_spec_and_plan_change_nothing(rng: random.Random) -> None:
    spec = random_spec(rng, modules=6)
    running = plan(spec, Situation(phase=spec.initial_phase())).configuration
    found = spec_change(spec, running, spec, running)
    assert found.with_fate("unchanged") == tuple(name for name in spec.modules if name in running.modules)
    assert (len(found.modules), found.hardware, found.passing) == (len(running.modules), (), ())


def replaced(name: str, **fields: object) -> Spec:
    return _with(SPEC, replace(SPEC.modules[name], **fields))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fields", "part"),
    [
        ({"image": "other"}, "image"),
        ({"restarts": 5}, "restarts"),
        ({"silent": "fails"}, "silence"),
        ({"partition": "own"}, "process"),
        ({"flash": 1}, "memory"),
        ({"checkpoint": Checkpoint(8, 1000, 10**9)}, "checkpoint"),
    ],
)
def test_each_part_of_a_definition_is_named(fields: Mapping[str, object], part: str) -> None:
    found, _, _ = compared(SPEC, replaced("angle_driver", **fields))
    (one,) = (one for one in found.modules if one.module == "angle_driver")
    assert (one.fate, one.differs) == ("changed", (part,))


def test_what_only_the_planner_reads_changes_no_module() -> None:
    functions = {name: replace(one, priority={None: 7}) for name, one in SPEC.functions.items()}
    pes = {name: replace(one, rate_per_h=None) for name, one in SPEC.pes.items()}
    found, before, _ = compared(SPEC, replace(SPEC, functions=functions, pes=pes))
    assert set(found.with_fate("unchanged")) == before.modules.keys()
    assert found.hardware == ()


def test_a_renamed_module_stops_and_starts_and_its_identifiers_pass() -> None:
    text = shipped_spec_path("elevator_and_chute").read_text()
    found, _, _ = compared(SPEC, loads(text.replace("angle_driver:", "angle_reader:"), "new"))
    assert found.with_fate("stopped") == ("angle_driver",)
    assert found.with_fate("started") == ("angle_reader",)
    passing = {one.old[0]: one for one in found.passing}
    assert passing["angle_driver"].new[0] == "angle_reader"
    assert passing["angle_driver"].is_driven
