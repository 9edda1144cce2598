"""DG3xx beyond the examples of its rules: which cause is reported, at which place, and in which phases."""

import random
import subprocess
import sys

import pytest

from heronry_dg.check.assess import assess
from heronry_dg.check.examples import whole_spec
from heronry_dg.findings import Finding
from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_names, shipped_spec_path
from heronry_dg.situation import Situation
from heronry_dg.traffic import frame_bits
from heronry_manager.planner.candidates import candidates
from heronry_manager.planner.exact import plan
from heronry_tools.analysis.check.forced_traffic import forced_traffic
from heronry_tools.analysis.check.registry import RULES
from heronry_tools.analysis.check.resource_rules import FAMILY, RESERVE_TOO_SMALL
from heronry_tools.analysis.check.resources import check
from heronry_tools.analysis.check.wanted import critical_functions, phases
from heronry_tools.analysis.servable import Planning, without_deadlines
from planner.comparison import crossing_case
from planner.random_specs import random_case

RUNS = "cpu: 0.1, ram: 1KiB, rate_hz: 10"


def found_in(fragment: str) -> list[Finding]:
    return list(assess(whole_spec(fragment), "x.dg.yaml", {FAMILY.prefix: check}, RULES).findings)


def spec_of(fragment: str) -> Spec:
    return loads(whole_spec(fragment).decode(), "x")


def test_a_module_without_the_features_it_requires_says_which() -> None:
    modules = f"modules:\n  driver: {{requires: [fpu], gives: {{speed: 1}}, {RUNS}}}\n"
    modules += f"  display: {{device: lamp, needs: speed, {RUNS}}}\n"
    (finding,) = found_in(modules)
    assert (finding.code, finding.place.line) == ("DG301", 12)
    assert "feature fpu" in finding.sentence


@pytest.mark.parametrize("what", ["ram: 1MiB, flash: 1KiB", "ram: 1KiB, flash: 1MiB"])
def test_memory_counts_as_much_as_cpu(what: str) -> None:
    modules = f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, cpu: 0.1, {what}, rate_hz: 10}}\n"
    (finding,) = found_in(modules + f"  display: {{device: lamp, needs: speed, {RUNS}}}\n")
    assert finding.code == "DG301"
    assert "65536 of 1048576 bytes of " in finding.sentence


def test_what_does_not_fit_in_one_phase_is_reported_with_that_phase() -> None:
    """Two lamps share a PE that has room for one; only the landing wants both."""
    (finding,) = found_in(
        "devices:\n  gps: {kind: sensor, pe: nav}\n"
        "  red: {kind: actuator, pe: tail}\n  green: {kind: actuator, pe: tail}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
        "  red_driver: {device: red, needs: speed, cpu: 0.6, ram: 1KiB, rate_hz: 10}\n"
        "  green_driver: {device: green, needs: speed, cpu: 0.6, ram: 1KiB, rate_hz: 10}\n"
        "functions:\n  warning: {output: red_driver, criticality: B}\n"
        "  safe: {output: green_driver, criticality: C, priority: {default: 0, landing: 1}}\n"
        "phases: {climb: {}, landing: {}}\n"
    )
    assert finding.code == "DG303"
    assert finding.sentence.startswith("function 'safe' (class C)")
    assert "in landing" in finding.sentence


def test_what_is_not_critical_may_be_crowded_out() -> None:
    """Degrading by choice is what priorities are for, so it is a warning; what could never be served is a mistake."""
    assert [
        one.code
        for one in found_in(
            "devices:\n  gps: {kind: sensor, pe: nav}\n"
            "  red: {kind: actuator, pe: tail}\n  blue: {kind: actuator, pe: tail}\n"
            f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
            "  red_driver: {device: red, needs: speed, cpu: 0.6, ram: 1KiB, rate_hz: 10}\n"
            "  blue_driver: {device: blue, needs: speed, cpu: 0.6, ram: 1KiB, rate_hz: 10}\n"
            "functions:\n  warning: {output: red_driver, criticality: B}\n  fun: {output: blue_driver}\n"
        )
    ] == ["DG311"]


def test_an_overloaded_bus_is_blamed_and_not_the_function() -> None:
    (finding,) = found_in(
        "buses:\n  can0: {bitrate: 10000, heartbeat_ms: 1000}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, cpu: 0.1, ram: 1KiB, rate_hz: 60}}\n"
        f"  display: {{device: lamp, needs: speed, {RUNS}}}\n"
    )
    assert (finding.code, finding.place.line, finding.place.column) == ("DG305", 3, 3)
    assert "8100 bit/s" in finding.sentence


def test_a_slower_mode_takes_the_force_out_of_the_traffic() -> None:
    assert (
        found_in(
            "buses: {can0: {bitrate: 10000, heartbeat_ms: 1000}}\n"
            "modules:\n  driver:\n    device: gps\n    modes:\n"
            "      fast: {gives: {speed: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 60}\n"
            "      slow: {gives: {speed: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}\n"
            f"  display: {{device: lamp, needs: speed, {RUNS}}}\n"
        )
        == []
    )


