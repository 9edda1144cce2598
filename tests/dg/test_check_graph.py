"""Specs that load but make no sense: findings of the graph's check, and what it leaves to other checks."""

from dg.marked_spec import RUNS
from heronry_dg.check.assess import assess
from heronry_dg.check.examples import whole_spec
from heronry_tools.analysis.check.registry import RULES, checks_of

TWO_SENSORS = (
    "devices:\n  gps: {kind: sensor, pe: nav}\n  pitot: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}\n"
    "variables:\n  speed: {type: FLOAT, versions: 3}\n"
)


def told(fragment: str) -> list[str]:
    assessed = assess(whole_spec(fragment), "x", checks_of(fast=True), RULES)
    return [f"{finding.code}: {finding.sentence}" for finding in assessed.findings]


def display(needs: str, givers: str) -> str:
    return f"{TWO_SENSORS}modules:\n{givers}  display: {{device: lamp, needs: {needs}, {RUNS}}}\n"


def one(name: str, device: str, version: int) -> str:
    return f"  {name}: {{device: {device}, gives: {{speed: {version}}}, {RUNS}}}\n"


BOTH = one("driver", "gps", 1) + one("other", "pitot", 2)
MODES = (
    "  driver:\n    device: gps\n    modes:\n"
    f"      fine: {{gives: {{speed: 1}}, {RUNS}}}\n      coarse: {{gives: {{speed: 2}}, {RUNS}}}\n"
    + one("other", "pitot", 3)
)
NEVER = ["DG232: module 'display' can never run: its inputs are never all given at the same time"]


def test_two_modules_can_fill_two_inputs_and_one_cannot() -> None:
    assert told(display('{and: ["speed@1", "speed@2"]}', BOTH)) == []
    assert told(display('{and: ["speed@1", "speed@2", {or: {k: 0, of: ["speed@3"]}}]}', MODES)) == NEVER
    assert told(display('{and: ["speed@1", {and: ["speed@2", "speed@3"]}]}', MODES)) == NEVER
    assert told(display('{and: ["speed@<=2", "speed@3"]}', MODES)) == []


def test_a_vote_counts_each_module_once() -> None:
    assert told(display('{or: {k: 2, of: ["speed@1", "speed@2", "speed@3"]}}', MODES)) == []
    assert told(display('{or: {k: 3, of: ["speed@1", "speed@2", "speed@3"]}}', MODES)) == NEVER
    assert told(display('{xor: ["speed@1", "speed@2", "speed@3"]}', MODES)) == []


def test_an_input_that_no_module_gives_is_reported_once_and_not_again_as_a_gate_that_never_holds() -> None:
    said = told(display('{and: ["speed@1", "speed@2", "speed@3"]}', BOTH))
    assert said == ["DG231: module 'display' reads 'speed@3', which no module gives"]


def test_a_module_may_feed_itself_where_it_starts_from_a_value() -> None:
    fragment = (
        "variables:\n  speed: {type: FLOAT}\n  level: {type: FLOAT, initial: 0}\nmodules:\n"
        f"  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
        f"  display: {{device: lamp, needs: {{and: [speed, level]}}, gives: {{level: 1}}, {RUNS}}}\n"
    )
    assert told(fragment) == []


def test_a_branch_cannot_wait_for_another_branch_of_its_demux() -> None:
    fragment = (
        "devices:\n  gps: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}\n"
        "  second: {kind: actuator, pe: nav}\nvariables:\n  speed: {type: FLOAT}\n  told: {type: FLOAT}\n"
        f"gates: {{light: {{demux: speed}}}}\nmodules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
        f"  display: {{device: lamp, needs: light, gives: {{told: 1}}, {RUNS}}}\n"
        f"  spare: {{device: second, needs: {{and: [light, told]}}, {RUNS}}}\n"
        "functions: {showing: {output: light}}\n"
    )
    assert told(fragment) == ["DG232: module 'spare' can never run: its inputs are never all given at the same time"]


def test_a_function_that_is_wanted_in_no_phase_uses_nothing() -> None:
    said = told("functions: {showing: {output: display, priority: 0}}\n")
    assert [line[:5] for line in said] == ["DG241", "DG241"]


def test_a_gate_that_only_an_unused_gate_names_is_used() -> None:
    said = told("gates: {one: speed, two: one}\n")
    assert said == ["DG243: no expression names gate 'two'"]


def test_a_phase_that_watches_a_variable_without_a_giver_is_an_error() -> None:
    fragment = "variables:\n  speed: {type: FLOAT}\n  height: {type: FLOAT}\n"
    said = told(f"{fragment}phases: {{climb: {{}}, cruise: {{when: {{variable: height, above: 3}}}}}}\n")
    assert said == ["DG230: phase 'cruise' watches 'height', which no module gives"]


def phases(cruise: str, functions: str = "{showing: {output: display}}") -> list[str]:
    return told(f"functions: {functions}\nphases: {{climb: {{}}, cruise: {{when: {cruise}}}, land: {{}}}}\n")


def test_a_rule_that_can_never_fire_is_an_error() -> None:
    why = "DG246: the rule of phase 'cruise' never fires: "
    assert phases("{variable: speed, above: 3, from: [cruise]}") == [f"{why}it leads here from no other phase"]
    unwanted = "{showing: {output: display, priority: {default: 1, climb: 0}}}"
    where = "in climb no module that gives 'speed' serves a wanted function"
    assert phases("{variable: speed, above: 3}", unwanted) == [why + where]
    assert phases("{variable: speed, above: 3, from: [climb, land]}", unwanted) == []


def test_a_threshold_at_the_end_of_the_variables_range_is_never_crossed() -> None:
    for kind, never, sometimes in (("UCHAR", "above: 255", "above: 254"), ("SHORT", "below: -32768", "below: -32767")):
        for rule, codes in ((never, ["DG246"]), (sometimes, [])):
            said = told(
                f"variables:\n  speed: {{type: {kind}}}\n"
                f"phases: {{climb: {{}}, cruise: {{when: {{variable: speed, {rule}}}}}}}\n"
            )
            assert [line[:5] for line in said] == codes


def test_rules_that_lead_in_a_circle_at_one_value_are_an_error() -> None:
    def said(*rules: str) -> list[str]:
        names = ("climb", "cruise", "land")
        written = ", ".join(f"{name}: {{when: {rule}}}" for name, rule in zip(names, rules, strict=True))
        return told(f"phases: {{{written}}}\n")

    def rule(limit: str, origin: str) -> str:
        return f"{{variable: speed, {limit}, from: [{origin}]}}"

    way = "at one value of 'speed', the rules of all these phases hold"
    round_three = [rule("above: 3", "land"), rule("above: 5", "climb"), rule("below: 9", "cruise")]
    assert said(*round_three) == [f"DG247: the phase changes without end (climb -> cruise -> land -> climb): {way}"]
    assert said(round_three[0], round_three[1], rule("below: 5", "cruise")) == []
    assert said(rule("below: 3", "cruise"), rule("below: 4", "climb"), rule("above: 4", "climb")) == [
        f"DG247: the phase changes without end (climb -> cruise -> climb): {way}"
    ]
