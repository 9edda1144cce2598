"""Legal configurations with one thing changed, of which the verifier must find the illegal ones.

    PYTHONPATH=tests python -m planner.mutants 0 2000     seeds 0 to 1999: how many of each kind, and the results

A mutation is drawn by a seed and changes one thing, as a defect of a planner or of a link might. Brute force lists
every legal configuration, and so decides whether the mutant is still legal. The verifier must agree with it.
"""

import argparse
import random
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.gates import And, Expression, Leaf, Or, Xor, child_path, leaves
from heronry_dg.model import Mode
from heronry_dg.verify import verify
from planner.enumerator import Enumerator, TooManyError
from planner.random_specs import Case, random_case

MOST = 300  # legal configurations of a case, or it is left out
Modules = dict[str, Running]
Mutation = Callable[["Drawn"], Modules | None]  # None: there is nothing of the kind to change
Canonical = frozenset[tuple[str, str, str, frozenset[tuple[str, str, str, int]]]]


@dataclass(frozen=True, slots=True)
class Drawn:
    """A legal configuration, and the dice."""

    rng: random.Random
    case: Case
    modules: Mapping[str, Running]

    def mode(self, name: str) -> Mode:
        return self.case.spec.modules[name].modes[self.modules[name].mode]

    def one(self, names: Iterator[str] | None = None) -> str | None:
        """Draw one of some running modules, or of all."""
        found = list(self.modules if names is None else names)
        return self.rng.choice(found) if found else None

    def wired(self) -> tuple[str, str] | None:
        """Draw a wired input: module and path."""
        inputs = [(name, path) for name, running in self.modules.items() for path in running.inputs]
        return self.rng.choice(inputs) if inputs else None

    def with_pe(self, name: str, pe: str) -> Modules:
        return {**self.modules, name: replace(self.modules[name], pe=pe)}

    def with_wire(self, name: str, path: str, wire: Wire) -> Modules:
        running = self.modules[name]
        return {**self.modules, name: replace(running, inputs={**running.inputs, path: wire})}

    def without_wire(self, name: str, path: str) -> Modules:
        inputs = {at: wire for at, wire in self.modules[name].inputs.items() if at != path}
        return {**self.modules, name: replace(self.modules[name], inputs=inputs)}


def mutated(rng: random.Random, case: Case, configuration: Configuration) -> Configuration:
    """Mutate a configuration, be it legal or not, that has no unknown names in it, in a way that brings in none."""
    known = [mutation for kind, mutation in MUTATIONS.items() if "unknown" not in kind]
    modules = rng.choice(known)(Drawn(rng, case, configuration.modules))
    return configuration if modules is None else Configuration(modules)


# Modules


def stop(drawn: Drawn) -> Modules | None:
    name = drawn.one()
    return None if name is None else {other: running for other, running in drawn.modules.items() if other != name}


def stop_a_producer(drawn: Drawn) -> Modules | None:
    wire = drawn.wired()
    if wire is None:
        return None
    producer = drawn.modules[wire[0]].inputs[wire[1]].producer
    return {name: running for name, running in drawn.modules.items() if name != producer}


def start(drawn: Drawn) -> Modules | None:
    """Start a module without inputs."""
    idle = [name for name in drawn.case.spec.modules if name not in drawn.modules]
    if not idle:
        return None
    name = drawn.rng.choice(idle)
    mode = drawn.rng.choice(list(drawn.case.spec.modules[name].modes))
    return {**drawn.modules, name: Running(drawn.rng.choice(list(drawn.case.spec.pes)), mode)}


def start_an_unknown_module(drawn: Drawn) -> Modules | None:
    return {**drawn.modules, "stowaway": Running(next(iter(drawn.case.spec.pes)), "only")}


def start_what_has_failed(drawn: Drawn) -> Modules | None:
    failed = [name for name in drawn.case.spec.modules if f"module:{name}" in drawn.case.now.down]
    return _started(drawn, drawn.rng.choice(failed)) if failed else None


def start_the_other_branch(drawn: Drawn) -> Modules | None:
    """Let a second branch of a DEMUX run beside the first, fed like it."""
    branches = [
        (running, other)
        for demux in drawn.case.spec.demuxes.values()
        for group in (demux.branches, demux.to)
        for running in group
        for other in group
        if running in drawn.modules and other not in drawn.modules
    ]
    return _started(drawn, drawn.rng.choice(branches)[1]) if branches else None


def start_a_rival_driver(drawn: Drawn) -> Modules | None:
    """Let a second module drive an actuator that is driven."""
    rivals = [
        other
        for group in drawn.case.spec.drivers_of_one_actuator().values()
        for other in group
        if other not in drawn.modules and drawn.modules.keys() & set(group)
    ]
    return _started(drawn, drawn.rng.choice(rivals)) if rivals else None


