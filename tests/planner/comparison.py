"""The planner against brute force, case by case; as a program, over as many cases as there is time for.

    PYTHONPATH=tests python -m planner.comparison 0 5000            seeds 0 to 4999; every other one on a chain of buses
    PYTHONPATH=tests python -m planner.comparison 0 500 --modules 8
    PYTHONPATH=tests python -m planner.comparison 0 500 --checkpoints

A disagreement is printed with its seed, and makes the exit code 1.
"""

import itertools
import random
import sys
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

from heronry_dg.checkpoints import loads_mbit_per_s
from heronry_dg.gates import And, Expression, Leaf, Or, Xor, child_path, leaves
from heronry_dg.model import Bus, Demux, Manager, Pe, Spec
from heronry_dg.plan import Plan
from heronry_dg.situation import Situation, survivors
from heronry_dg.traffic import hops
from heronry_dg.verify import verify
from heronry_manager.planner.exact import plan
from lab.compared_seeds import report, seed_parser
from planner.enumerator import Enumerator, TooManyError
from planner.random_specs import (
    Case,
    plain_case,
    random_case,
    random_running,
    random_situation,
    with_checkpoints,
    with_phase_inputs_and_priorities,
)

MOST_STRUCTURES = 20_000  # of a case, or it is left out
MUST_APPEAR = (
    "and",
    "or",
    "optional input",
    "xor",
    "gate below gate",
    "first branch",
    "second branch",
    "demux of an expression",
    "rival drivers",
    "foreign frames",
    "first end",
    "other end",
    "path of one",
    "path of two",
    "path of three",
    "branch without its end",
    "gateway crossed",
    "feedback",
    "changes",
    "kept",
    "phase",
    "limit",
    "fault",
    "failed place",
    "priority changed",
    "priority changed to 0",
    "closed input",
    "something unserved",
    "binding cpu",
    "binding ram",
    "binding flash",
    "binding bus",
    "binding bus beside a gateway",
    "binding deadline",
    "binding separate",
    "binding together",
)


def crossing_case(rng: random.Random, *, modules: int = 6) -> Case:
    """Draw a case as `random_case` does, but on a chain of slow buses with modules bound to its ends."""
    drawn = plain_case(rng, modules=modules)
    length = rng.choice((2, 2, 3))
    buses = {
        name: Bus(
            name,
            bitrate=rng.choice((5_000, 10_000, 20_000, 50_000)),
            kind="wireless" if name == "b2" and rng.random() < 0.5 else "wired",
            heartbeat_ns=200_000_000,
            foreign=drawn.spec.buses["b0"].foreign if name == "b0" else (),
        )
        for name in [f"b{i}" for i in range(length)]
    }
    places = [("b0",), *itertools.pairwise(buses), (f"b{length - 1}",)]
    pes = {f"p{i}": Pe(f"p{i}", 92 + i, tuple(on), 1000, 1000, 1000) for i, on in enumerate(places)}
    homes = [(name,) for name in pes if name != "p1"]
    pinned = {
        name: replace(
            module,
            device=None,
            requires=frozenset(),
            runs_on=rng.choice([*homes, *homes, None]),
        )
        for name, module in drawn.spec.modules.items()
    }
    wanted = {
        name: replace(function, priority={None: rng.randint(1, 5)}) for name, function in drawn.spec.functions.items()
    }
    spec = replace(
        drawn.spec, buses=buses, manager=Manager("b0"), pes=pes, devices={}, modules=pinned, functions=wanted
    )
    now = random_situation(rng, spec) if rng.random() < 0.3 else Situation(phase=spec.initial_phase())
    return with_phase_inputs_and_priorities(rng, Case(spec, now, random_running(rng, spec)))


def compare(case: Case) -> tuple[str | None, set[str]]:
    """Plan a case and enumerate it: what they disagree about (None: nothing), and what the case put to use.

    Raises TooManyError for a case that is too large to enumerate.
    """
    enumerator = Enumerator(case.spec, case.now)
    best, _ = enumerator.best(case.running, most=MOST_STRUCTURES)
    found = plan(case.spec, case.now, case.running)
    broken = verify(case.spec, case.now, found.configuration)
    used = set(_used(case, found)) | {f"binding {reason}" for reason in enumerator.rejected if reason}
    kept = any(module.checkpoint is not None for module in case.spec.modules.values())
    if (
        kept
        and found.objective.key()
        < Enumerator(_without_checkpoints(case.spec), case.now).best(case.running, most=MOST_STRUCTURES)[0]
    ):
        used.add("binding checkpoints")
    if {"binding bus", "gateway crossed"} <= used:
        used.add("binding bus beside a gateway")
    if broken:
        return f"the plan is not legal: {broken[0]}", used
    if found.objective.key() != best:
        return f"the plan is worth {found.objective.key()}, the best is {best}", used
    return (None if found.optimal else "the best plan was found but not proven"), used


