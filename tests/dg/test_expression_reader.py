"""Gate expressions in a spec: how they are read, and every error in them."""

import random
from collections import Counter
from dataclasses import replace

import pytest

from dg.marked_spec import RUNS, complaint, complaints, spec_text
from heronry_dg.findings import SpecError
from heronry_dg.gates import And, Expression, Leaf, Or, Xor, holds, leaves, with_leaves
from heronry_dg.loader import loads
from heronry_dg.model import Spec
from thoroughness import part_of

VARIABLES = "{altitude: {type: FLOAT, versions: 3}, speed: {type: FLOAT, versions: 2}, command: {type: UCHAR}}"
COMMAND = Leaf("command", 1, 1, (0,))


def logic(needs: str, gates: str = "", **sections: str) -> str:
    """A spec with one module that needs something."""
    modules = f"{{logic: {{needs: {needs}, {RUNS}}}}}"
    return spec_text(**{"variables": VARIABLES, "modules": modules, "functions": "", "gates": gates, **sections})


def needs_of(spec: Spec, module: str = "logic", mode: str = "only") -> Expression | None:
    return spec.modules[module].modes[mode].needs


def read(needs: str, gates: str = "") -> Expression | None:
    return needs_of(loads(logic(needs, gates), "test.dg.yaml"))


@pytest.mark.parametrize("nothing", ["", "null", "~"])
def test_a_mode_without_needs_has_no_input(nothing: str) -> None:
    assert read(nothing) is None


@pytest.mark.parametrize(
    ("text", "leaf"),
    [
        ("command", Leaf("command", 1, 1, (0,))),
        ("altitude", Leaf("altitude", 1, 3, (3, 2, 1))),
        ("altitude@2", Leaf("altitude", 2, 2, (0,))),
        ("altitude@<=2", Leaf("altitude", 1, 2, (3, 2))),
        ("altitude@<=1", Leaf("altitude", 1, 1, (0,))),
        ("{var: altitude}", Leaf("altitude", 1, 3, (3, 2, 1))),
        ("{var: altitude, worth: }", Leaf("altitude", 1, 3, (3, 2, 1))),
        ("{var: altitude, worth: [30, 10, 0]}", Leaf("altitude", 1, 3, (30, 10, 0))),
        ("{var: altitude@<=2, worth: [30, 10]}", Leaf("altitude", 1, 2, (30, 10))),
        ("{var: altitude@<=2, worth: [30, 10, 5]}", Leaf("altitude", 1, 2, (30, 10))),
        ("{var: altitude@2, worth: [30, 10, 5]}", Leaf("altitude", 2, 2, (10,))),
        ("{var: altitude@2, worth: [7]}", Leaf("altitude", 2, 2, (7,))),
    ],
)
def test_a_leaf_accepts_versions_and_is_worth_points(text: str, leaf: Leaf) -> None:
    assert read(text) == leaf


def test_a_lone_version_is_worth_nothing_below_ands_and_its_quality_below_an_or_or_a_xor() -> None:
    assert read("{and: [altitude@3, command]}") == And((Leaf("altitude", 3, 3, (0,)), COMMAND))
    chosen = Leaf("altitude", 2, 2, (2,))
    assert read("{or: {k: 0, of: [altitude@2]}}") == Or(0, (chosen,))
    assert read("{xor: [altitude@2, command]}") == Xor((chosen, Leaf("command", 1, 1, (1,))))
    assert read("{or: {k: 1, of: [{and: [altitude@2]}]}}") == Or(1, (And((chosen,)),))


def test_leaves_are_addressed_by_their_path_after_named_gates_are_written_out() -> None:
    spec = loads(logic("{and: [command, pair]}", gates="{pair: {and: [altitude, speed]}}"), "test.dg.yaml")
    assert [(path, leaf.variable) for path, leaf in leaves(needs_of(spec))] == [
        ("0", "command"),
        ("1.0", "altitude"),
        ("1.1", "speed"),
    ]
    assert list(spec.shorthands) == ["pair"]


