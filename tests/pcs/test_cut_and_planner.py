"""The least cut is what the exact planner puts on the radio, where it has nothing else to choose.

Each side is one PE on one radio, nothing ran before, limits do not bind, and modules, modes and wires have no
alternative: only the places of modules are left, and level 6 decides them.
"""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_manager.planner.exact import plan
from heronry_manager.planner.greedy.planner import Greedy
from heronry_pcs.plan_graph import managers_side, plan_graph
from heronry_tools.analysis.control.cut import least_cut
from thoroughness import part_of

HEAD = """\
dg: 1
buses: {radio: {bitrate: 100000000, kind: wireless}}
manager: {bus: radio}
pes:
  air: {node_id: 92, buses: [radio], cpu: 100, ram: 1MiB, flash: 1MiB}
  ground: {node_id: 93, buses: [radio], cpu: 100, ram: 1MiB, flash: 1MiB}
"""
TYPES = ("FLOAT", "UCHAR", "SHORT")


def spec_without_alternatives(rng: random.Random) -> Spec:
    """Modules in a row, each reading what earlier ones give; every one that nothing reads is an output."""
    count = rng.randint(3, 9)
    variables = [f"  v{n}: {{type: {rng.choice(TYPES)}}}\n" for n in range(count)]
    modules, read = [], set[int]()
    for n in range(count):
        inputs = sorted(rng.sample(range(n), rng.randint(0, min(n, 3))))
        read.update(inputs)
        needs = f"needs: {{and: [{', '.join(f'v{i}' for i in inputs)}]}}, " if inputs else ""
        place = rng.choice(["runs_on: [air], ", "runs_on: [ground], ", "", "", ""])
        if n < 2:
            place = f"runs_on: [{('air', 'ground')[n]}], "
        rate = rng.choice((1, 10, 50))
        modules.append(f"  m{n}: {{{needs}{place}gives: {{v{n}: 1}}, cpu: 0.1, ram: 1KiB, rate_hz: {rate}}}\n")
    functions = [f"  f{n}: {{output: m{n}}}\n" for n in range(count) if n not in read]
    text = HEAD + "".join(["variables:\n", *variables, "modules:\n", *modules, "functions:\n", *functions])
    return loads(text, "random.dg.yaml")


@settings(max_examples=part_of(200, 20))
@given(st.integers(0, 2**32))
def test_level_6_is_the_least_cut(seed: int) -> None:
    spec = spec_without_alternatives(random.Random(seed))
    best = plan(spec, situation(spec))
    assert best.optimal
    assert len(best.configuration.modules) == len(spec.modules)
    cut = least_cut(plan_graph(spec, best.configuration), managers_side(spec))
    published = sum(bus.bits_per_s for bus in best.buses.values())
    assert best.objective.bus_bits_per_s == published == cut.mbit_per_s // 1000
    assert -best.objective.key()[-2] == cut.mbit_per_s


@pytest.mark.parametrize("down", [(), ("pe:nav",), ("device:gps",)])
def test_any_plan_publishes_at_least_its_cut(down: tuple[str, ...]) -> None:
    spec = load(shipped_spec_path("big_blue"))
    made = Greedy(spec).plan(situation(spec, down), None)
    cut = least_cut(plan_graph(spec, made.configuration), managers_side(spec))
    radios = sum(made.buses[bus.name].bits_per_s for bus in spec.buses.values() if bus.kind == "wireless")
    assert cut.mbit_per_s // 1000 <= radios