def _started(drawn: Drawn, name: str) -> Modules:
    """Start a module where it may run, with every input wired that a running module can feed."""
    module = drawn.case.spec.modules[name]
    mode = next(iter(module.modes.values()))
    home = drawn.case.spec.devices[module.device].pe if module.device else next(iter(drawn.case.spec.pes))
    inputs = {}
    for path, leaf in mode.leaves():
        givers = [other for other in drawn.modules if leaf.accepts(drawn.mode(other).gives.get(leaf.variable, 0))]
        if givers:
            inputs[path] = Wire(givers[0], leaf.variable, drawn.mode(givers[0]).gives[leaf.variable])
    return {**drawn.modules, name: Running((module.runs_on or (home,))[0], mode.name, inputs)}


# Modes


def another_mode(drawn: Drawn) -> Modules | None:
    name = drawn.one(n for n in drawn.modules if len(drawn.case.spec.modules[n].modes) > 1)
    if name is None:
        return None
    others = [mode for mode in drawn.case.spec.modules[name].modes if mode != drawn.modules[name].mode]
    return {**drawn.modules, name: replace(drawn.modules[name], mode=drawn.rng.choice(others))}


def an_unknown_mode(drawn: Drawn) -> Modules | None:
    name = drawn.one()
    return None if name is None else {**drawn.modules, name: replace(drawn.modules[name], mode="turbo")}


# Places


def move(drawn: Drawn) -> Modules | None:
    name = drawn.one()
    return None if name is None else drawn.with_pe(name, drawn.rng.choice(list(drawn.case.spec.pes)))


def move_to_an_unknown_pe(drawn: Drawn) -> Modules | None:
    name = drawn.one()
    return None if name is None else drawn.with_pe(name, "nowhere")


def move_to_what_is_down(drawn: Drawn) -> Modules | None:
    down = [pe for pe in drawn.case.spec.pes if f"pe:{pe}" in drawn.case.now.down]
    name = drawn.one()
    return drawn.with_pe(name, drawn.rng.choice(down)) if name is not None and down else None


def move_off_the_device(drawn: Drawn) -> Modules | None:
    modules, devices = drawn.case.spec.modules, drawn.case.spec.devices
    name = drawn.one(n for n in drawn.modules if modules[n].device is not None)
    if name is None:
        return None
    home = devices[modules[name].device or ""].pe
    others = [pe for pe in drawn.case.spec.pes if pe != home]
    return drawn.with_pe(name, drawn.rng.choice(others)) if others else None


def move_where_it_may_not_run(drawn: Drawn) -> Modules | None:
    name = drawn.one(n for n in drawn.modules if drawn.case.spec.modules[n].runs_on is not None)
    if name is None:
        return None
    others = [pe for pe in drawn.case.spec.pes if pe not in (drawn.case.spec.modules[name].runs_on or ())]
    return drawn.with_pe(name, drawn.rng.choice(others)) if others else None


def move_where_a_feature_is_missing(drawn: Drawn) -> Modules | None:
    name = drawn.one(n for n in drawn.modules if drawn.case.spec.modules[n].requires)
    if name is None:
        return None
    required = drawn.case.spec.modules[name].requires
    others = [pe.name for pe in drawn.case.spec.pes.values() if not required <= pe.features]
    return drawn.with_pe(name, drawn.rng.choice(others)) if others else None


def swap_two(drawn: Drawn) -> Modules | None:
    if len(drawn.modules) < 2:
        return None
    one, other = drawn.rng.sample(list(drawn.modules), 2)
    at_one, at_other = drawn.modules[one], drawn.modules[other]
    return {**drawn.modules, one: replace(at_one, pe=at_other.pe), other: replace(at_other, pe=at_one.pe)}


def crowd_one_pe(drawn: Drawn) -> Modules | None:
    """Put everything that can move on one PE."""
    if not drawn.modules:
        return None
    pe = drawn.rng.choice(list(drawn.case.spec.pes))
    return {n: replace(r, pe=r.pe if drawn.case.spec.modules[n].device else pe) for n, r in drawn.modules.items()}


def spread_out(drawn: Drawn) -> Modules | None:
    """Put everything that can move anywhere: more goes over the buses."""
    if not drawn.modules:
        return None
    pes = list(drawn.case.spec.pes)
    return {
        name: replace(r, pe=r.pe if drawn.case.spec.modules[name].device else drawn.rng.choice(pes))
        for name, r in drawn.modules.items()
    }


def bring_together_what_is_separate(drawn: Drawn) -> Modules | None:
    return _beside(drawn, drawn.case.spec.separate, together=True)