def test_a_shorthand_is_worth_what_its_place_makes_it_worth() -> None:
    gates = "{low: altitude@3}"
    assert read("low", gates) == Leaf("altitude", 3, 3, (0,))
    assert read("{or: {k: 0, of: [low]}}", gates) == Or(0, (Leaf("altitude", 3, 3, (1,)),))


def test_shorthands_may_stand_in_any_order() -> None:
    assert read("a", gates="{a: {and: [b]}, b: {and: [c]}, c: command}") == And((And((COMMAND,)),))


def needs_when_sound(text: str) -> Expression | None:
    """The needs of the module `first`, or of the only one; None for a spec that is refused."""
    try:
        spec = loads(text, "test.dg.yaml")
    except SpecError:
        return None
    return next(iter(spec.modules[list(spec.modules)[-1]].modes.values())).needs


def expression(rng: random.Random, depth: int) -> str:
    """Draw the text of an expression; it may read one version of a variable twice, or hold with nothing wired."""
    names = ("altitude", "altitude@1", "altitude@3", "altitude@<=2", "speed@1", "speed@2", "command")
    kind = rng.choice(("leaf", "and", "or", "xor", "worth")) if depth else "leaf"
    inputs = ", ".join(expression(rng, depth - 1) for _ in range(2)) if kind in ("and", "or", "xor") else ""
    match kind:
        case "or":
            return f"{{or: {{k: {rng.randrange(3)}, of: [{inputs}]}}}}"
        case "and" | "xor":
            return f"{{{kind}: [{inputs}]}}"
        case "worth":
            return f"{{var: speed@1, worth: [{rng.randrange(9)}], only_in: [climb]}}"
    return rng.choice(names)


def branches(needs: str, gates: str) -> str:
    modules = f"{{second: {{needs: {needs}, {RUNS}}}, first: {{needs: {needs}, {RUNS}}}}}"
    return spec_text(variables=VARIABLES, modules=modules, functions="{f: {output: out}}", gates=gates)


@pytest.mark.parametrize("needs", ["out", "{and: [{and: [out]}, command]}", "both"])
def test_the_branches_of_a_demux_are_the_modules_that_name_it(needs: str) -> None:
    spec = loads(branches(needs, "{out: {demux: altitude}, both: {and: [out, command]}}"), "test.dg.yaml")
    assert spec.demuxes["out"].branches == ("second", "first")
    assert spec.functions["f"].outputs == ("second", "first")
    (leaf,) = [leaf for _, leaf in leaves(needs_of(spec, "first")) if leaf.demux]
    assert leaf == Leaf("altitude", 1, 3, (3, 2, 1), demux="out")


