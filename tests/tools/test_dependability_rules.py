"""DG4xx beyond the examples of its rules: planning every single fault agrees; gates and placement rules in detail."""

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_dg.check.assess import assess
from heronry_dg.check.examples import whole_spec
from heronry_dg.findings import Finding
from heronry_dg.model import Spec
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, elements
from heronry_manager.planner.exact import plan
from heronry_tools.analysis.check.dependability import check
from heronry_tools.analysis.check.dependability_rules import FAMILY
from heronry_tools.analysis.check.redundancy import independent
from heronry_tools.analysis.check.registry import RULES
from heronry_tools.analysis.check.single_faults import losses
from heronry_tools.analysis.check.wanted import Phase, critical_functions, phases
from heronry_tools.analysis.servable import Planning
from planner.comparison import crossing_case
from planner.random_specs import random_case
from thoroughness import sample

RUNS = "cpu: 0.1, ram: 1KiB, rate_hz: 10"
Lost = dict[str, set[Phase]]  # function -> phases


def assessed(data: bytes) -> list[Finding]:
    return list(assess(data, "x.dg.yaml", {FAMILY.prefix: check}, RULES).findings)


def found_in(fragment: str) -> list[Finding]:
    return assessed(whole_spec(fragment))


def lost_by_planning_everything(spec: Spec) -> dict[str, Lost]:
    """Plan every phase with every element down, one after the other, without a thought."""
    lost: dict[str, Lost] = {}
    for phase in phases(spec):
        healthy = plan(spec, Situation(phase=phase))
        critical = critical_functions(spec, phase)
        if not all(healthy.functions[name].served for name in critical):
            continue
        for element in elements(spec):
            now = Situation(frozenset({element}), phase=phase)
            left = plan(spec, now, placement(healthy.configuration))
            for name in critical:
                if not left.functions[name].served:
                    lost.setdefault(element, {}).setdefault(name, set()).add(phase)
    return lost


def worth_telling(spec: Spec, lost: dict[str, Lost]) -> dict[str, Lost]:
    """A replicated bus takes two faults, and a driver that costs what its device costs gives no second finding."""
    silent = {f"bus:{bus.name}" for bus in spec.buses.values() if bus.channels > 1}
    for module in spec.modules.values():
        if lost.get(f"module:{module.name}") == lost.get(f"device:{module.device}"):
            silent.add(f"module:{module.name}")
    return {element: functions for element, functions in lost.items() if element not in silent}


def lost_as_told(spec: Spec) -> dict[str, Lost]:
    found = losses(Planning(spec))
    return {loss.element: {name: set(at) for name, at in loss.functions.items()} for loss in found}


@pytest.mark.parametrize("seed", sample(range(50), 3))  # odd ones and even ones
def test_losses_are_those_of_planning_every_single_fault(seed: int) -> None:
    draw = crossing_case if seed % 2 else random_case
    spec = draw(random.Random(seed), modules=7).spec
    assert lost_as_told(spec) == worth_telling(spec, lost_by_planning_everything(spec))


def test_the_drawn_specs_lose_something_and_keep_something() -> None:
    drawn = [random_case(random.Random(seed), modules=6).spec for seed in range(25)]
    lost = [len(lost_as_told(spec)) for spec in drawn]
    assert sum(count > 0 for count in lost) > 5
    assert any(0 < count < len(elements(spec)) for count, spec in zip(lost, drawn, strict=True))