def take_apart_what_is_together(drawn: Drawn) -> Modules | None:
    return _beside(drawn, drawn.case.spec.together, together=False)


def _beside(drawn: Drawn, groups: tuple[tuple[str, ...], ...], *, together: bool) -> Modules | None:
    pairs = [(a, b) for group in groups for a in group for b in group if a != b and {a, b} <= drawn.modules.keys()]
    if not pairs:
        return None
    moved, still = drawn.rng.choice(pairs)
    pes = [pe for pe in drawn.case.spec.pes if (pe == drawn.modules[still].pe) == together]
    return drawn.with_pe(moved, drawn.rng.choice(pes)) if pes else None


# Wires


def unwire(drawn: Drawn) -> Modules | None:
    wire = drawn.wired()
    return None if wire is None else drawn.without_wire(*wire)


def unwire_a_branch(drawn: Drawn) -> Modules | None:
    """Take away the wire of a DEMUX."""
    wires = [
        (name, path)
        for name in drawn.modules
        for path, leaf in drawn.mode(name).leaves()
        if leaf.demux is not None and path in drawn.modules[name].inputs
    ]
    return drawn.without_wire(*drawn.rng.choice(wires)) if wires else None


def unwire_all(drawn: Drawn) -> Modules | None:
    name = drawn.one(n for n, running in drawn.modules.items() if running.inputs)
    return None if name is None else {**drawn.modules, name: replace(drawn.modules[name], inputs={})}


def wire_what_was_not(drawn: Drawn) -> Modules | None:
    """Wire an input that is not, to a running module that gives what it takes."""
    wires = [
        (name, path, Wire(giver, leaf.variable, drawn.mode(giver).gives[leaf.variable]))
        for name in drawn.modules
        for path, leaf in drawn.mode(name).leaves()
        if path not in drawn.modules[name].inputs
        for giver in drawn.modules
        if leaf.accepts(drawn.mode(giver).gives.get(leaf.variable, 0))
    ]
    return drawn.with_wire(*drawn.rng.choice(wires)) if wires else None


def wire_a_second_input_of_a_xor(drawn: Drawn) -> Modules | None:
    """Wire a leaf below a XOR which has another input already, whether a module gives it or not."""
    wires = [
        (name, path, leaf)
        for name in drawn.modules
        for path, leaf in _below_xors(drawn.mode(name).needs, "")
        if path not in drawn.modules[name].inputs
    ]
    if not wires:
        return None
    name, path, leaf = drawn.rng.choice(wires)
    giver = next((n for n in drawn.modules if leaf.accepts(drawn.mode(n).gives.get(leaf.variable, 0))), name)
    version = drawn.mode(giver).gives.get(leaf.variable, leaf.best)
    return drawn.with_wire(name, path, Wire(giver, leaf.variable, version))


def _below_xors(gate: Expression | None, path: str) -> Iterator[tuple[str, Leaf]]:
    match gate:
        case Xor():
            yield from leaves(gate, path)
        case And(inputs) | Or(_, inputs):
            for index, child in enumerate(inputs):
                yield from _below_xors(child, child_path(path, index))


def wire_to_what_does_not_run(drawn: Drawn) -> Modules | None:
    wire = drawn.wired()
    idle = [name for name in drawn.case.spec.modules if name not in drawn.modules]
    return _rewired(drawn, *wire, producer=drawn.rng.choice(idle)) if wire is not None and idle else None


def wire_to_what_gives_something_else(drawn: Drawn) -> Modules | None:
    wire = drawn.wired()
    if wire is None:
        return None
    variable = drawn.modules[wire[0]].inputs[wire[1]].variable
    others = [name for name in drawn.modules if variable not in drawn.mode(name).gives]
    return _rewired(drawn, *wire, producer=drawn.rng.choice(others)) if others else None


def wire_to_an_unknown_module(drawn: Drawn) -> Modules | None:
    wire = drawn.wired()
    return None if wire is None else _rewired(drawn, *wire, producer="stowaway")


def wire_another_version(drawn: Drawn) -> Modules | None:
    wire = drawn.wired()
    if wire is None:
        return None
    old = drawn.modules[wire[0]].inputs[wire[1]]
    return drawn.with_wire(*wire, replace(old, version=old.version + drawn.rng.choice((-1, 1))))


def wire_another_variable(drawn: Drawn) -> Modules | None:
    wire = drawn.wired()
    if wire is None:
        return None
    old = drawn.modules[wire[0]].inputs[wire[1]]
    others = [variable for variable in drawn.case.spec.variables if variable != old.variable]
    return drawn.with_wire(*wire, replace(old, variable=drawn.rng.choice(others)))