NONSENSE = [
    ("»7", "a gate expression is expected here"),
    ("»[command]", "a gate expression is expected here"),
    ("»{and: [command], or: {}}", "a gate expression is expected here"),
    ("»comand", "no variable or gate is named 'comand' (did you mean 'command'?)"),
    ("»'altitude @2'", "'altitude @2' is neither a variable nor a gate (write NAME, NAME@2 or NAME@<=2"),
    ("»altitude@<2", "is neither a variable nor a gate"),
    ("»altitude@best", "is neither a variable nor a gate"),
    ("»altitude@0", "'altitude@0' is out of range ('altitude' has versions 1 to 3)"),
    ("»altitude@4", "'altitude@4' is out of range"),
    ("»altitude@<=0", "'altitude@<=0' is out of range"),
    ("»altitude@<=4", "'altitude@<=4' is out of range"),
    ("»command@2", "'command@2' is out of range ('command' has version 1 alone)"),
    ("{»nand: [command]}", "'nand' is no kind of gate (did you mean 'and'?)"),
    ("{»majority: [command]}", "'majority' is no kind of gate (the kinds are and, or and xor)"),
    ("{and: »[]}", "an AND takes a list of 1 or more inputs"),
    ("{and: »command}", "an AND takes a list of 1 or more inputs"),
    ("{xor: »[command]}", "a XOR takes a list of 2 or more inputs"),
    ("{or: »[command]}", "an OR needs 'k' and 'of' (write {or: {k: 1, of: [a, b]}})"),
    ("{or: »{of: [command]}}", "an OR needs 'k' and 'of'"),
    ("{or: {k: 1, of: »[]}}", "an OR takes a list of 1 or more inputs"),
    ("{or: {k: »2, of: [command]}}", "'k' must be a whole number from 0 to 1"),
    ("{or: {k: »-1, of: [command]}}", "'k' must be a whole number from 0 to 1"),
    ("{or: {k: »0.5, of: [command]}}", "'k' must be a whole number from 0 to 1"),
    ("{or: {k: »true, of: [command]}}", "'k' must be a whole number from 0 to 1"),
    ("{or: {k: 1, »off_: 3, of: [command]}}", "an OR has no field 'off_'"),
    ("{xor: [command, »{or: {k: 0, of: [altitude]}}]}", "this input of a XOR holds with nothing wired below it"),
    ("{xor: [command, »{and: [{or: {k: 0, of: [altitude]}}]}]}", "holds with nothing wired below it"),
    ("{xor: [command, »{or: {k: 1, of: [speed, {or: {k: 0, of: [altitude]}}]}}]}", "holds with nothing wired below it"),
    ("{var: »comand}", "no variable is named 'comand' (did you mean 'command'?)"),
    ("{var: »[a]}", "'var' must be the name of a variable"),
    ("{var: command, »wort: [1]}", "an input has no field 'wort' (did you mean 'worth'?)"),
    ("{var: altitude, only_in: »3}", "'only_in' must be a list of one or more different phases"),
    ("{var: altitude, only_in: »[]}", "'only_in' must be a list of one or more different phases"),
    ("{var: altitude, only_in: »[1]}", "'only_in' must be a list of one or more different phases"),
    ("{var: altitude, only_in: »[x, x]}", "'only_in' must be a list of one or more different phases"),
    ("{var: altitude, only_in: [»clim]}", "no phase is named 'clim' (did you mean 'climb'?)"),
    ("{var: altitude, worth: »3}", "'worth' must be a list of 3 whole numbers from 0"),
    ("{var: altitude, worth: »[3, 2]}", "'worth' must be a list of 3 whole numbers"),
    ("{var: altitude@<=2, worth: »[3]}", "'worth' must be a list of 2 or 3 whole numbers"),
    ("{var: altitude, worth: »[3, 2, -1]}", "'worth' must be a list of 3 whole numbers"),
    ("{var: altitude, worth: »[3, 2, 0.5]}", "'worth' must be a list of 3 whole numbers"),
]

VOTES = [
    ("{and: [command, »command]}", "version 1 of 'command' is accepted by another input of this mode as well"),
    ("{xor: [altitude@<=2, »altitude]}", "version 1 of 'altitude' is accepted by another input"),
    ("{or: {k: 2, of: [altitude@3, altitude@1, »altitude@3]}}", "version 3 of 'altitude' is accepted by another input"),
]


@pytest.mark.parametrize(("needs", "sentence"), [*NONSENSE, *VOTES, ("{»demux: command}", "a DEMUX must have a name")])
def test_an_expression_that_makes_no_sense_is_named_with_its_place(needs: str, sentence: str) -> None:
    assert sentence in complaint(logic(needs))


@pytest.mark.parametrize(("needs", "sentence"), NONSENSE)
def test_so_it_is_in_a_named_gate_that_no_expression_names(needs: str, sentence: str) -> None:
    assert sentence in complaint(logic("command", gates=f"{{unused: {needs}}}"))


