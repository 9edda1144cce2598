"""The paper's Figure 3, fault by fault: only the modules that semantics.md section 6 names run."""

import pytest

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import Objective, placement
from heronry_dg.plan import Plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_dg.verify import verify
from heronry_manager.planner.exact import plan
from planner.enumerator import Enumerator

ALTITUDE_1_OR_2, ALTITUDE_3, RELEASE = "0.0", "0.1", "1"  # inputs of chute_logic


@pytest.fixture(scope="module")
def spec() -> Spec:
    return load(shipped_spec_path("elevator_and_chute"))


def planned(spec: Spec, *down: str) -> Plan:
    """Plan, and check the plan by the verifier and by brute force."""
    now = situation(spec, down)
    found = plan(spec, now)
    assert found.optimal
    assert verify(spec, now, found.configuration) == []
    assert found.objective.key() == Enumerator(spec, now).best()[0]
    return found


def served(found: Plan) -> set[str]:
    return {name for name, report in found.functions.items() if report.served}


def sources(found: Plan, module: str) -> dict[str, str]:
    return {path: wire.producer for path, wire in found.configuration.modules[module].inputs.items()}


def test_with_nothing_down_everything_is_served_with_the_best_altitude(spec: Spec) -> None:
    found = planned(spec)
    assert served(found) == {"elevator", "parachute", "servo_monitoring"}
    assert found.configuration.modules["high_quality_altitude"].mode == "fused"
    assert "low_quality_altitude" not in found.configuration.modules
    assert "servo_driver_2" not in found.configuration.modules
    assert sources(found, "chute_logic") == {ALTITUDE_1_OR_2: "high_quality_altitude", RELEASE: "release_driver"}
    assert found.objective == Objective(
        critical=(100, 80, 0, 20),
        utility=20_000,  # three functions, all at value 100
        inputs=4,  # altitude@1 is worth 3, the release command 1
        changes=0,
        branches=0,
        bus_mbit_per_s=1_350_000,  # altitude crosses: 135 bits, 10 times a second
        cpu_millis=610,
    )


def test_without_gps_the_xor_takes_the_low_quality_altitude(spec: Spec) -> None:
    found = planned(spec, "device:gps")
    assert served(found) == {"elevator", "parachute", "servo_monitoring"}
    assert "high_quality_altitude" not in found.configuration.modules
    assert sources(found, "chute_logic") == {ALTITUDE_3: "low_quality_altitude", RELEASE: "release_driver"}


def test_without_the_barometer_the_altitude_comes_from_gps_alone(spec: Spec) -> None:
    found = planned(spec, "device:barometer")
    assert found.configuration.modules["high_quality_altitude"].mode == "gps_only"
    assert sources(found, "chute_logic") == {ALTITUDE_1_OR_2: "high_quality_altitude", RELEASE: "release_driver"}


def test_with_no_altitude_at_all_the_chute_logic_runs_on_the_release_command(spec: Spec) -> None:
    found = planned(spec, "device:gps", "device:barometer")
    assert served(found) == {"elevator", "parachute", "servo_monitoring"}
    assert sources(found, "chute_logic") == {RELEASE: "release_driver"}
    assert found.objective.bus_mbit_per_s == 0


def test_with_no_input_left_the_chute_logic_still_runs(spec: Spec) -> None:
    found = planned(spec, "device:gps", "device:barometer", "device:receiver")
    assert "parachute" in served(found)
    assert sources(found, "chute_logic") == {}


def test_when_the_first_servo_fails_the_other_branch_drives_the_elevator(spec: Spec) -> None:
    found = planned(spec, "device:elevator_servo_1")
    assert served(found) == {"elevator", "parachute", "servo_monitoring"}
    assert sources(found, "servo_driver_2") == {"": "elevator_control"}
    assert "servo_driver_1" not in found.configuration.modules
    assert found.objective.branches == 1


def test_without_the_tail_nothing_serves_the_elevator_and_the_parachute_still_is(spec: Spec) -> None:
    found = planned(spec, "pe:tail_pe")
    assert served(found) == {"parachute"}
    assert found.objective.critical == (0, 80, 0, 0)
    reason = found.functions["elevator"].why_not
    assert reason is not None
    assert "tail_pe, which is down" in reason
    assert {running.pe for running in found.configuration.modules.values()} == {"sensor_pe", "control_pe"}


def test_without_the_managers_bus_nothing_can_be_commanded_and_the_plan_is_empty(spec: Spec) -> None:
    found = planned(spec, "bus:can0")
    assert found.configuration.modules == {}
    assert served(found) == set()


def test_what_runs_stays_where_it_is_as_far_as_it_can(spec: Spec) -> None:
    before = plan(spec, situation(spec))
    after = plan(spec, situation(spec, ["device:elevator_servo_1"]), placement(before.configuration))
    assert after.objective.changes == 2  # one driver stops, the other one starts
    assert verify(spec, after.now, after.configuration) == []


def test_the_same_question_has_the_same_answer(spec: Spec) -> None:
    now = situation(spec, ["device:gps"])
    assert plan(spec, now).to_json() == plan(spec, now).to_json()