def test_a_missed_deadline_shows_what_goes_first() -> None:
    """`speed` goes first by its standard identifier, and then there is no time left for `height`."""
    (finding,) = found_in(
        "variables:\n  speed: {type: FLOAT, identifier: 315}\n  height: {type: FLOAT, deadline_ms: 0.9}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1, height: 1}}, {RUNS}}}\n"
        f"  display: {{device: lamp, needs: {{and: [speed, height]}}, {RUNS}}}\n"
    )
    assert (finding.code, finding.place.line) == ("DG306", 11)
    assert "takes up to 0.945 ms on bus 'can0' and must arrive within 0.900 ms" in finding.sentence
    assert "'speed' every 100 ms (0.810 ms of 100.000 ms)" in finding.hint


def test_the_reserve_counts_states_from_behind_gateways() -> None:
    """Four states a second of `far` pass up through `can0`, beside those of its PEs and two frames of the manager.

    Four CANopen heartbeats of 65 bits, an echo of the only output, and four reports on `link` come each second, too.
    """
    fragment = (
        "buses:\n  can0: {bitrate: 10000, heartbeat_ms: 1000, reserve: SHARE}\n"
        "  link: {bitrate: 100000, kind: wireless, heartbeat_ms: 250}\n"
        "pes:\n  nav: {node_id: 92, buses: [can0], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "  tail: {node_id: 93, buses: [can0, link], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
        "  far: {node_id: 94, buses: [link], cpu: 1, ram: 64KiB, flash: 64KiB}\n"
    )
    assert found_in(fragment.replace("SHARE", "0.202")) == []
    (finding,) = found_in(fragment.replace("SHARE", "0.201"))
    assert finding.code == RESERVE_TOO_SMALL.code
    assert "CANopen heartbeats, reports on radios and the echoes of 1 outputs take 2015 bit/s" in finding.sentence
    assert finding.hint == "write reserve: 0.202 or heartbeat_ms: 1010, or more"
    (swamped,) = found_in(fragment.replace("SHARE", "0.1").replace("bitrate: 10000,", "bitrate: 1000,"))
    assert (swamped.code, swamped.hint) == ("DG307", "raise the bit rate")


@pytest.mark.parametrize("name", shipped_spec_names())
def test_shipped_specs_have_room_for_all_that_is_critical(name: str) -> None:
    data = shipped_spec_path(name).read_bytes()
    assert assess(data, name, {FAMILY.prefix: check}, RULES).findings == ()


@pytest.mark.parametrize("seed", range(40))
def test_forced_traffic_is_a_bound_from_below(seed: int) -> None:
    """No configuration that serves a function publishes less than what serving it forces."""
    spec = crossing_case(random.Random(seed), modules=6).spec
    planning = Planning(without_deadlines(spec))
    for name in spec.functions:
        served = planning.all_at_once([name]).configuration
        if served is None:
            continue
        found = plan(spec, Situation(phase=spec.initial_phase()))  # the report counts what is published
        forced = forced_traffic(planning.candidates_for([name]))
        for bus in forced.rates:
            if found.functions[name].served:
                assert sum(forced.mbit_per_s(bus).values()) // 1000 <= found.buses[bus].bits_per_s


@pytest.mark.parametrize("seed", range(30))
def test_all_at_once_agrees_with_the_plan_of_each_phase(seed: int) -> None:
    """Where all that is critical fits at once, no phase gives any of it up; where it does not, its plan shows so."""
    spec = random_case(random.Random(seed), modules=6).spec
    planning = Planning(spec)
    for phase in phases(spec):
        critical = critical_functions(spec, phase)
        fits = planning.all_at_once(critical)
        found = plan(spec, Situation(phase=phase))
        assert fits.proven
        assert (fits.configuration is not None) == all(found.functions[name].served for name in critical)


def test_listing_the_rules_loads_no_solver() -> None:
    program = "import sys, heronry_tools.analysis.check.registry; sys.exit('ortools' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_forced_traffic_counts_a_variable_once_however_many_read_it() -> None:
    spec = spec_of(
        "devices:\n  gps: {kind: sensor, pe: nav}\n"
        "  red: {kind: actuator, pe: tail}\n  blue: {kind: actuator, pe: tail}\n"
        f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
        f"  red_driver: {{device: red, needs: speed, {RUNS}}}\n  blue_driver: {{device: blue, needs: speed, {RUNS}}}\n"
        "functions: {warning: {output: red_driver}, fun: {output: blue_driver}}\n"
    )
    forced = forced_traffic(candidates(spec, Situation()))
    assert forced.mbit_per_s("can0") == {"speed": frame_bits(spec, "speed") * 10_000}