def test_a_second_way_without_room_is_no_second_way() -> None:
    """Without `nav` both functions have a branch on `tail`, which has CPU for one of them."""
    lit = "cpu: 0.6, ram: 1KiB, rate_hz: 10"
    found = found_in(
        "buses: {can0: {bitrate: 1000000, channels: 2}}\n"
        "devices:\n  gps: {kind: sensor, pe: nav}\n  pitot: {kind: sensor, pe: tail}\n"
        "  red_1: {kind: actuator, pe: nav}\n  red_2: {kind: actuator, pe: tail}\n"
        "  green_1: {kind: actuator, pe: nav}\n  green_2: {kind: actuator, pe: tail}\n"
        "gates: {red: {demux: speed}, green: {demux: speed}}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
        f"  other_driver: {{device: pitot, gives: {{speed: 1}}, {RUNS}}}\n"
        f"  red_driver_1: {{device: red_1, needs: red, {lit}}}\n  red_driver_2: {{device: red_2, needs: red, {lit}}}\n"
        f"  green_driver_1: {{device: green_1, needs: green, {lit}}}\n"
        f"  green_driver_2: {{device: green_2, needs: green, {lit}}}\n"
        "functions: {warning: {output: red, criticality: B}, safe: {output: green, criticality: C}}\n"
    )
    assert [(finding.code, finding.place.line) for finding in found] == [("DG402", 4), ("DG402", 5)]
    assert all("costs 'safe' (C)" in finding.sentence and "no room" in finding.hint for finding in found)


def test_a_class_that_changes_with_the_phase_is_reported_with_each() -> None:
    found = found_in(
        "phases: {climb: {}, cruise: {}, landing: {}}\n"
        "functions: {showing: {output: display, criticality: {default: C, landing: A},"
        " priority: {default: 1, cruise: 0}}}\n"
    )
    at_lamp = [finding for finding in found if finding.place.line == 8]
    assert [finding.code for finding in at_lamp] == ["DG401", "DG402"]
    assert at_lamp[0].sentence == "the loss of device 'lamp' alone costs 'showing' (A in landing)"
    assert at_lamp[1].sentence == "the loss of device 'lamp' alone costs 'showing' (C in climb)"


def test_a_loss_is_accepted_where_the_element_is_declared() -> None:
    lamp = "devices:\n  gps: {kind: sensor, pe: nav}\n  lamp: {kind: actuator, pe: tail}"
    rest = "\nfunctions: {showing: {output: display, criticality: D}}\n"
    lines = {finding.place.line for finding in found_in(lamp + rest)}
    accepted = {finding.place.line for finding in found_in(f"{lamp}  # dg: ignore[DG402] one lamp{rest}")}
    assert lines - accepted == {8}


def test_a_phase_that_does_not_fit_with_everything_up_is_not_asked_what_it_loses() -> None:
    bad = RULES["DG303"].bad
    assert "criticality: C" in bad
    assert found_in(bad) == []


@pytest.mark.soak  # `make lint` checks big_blue with these rules, and drawn specs are planned completely in every run
def test_big_blue_keeps_its_promise() -> None:
    """No single processor carries a class A function alone; what class A depends on is the bus, and pieces of logic."""
    data = shipped_spec_path("big_blue").read_bytes()
    told = assessed(data)
    class_a = [finding for finding in told if "(A" in finding.sentence]
    assert {finding.sentence.split("'")[1] for finding in class_a if finding.code == "DG401"} == {"can0"}
    assert {finding.sentence.split("'")[1] for finding in class_a if finding.code == "DG403"} == {
        "elevator_control",
        "chute_logic",
        "cutdown_logic",
    }
    assert {finding.code for finding in told} == {"DG401", "DG402", "DG403", "DG404"}


def test_figure_3_has_its_two_servos_on_one_processor_and_its_altitudes_too() -> None:
    told = assessed(shipped_spec_path("elevator_and_chute").read_bytes())
    shared = {finding.code: finding.sentence for finding in told if finding.code.startswith("DG41")}
    assert shared == {
        "DG410": "all branches of DEMUX 'elevator_out' are lost with pe 'tail_pe'",
        "DG411": "all inputs of a XOR of 'chute_logic' are lost with pe 'sensor_pe'",
    }


