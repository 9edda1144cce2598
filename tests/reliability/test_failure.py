"""The failure of a function against trying everything, and against the planner that has plenty of resources."""

import random

import pytest

from heronry_dg.gates import And, Leaf, Or
from heronry_dg.loader import load
from heronry_dg.model import Device, Mode, Module, Spec
from heronry_dg.shipped import example_specs
from heronry_dg.situation import elements
from heronry_tools.analysis.reliability.diagrams import Solution
from heronry_tools.analysis.reliability.failure import failure
from heronry_tools.analysis.servable import Planning, without_limits
from planner.random_specs import random_spec
from reliability.brute_force import Losing, disagreement, drawn_case, subsets
from thoroughness import part_of


@pytest.mark.parametrize("share", range(4))
def test_sets_and_probabilities_are_those_of_trying_everything(share: int) -> None:
    """Up to 12 elements, places and channels among them; feedback, modes, DEMUXes with and without ends."""
    for seed in range(share, part_of(2000, 16), 4):
        assert disagreement(random.Random(seed)) is None, f"PYTHONPATH=tests python -m reliability.brute_force {seed}"


def test_what_is_tried_has_choices_and_feedback() -> None:
    """Or the comparison above would prove little."""
    chosen = fed_back = 0
    for seed in range(120):
        spec, function, may_fail = drawn_case(random.Random(seed))
        formula = failure(spec, function, may_fail).formula
        chosen += any(name.startswith("choice") for name in formula.events)
        fed_back += any(variable.initial is not None for variable in spec.variables.values())
    assert chosen >= 5
    assert fed_back >= 20


def test_the_planner_with_plenty_agrees() -> None:
    for seed in range(part_of(160)):
        rng = random.Random(seed)
        spec = random_spec(rng, modules=5).in_phase(None)
        function = rng.choice(list(spec.functions))
        planning = Planning(without_limits(spec))
        found = failure(spec, function, elements(spec))
        for _ in range(12):
            down = frozenset(rng.sample(elements(spec), rng.randint(0, 3)))
            lost = not planning.all_at_once((function,), down).configuration
            assert found.formula.evaluate(found.root, down.__contains__) == lost, (seed, down)


@pytest.mark.parametrize("file", example_specs(), ids=lambda file: file.stem)
def test_only_what_is_in_reach_matters(file: object) -> None:
    spec = load(file)  # type: ignore[arg-type]
    for function in spec.functions:
        found = failure(spec.in_phase(None), function, elements(spec))
        solution = Solution(found.formula, found.root)
        assert set(solution.support()) <= found.reach
        planning = Planning(spec)
        outside = frozenset(one for one in elements(spec) if one not in found.reach)
        assert planning.all_at_once((function,), outside).configuration is not None


def with_two_modes(consumers: int) -> Spec:
    """A module that gives one datum in either mode, and consumers that need the one or the other."""
    base = load(example_specs()[0])
    pe = next(iter(base.pes))
    leaf_a, leaf_b = Leaf("a", 1, 1, (0,)), Leaf("b", 1, 1, (0,))
    modules = {
        "either": Module(
            "either", "either", {name: Mode(name, None, {name: 1}, 1, 1, 1000) for name in "ab"}, runs_on=(pe,)
        ),
        "spare": Module("spare", "spare", {"only": Mode("only", None, {"b": 1}, 1, 1, 1000)}, device="spare"),
        "user_a": Module("user_a", "user_a", {"only": Mode("only", leaf_a, {"x": 1}, 1, 1, 1000)}, runs_on=(pe,)),
        "user_b": Module("user_b", "user_b", {"only": Mode("only", leaf_b, {"y": 1}, 1, 1, 1000)}, runs_on=(pe,)),
    }
    leaves = (Leaf("x", 1, 1, (0,)), Leaf("y", 1, 1, (0,)))
    gate = And(leaves) if consumers == 2 else Or(1, leaves)
    modules["top"] = Module("top", "top", {"only": Mode("only", gate, {}, 1, 1, 1000)}, runs_on=(pe,))
    variable = next(iter(base.variables.values()))
    function = next(iter(base.functions.values()))
    return Spec(
        name="two_modes",
        digest="0" * 64,
        buses=base.buses,
        manager=base.manager,
        pes=base.pes,
        devices={"spare": Device("spare", "sensor", pe)},
        variables=dict.fromkeys("abxy", variable),
        demuxes={},
        shorthands={},
        modules=modules,
        functions={"f": type(function)("f", "top", ("top",), {None: "E"}, {None: 1})},
    )


def test_a_module_runs_in_one_mode() -> None:
    """For both users it must give a, so the other datum comes from the spare alone; one user takes any of them."""
    both, one = with_two_modes(2), with_two_modes(1)
    named = ["device:spare", "module:either", "module:user_a"]
    found = failure(both, "f", named)
    assert set(Solution(found.formula, found.root).sets(9)) == {frozenset({name}) for name in named}
    found = failure(one, "f", named)
    assert set(Solution(found.formula, found.root).sets(9)) == {frozenset({"device:spare", "module:either"})}
    for spec in (both, one):
        lost = Losing(spec, "f")
        found = failure(spec, "f", named)
        assert all(found.formula.evaluate(found.root, down.__contains__) == lost(down) for down in subsets(named))