def test_mistakes_in_one_expression_are_all_reported() -> None:
    said = complaints(logic("{or: {k: »-9, of: [»altitude@9, »sped, {xor: »[command]}]}}"))
    assert len(said) == 4


def test_votes_are_counted_through_named_gates_at_the_place_that_names_them() -> None:
    said = complaint(logic("{and: [command, »again]}", gates="{again: command}"))
    assert "version 1 of 'command' is accepted by another input" in said


def test_a_gate_and_a_variable_do_not_share_a_name() -> None:
    assert "'speed' is the name of a gate and of a variable" in complaint(logic("", gates="{»speed: altitude}"))
    assert "is the name of a gate and of a variable" in complaint(branches("out", "{out: {demux: speed}, »speed: out}"))


def test_a_gate_has_no_versions_and_no_worth() -> None:
    assert "'g' is a gate and has no versions" in complaint(logic("»g@2", gates="{g: altitude}"))
    assert "no variable is named 'g'" in complaint(logic("{var: »g, worth: [1]}", gates="{g: altitude}"))


@pytest.mark.parametrize(
    ("gates", "cycle"),
    [
        ("{»a: a}", "gate 'a' contains itself: a -> a"),
        ("{»a: {and: [command, b]}, b: {or: {k: 1, of: [a]}}}", "gate 'a' contains itself: a -> b -> a"),
        ("{x: a, »a: {xor: [b, command]}, b: c, c: {and: [a]}}", "gate 'a' contains itself: a -> b -> c -> a"),
    ],
)
def test_gates_do_not_contain_themselves(gates: str, cycle: str) -> None:
    assert cycle in complaint(logic("a", gates=gates))