def test_two_versions_from_one_module_are_no_choice() -> None:
    """One mode runs at a time; and the device of the module is named, not what follows from it."""
    found = found_in(
        "variables:\n  speed: {type: FLOAT, versions: 2}\nmodules:\n  driver:\n    device: gps\n    modes:\n"
        f"      fine: {{gives: {{speed: 1}}, {RUNS}}}\n      coarse: {{gives: {{speed: 2}}, {RUNS}}}\n"
        f'  display: {{device: lamp, needs: {{xor: ["speed@1", "speed@2"]}}, {RUNS}}}\n'
    )
    assert [finding.sentence for finding in found] == ["all inputs of a XOR of 'display' are lost with device 'gps'"]


def test_what_takes_the_reader_along_is_not_missed() -> None:
    """Reader and sensors are on one PE: without it no module reads them."""
    nearby = RULES["DG411"].bad.replace("lamp: {kind: actuator, pe: tail}", "lamp: {kind: actuator, pe: nav}")
    assert nearby != RULES["DG411"].bad
    assert found_in(nearby) == []


def test_alternatives_beyond_one_gateway_share_it() -> None:
    found = found_in(
        "buses: {can0: {bitrate: 1000000}, can1: {bitrate: 1000000}}\n"
        "pes:\n  nav: {node_id: 92, buses: [can0, can1], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "  left: {node_id: 93, buses: [can1], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "  right: {node_id: 94, buses: [can1], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "  fore: {node_id: 95, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "devices:\n  gps: {kind: sensor, pe: fore}\n  lamp: {kind: actuator, pe: left}\n"
        "  second_lamp: {kind: actuator, pe: right}\n"
        f"gates: {{light: {{demux: speed}}}}\nmodules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
        f"  display: {{device: lamp, needs: light, {RUNS}}}\n"
        f"  second_display: {{device: second_lamp, needs: light, {RUNS}}}\nfunctions: {{showing: {{output: light}}}}\n"
    )
    assert [finding.sentence for finding in found] == [
        "all branches of DEMUX 'light' are lost with pe 'nav' and bus 'can1'"
    ]


@given(st.lists(st.frozensets(st.integers(0, 5), max_size=3), max_size=7))
def test_independent_sources_are_the_largest_set_without_a_shared_element(inputs: list[frozenset[int]]) -> None:
    named = [frozenset(str(number) for number in one) for one in inputs]
    sizes = [
        size
        for size in range(len(named) + 1)
        for picked in itertools.combinations(named, size)
        if all(not one & other for one, other in itertools.combinations(picked, 2))
    ]
    assert independent(named) == min(3, max(sizes))


def test_together_binds_through_others() -> None:
    middle = "".join(f"  {name}: {{needs: speed, gives: {{level: 1}}, {RUNS}}}\n" for name in ("one", "two", "three"))
    (finding,) = found_in(
        "variables:\n  speed: {type: FLOAT}\n  level: {type: FLOAT}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n{middle}"
        f"  display: {{device: lamp, needs: level, {RUNS}}}\n"
        "together: [[one, two], [two, three]]\nseparate: [[driver, display], [one, three]]\n"
    )
    assert finding.code == "DG420"
    assert finding.sentence == "'one' and 'three' are to be separate here, and together by other rules"
    assert (finding.place.line, finding.place.column) == (21, 31)


def test_three_that_are_to_be_separate_want_three_pes() -> None:
    """Pairwise there is room, and any two of them may run; all three may not."""
    middle = "".join(f"  {name}: {{needs: speed, gives: {{level: 1}}, {RUNS}}}\n" for name in ("one", "two", "three"))
    (finding,) = found_in(
        "variables:\n  speed: {type: FLOAT}\n  level: {type: FLOAT}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n{middle}"
        f"  display: {{device: lamp, needs: level, {RUNS}}}\nseparate: [[one, two, three]]\n"
    )
    assert finding.code == "DG421"
    assert finding.sentence == "of 'one', 'two' and 'three' at most 2 can run together on PEs of their own"