def _without_checkpoints(spec: Spec) -> Spec:
    return replace(spec, modules={name: replace(one, checkpoint=None) for name, one in spec.modules.items()})


def _used(case: Case, found: Plan) -> Iterator[str]:
    """What the plan shows in use."""
    configuration = found.configuration
    for name, running in configuration.modules.items():
        yield from _gates(configuration.mode(case.spec, name).needs, "", running.inputs.keys())
    for demux in case.spec.demuxes.values():
        if not isinstance(demux.needs, Leaf) and configuration.modules.keys() & set(demux.branches):
            yield "demux of an expression"
        for word, branch in zip(("first branch", "second branch"), demux.branches, strict=False):
            if branch in configuration.modules:
                yield word
        yield from _paths(demux, configuration.modules)
    if any(case.spec.buses[hop.bus].foreign for hop in hops(survivors(case.spec, case.now), configuration)):
        yield "foreign frames"
    if any(configuration.modules.keys() & set(group) for group in case.spec.drivers_of_one_actuator().values()):
        yield "rival drivers"
    feeds = {(consumer, wire.producer) for consumer, _, wire in configuration.wires()}
    yield from ("feedback" for a, b in feeds if (b, a) in feeds)
    yield from ("gateway crossed" for hop in hops(survivors(case.spec, case.now), configuration) if hop.after)
    wanted = [f for f in case.spec.functions.values() if case.now.priority_of(f)]
    kept = {name: (r.mode, r.pe) for name, r in configuration.modules.items()}.items() & (case.running or {}).items()
    shown = {
        "changes": found.objective.changes > 0,
        "kept": bool(kept),
        "phase": case.now.phase != case.spec.initial_phase(),
        "limit": bool(case.now.limits),
        "fault": bool(case.now.down),
        "failed place": any("@" in element for element in case.now.down),
        "priority changed": any(case.now.priorities.values()),
        "closed input": any(
            leaf.only_in is not None and case.now.phase not in leaf.only_in
            for name in configuration.modules
            for _, leaf in configuration.mode(case.spec, name).leaves()
        ),
        "priority changed to 0": 0 in case.now.priorities.values(),
        "something unserved": any(not found.functions[function.name].served for function in wanted),
    }
    if any(load for load in loads_mbit_per_s(survivors(case.spec, case.now), configuration).values()):
        yield "checkpoints"
    yield from (word for word, holds_here in shown.items() if holds_here)


def _paths(demux: Demux, runs: Collection[str]) -> Iterator[str]:
    """What of a DEMUX with `to` is in use."""
    for index, end in enumerate(demux.to):
        if end in runs:
            yield "first end" if index == 0 else "other end"
            yield "path of one" if end in demux.branches else {"1": "path of two", "2": "path of three"}[end[-1]]
    if demux.to and not set(demux.to) & set(runs) and set(demux.branches) & set(runs):
        yield "branch without its end"


def _gates(gate: Expression | None, path: str, wired: Collection[str]) -> Iterator[str]:
    """Kinds of the gates that hold with something wired below them."""
    if gate is None or isinstance(gate, Leaf) or not any(at in wired for at, _ in leaves(gate, path)):
        return
    match gate:
        case And():
            yield "and"
        case Or(0, _):
            yield "optional input"
        case Or():
            yield "or"
        case Xor():
            yield "xor"
    for index, child in enumerate(gate.inputs):
        if not isinstance(child, Leaf):
            yield "gate below gate"
        yield from _gates(child, child_path(path, index), wired)


def main() -> int:
    """Compare a range of seeds; returns the exit code."""
    parser = seed_parser(__doc__)
    parser.add_argument("--modules", type=int, default=6, help="most modules of a spec")
    parser.add_argument("--checkpoints", action="store_true", help="let about half of the modules have a checkpoint")
    arguments = parser.parse_args()

    def compared() -> Iterator[tuple[int, str | None, Iterable[str]]]:
        for seed in range(arguments.first, arguments.end):
            draw = crossing_case if seed % 2 else random_case
            case = draw(random.Random(seed), modules=arguments.modules)
            if arguments.checkpoints:
                case = with_checkpoints(random.Random(seed), case)
            try:
                wrong, used = compare(case)
            except TooManyError:
                yield seed, None, ["too large"]
            else:
                yield seed, wrong, [*used, "compared"]

    return report(compared())


if __name__ == "__main__":
    sys.exit(main())