class TestDemux:
    """What a DEMUX requires of its branches."""

    def test_it_has_two_or_more(self) -> None:
        one = logic("out", gates="{»out: {demux: command}}")
        assert "DEMUX 'out' needs two branches or more, and only 'logic' names it" in complaint(one)
        none = logic("command", gates="{»out: {demux: command}}")
        assert "DEMUX 'out' needs two branches or more, and no module names it" in complaint(none)

    def test_its_variable_exists(self) -> None:
        assert "no variable or gate is named 'comand'" in complaint(branches("out", "{out: {demux: »comand}}"))
        assert "a gate expression is expected here" in complaint(branches("out", "{out: {demux: »[]}}"))
        assert "gate 'out' has no field 'k'" in complaint(branches("out", "{out: {demux: command, »k: 1}}"))

    def test_no_demux_is_in_front_of_it(self) -> None:
        gates = "{out: {demux: »inner}, inner: {demux: speed}}"
        needs = "{and: [out, inner]}"
        assert "DEMUX 'inner' is named in front of DEMUX 'out'" in complaint(branches(needs, gates))
        gates = "{out: {demux: »{and: [command, name]}}, name: inner, inner: {demux: speed}}"
        assert "DEMUX 'inner' is named in front of DEMUX 'out'" in complaint(branches(needs, gates))
        circle = "{out: {demux: name}, »name: {and: [out, command]}}"
        assert "gate 'name' contains itself: name -> out -> name" in complaint(branches("out", circle))

    def test_it_does_not_hold_with_nothing_wired(self) -> None:
        said = complaint(branches("out", "{out: {demux: »{or: {k: 0, of: [speed]}}}}"))
        assert "the expression in front of DEMUX 'out' holds with nothing wired below it" in said

    def test_its_expression_counts_as_written_out_in_each_branch(self) -> None:
        spec = loads(branches("{and: [command, out]}", "{out: {demux: {xor: [altitude@<=2, speed]}}}"), "test.dg.yaml")
        chosen = Xor((Leaf("altitude", 1, 2, (3, 2), demux="out"), Leaf("speed", 1, 2, (2, 1), demux="out")))
        assert needs_of(spec, "first") == And((COMMAND, chosen))
        assert [path for path, leaf in spec.modules["first"].modes["only"].leaves() if leaf.demux] == ["1.0", "1.1"]
        assert spec.demuxes["out"].needs == chosen
        said = complaints(branches("{and: [speed@1, »out]}", "{out: {demux: {xor: [altitude@<=2, speed]}}}"))
        assert ["version 1 of 'speed' is accepted by another input" in sentence for sentence in said] == [True, True]
        twice = complaints(branches("{and: [out, »out]}", "{out: {demux: {and: [command, speed]}}}"))
        assert ["DEMUX 'out' is named twice in one mode" in sentence for sentence in twice] == [True, True]

    def test_so_does_any_expression(self) -> None:
        """Read random expressions in front of a DEMUX and, in a second spec, in the branches themselves."""
        counts: Counter[bool] = Counter()
        for seed in range(part_of(1_000, share=4)):
            rng = random.Random(seed)
            demanded, other = expression(rng, 2), expression(rng, 1)
            needs = rng.choice(("{}", "{{and: [{}, {o}]}}", "{{and: [{o}, {{and: [{}]}}]}}"))
            through = branches(needs.format("out", o=other), f"{{out: {{demux: {demanded}}}}}")
            direct = branches(needs.format(demanded, o=other), "").replace("output: out", "output: first")
            written = needs_when_sound(direct)
            if written is not None and holds(needs_when_sound(logic(demanded)), ()):
                assert "holds with nothing wired below it" in complaints(through.replace("demux: ", "demux: »"))[0]
                continue
            found = needs_when_sound(through)
            counts[found is None] += 1
            assert (found and with_leaves(found, lambda leaf: replace(leaf, demux=None))) == written, seed
        assert min(counts[True], counts[False]) > 20

    @pytest.mark.parametrize("needs", ["{or: {k: 0, of: [»out]}}", "{xor: [command, »{and: [out]}]}"])
    def test_a_branch_names_it_below_ands_alone(self, needs: str) -> None:
        said = complaints(branches(needs, "{out: {demux: altitude}}"))
        assert len(said) == 2  # once per branch
        assert all("DEMUX 'out' is named below an OR or a XOR" in sentence for sentence in said)

    def test_a_branch_names_it_once(self) -> None:
        said = complaints(branches("{and: [out, »out]}", "{out: {demux: command}}"))
        assert ["DEMUX 'out' is named twice in one mode" in sentence for sentence in said] == [True, True]

    def test_every_mode_of_a_branch_names_it(self) -> None:
        modules = (
            f"{{a: {{modes: {{good: {{needs: out, {RUNS}}}, »bad: {{needs: command, {RUNS}}}, »none: {{{RUNS}}}}}}},"
            f" b: {{needs: out, {RUNS}}}}}"
        )
        text = spec_text(variables=VARIABLES, modules=modules, functions="", gates="{out: {demux: altitude}}")
        first, second = complaints(text)
        assert "mode 'bad' of module 'a' does not name DEMUX 'out'" in first
        assert "mode 'none' of module 'a' does not name DEMUX 'out'" in second

    def test_values_are_as_long_as_the_most_modes_of_a_branch(self) -> None:
        modes = f"{{modes: {{x: {{needs: out, {RUNS}}}, y: {{needs: out, {RUNS}}}}}}}"
        rest = {"variables": VARIABLES, "gates": "{out: {demux: command}}"}
        modules = f"{{a: {modes}, b: {{needs: out, {RUNS}}}}}"
        sound = spec_text(modules=modules, functions="{f: {output: out, value: [9, 4]}}", **rest)
        assert loads(sound, "test.dg.yaml").functions["f"].value == (9, 4)
        short = spec_text(modules=modules, functions="{f: {output: out, value: »[9]}}", **rest)
        assert "must have a number per mode of its output: 2, not 1" in complaint(short)