def wire_an_unknown_input(drawn: Drawn) -> Modules | None:
    wire = drawn.wired()
    if wire is None:
        return None
    return drawn.with_wire(wire[0], f"{wire[1]}.9".lstrip("."), drawn.modules[wire[0]].inputs[wire[1]])


def _rewired(drawn: Drawn, name: str, path: str, *, producer: str) -> Modules:
    return drawn.with_wire(name, path, replace(drawn.modules[name].inputs[path], producer=producer))


MUTATIONS: Mapping[str, Mutation] = {
    mutation.__name__.replace("_", " "): mutation
    for mutation in (
        stop,
        stop_a_producer,
        start,
        start_an_unknown_module,
        start_what_has_failed,
        start_the_other_branch,
        start_a_rival_driver,
        another_mode,
        an_unknown_mode,
        move,
        move_to_an_unknown_pe,
        move_to_what_is_down,
        move_off_the_device,
        move_where_it_may_not_run,
        move_where_a_feature_is_missing,
        swap_two,
        crowd_one_pe,
        spread_out,
        bring_together_what_is_separate,
        take_apart_what_is_together,
        unwire,
        unwire_a_branch,
        unwire_all,
        wire_what_was_not,
        wire_a_second_input_of_a_xor,
        wire_to_what_does_not_run,
        wire_to_what_gives_something_else,
        wire_to_an_unknown_module,
        wire_another_version,
        wire_another_variable,
        wire_an_unknown_input,
    )
}


def canonical(configuration: Configuration) -> Canonical:
    """Return a hashable form of a configuration."""
    return frozenset(
        (
            name,
            running.mode,
            running.pe,
            frozenset((path, wire.producer, wire.variable, wire.version) for path, wire in running.inputs.items()),
        )
        for name, running in configuration.modules.items()
    )


@dataclass
class Tally:
    """The results of the mutants, by kind; `wrong`: where the verifier and brute force disagree."""

    illegal: Counter[str]
    rejected: Counter[str]
    legal: Counter[str]
    rules: Counter[str]  # that were broken
    wrong: list[str]


def mutants_of_verifier(rng: random.Random, tally: Tally, *, origins: int = 3) -> None:
    """Draw a case, and every kind of mutation of some of its legal configurations; raises TooManyError."""
    case = random_case(rng, modules=5)
    legal = [configuration for configuration, _, _ in Enumerator(case.spec, case.now).every(most=MOST)]
    known = {canonical(configuration) for configuration in legal}
    fullest = sorted(legal, key=lambda one: len(one.modules))[-len(legal) // 2 :]  # there is more to go wrong in them
    for configuration in rng.sample(fullest, min(len(fullest), origins)):
        for kind, mutation in MUTATIONS.items():
            modules = mutation(Drawn(rng, case, configuration.modules))
            if modules is not None and modules != configuration.modules:
                _assess(case, Configuration(modules), kind, known, tally)


def _assess(case: Case, mutant: Configuration, kind: str, known: set[Canonical], tally: Tally) -> None:
    violations = verify(case.spec, case.now, mutant)
    is_legal = canonical(mutant) in known
    tally.legal[kind] += is_legal
    tally.illegal[kind] += not is_legal
    tally.rejected[kind] += bool(violations) and not is_legal
    tally.rules.update({violation.rule for violation in violations})
    if bool(violations) == is_legal:
        tally.wrong.append(f"{kind}: {violations[0] if violations else 'illegal, and not rejected'}")


def main() -> int:
    """Verify the mutants of a range of seeds; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int)
    parser.add_argument("end", type=int)
    arguments = parser.parse_args()
    tally = Tally(Counter(), Counter(), Counter(), Counter(), [])
    too_large = 0
    for seed in range(arguments.first, arguments.end):
        before = len(tally.wrong)
        try:
            mutants_of_verifier(random.Random(seed), tally)
        except TooManyError:
            too_large += 1
        for wrong in tally.wrong[before:]:
            print(f"seed {seed}: {wrong}", flush=True)
    print(f"{'illegal':>8} {'rejected':>8} {'still legal':>11}  kind ({too_large} cases too large)")
    for kind in MUTATIONS:
        print(f"{tally.illegal[kind]:8} {tally.rejected[kind]:8} {tally.legal[kind]:11}  {kind}")
    print(f"{tally.illegal.total():8} {tally.rejected.total():8} {tally.legal.total():11}  all {len(MUTATIONS)} kinds")
    print("rules broken: " + ", ".join(f"{rule} {count}" for rule, count in sorted(tally.rules.items())))
    return 1 if tally.wrong else 0


if __name__ == "__main__":
    sys.exit(main())