class TestWiringCycles:
    """A cycle of wires needs a variable that has a value before the first one arrives."""

    @staticmethod
    def ring(speed: str, first: str = "»first") -> str:
        modules = f"{{{first}: {{needs: command, gives: {{speed: 1}}, {RUNS}}}"
        modules += f", second: {{needs: speed, gives: {{command: 1}}, {RUNS}}}}}"
        return spec_text(variables=f"{{speed: {speed}, command: {{type: UCHAR}}}}", modules=modules, functions="")

    def test_nothing_can_start_it(self) -> None:
        said = complaint(self.ring("{type: FLOAT}"))
        assert "nothing can start this cycle: first -> speed -> second -> command -> first" in said
        assert "give an 'initial' value to 'speed' or 'command'" in said

    def test_an_initial_value_starts_it(self) -> None:
        assert complaints(self.ring("{type: FLOAT, initial: 0}", first="first")) == []

    def test_a_module_may_wait_for_itself(self) -> None:
        modules = f"{{»loop: {{needs: command, gives: {{command: 1}}, {RUNS}}}}}"
        assert "loop -> command -> loop" in complaint(spec_text(modules=modules, functions=""))

    def test_optional_inputs_close_a_cycle_too(self) -> None:
        modules = f"{{»loop: {{needs: {{or: {{k: 0, of: [command]}}}}, gives: {{command: 1}}, {RUNS}}}}}"
        assert "loop -> command -> loop" in complaint(spec_text(modules=modules, functions=""))

    def test_a_version_that_is_not_accepted_closes_none(self) -> None:
        modules = f"{{refine: {{needs: altitude@3, gives: {{altitude: 1}}, {RUNS}}}}}"
        assert complaints(spec_text(modules=modules, functions="")) == []

    def test_modes_of_one_module_are_checked_one_by_one(self) -> None:
        """One mode reads what another mode of the same module gives: they never run together."""
        modes = f"{{reading: {{needs: command, {RUNS}}}, giving: {{gives: {{command: 1}}, {RUNS}}}}}"
        assert complaints(spec_text(modules=f"{{both: {{modes: {modes}}}}}", functions="")) == []

    def test_the_mode_that_closes_it_is_named(self) -> None:
        modes = f"{{calm: {{{RUNS}}}, »eager: {{needs: altitude@2, gives: {{command: 1}}, {RUNS}}}}}"
        modules = f"{{»a: {{modes: {modes}}}, b: {{needs: command, gives: {{altitude: 2}}, {RUNS}}}}}"
        said = complaint(spec_text(modules=modules.replace("»eager", "eager"), functions=""))
        assert "a (eager) -> command -> b -> altitude@2 -> a (eager)" in said


class TestLimits:
    """Named gates that would unfold without end are refused by counting."""

    def test_doubling(self) -> None:
        gates = "".join(f", g{i}: {{and: [g{i - 1}, g{i - 1}]}}" for i in range(1, 200))
        gates = gates.replace("{and: [g9, g9]}", "{»and: [g9, g9]}")
        said = complaint(logic("", gates=f"{{g0: command{gates}}}"))
        assert "this gate has more than 1000 inputs when named gates are expanded" in said

    def test_depth(self) -> None:
        gates = "".join(f", g{i}: {{and: [g{i - 1}]}}" for i in range(1, 5000))
        gates = gates.replace("{and: [g63]}", "{»and: [g63]}")
        said = complaint(logic("", gates=f"{{g0: command{gates}}}"))
        assert "this gate has more than 64 levels when named gates are expanded" in said

    def test_all_modes_together(self) -> None:
        variables = ", ".join(f"v{i}: {{type: FLOAT}}" for i in range(900))
        gates = f"{{all: {{and: [{', '.join(f'v{i}' for i in range(900))}]}}}}"
        modules = ", ".join(f"m{i}: {{needs: {'»' if i == 111 else ''}all, {RUNS}}}" for i in range(112))
        said = complaint(spec_text(variables=f"{{{variables}}}", gates=gates, modules=f"{{{modules}}}", functions=""))
        assert "all modes together have more than 100000 inputs" in said
