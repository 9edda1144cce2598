"""What is less than the best upstream of an output, with the module named."""

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.shortfalls import shortfalls
from heronry_dg.situation import Situation
from heronry_manager.planner.exact import plan


def found(*down: str, output: str = "chute_driver") -> tuple[str, ...]:
    spec = figure_3()
    running = plan(spec, Situation(frozenset(down))).configuration
    return shortfalls(spec, running, output, None)


def figure_3() -> Spec:
    return load(shipped_spec_path("elevator_and_chute"))


def test_there_is_nothing_while_all_runs_at_its_best() -> None:
    assert found() == ()


def test_a_lesser_mode_and_the_version_that_follows_name_their_modules() -> None:
    assert found("device:barometer") == (
        "chute_logic reads altitude@2",
        "high_quality_altitude runs in mode gps_only, not fused",
    )


def test_the_other_input_of_a_xor_is_not_missing() -> None:
    assert found("device:gps") == ("chute_logic reads altitude@3",)


def test_missing_optional_inputs_are_named() -> None:
    assert found("device:gps", "device:barometer") == ("chute_logic runs without altitude@<=2, altitude@3",)
    assert found("device:receiver") == ("chute_logic runs without release_command",)


def test_another_function_is_not_touched() -> None:
    assert found("device:gps", "device:receiver", output="servo_driver_1") == ()


def test_a_cycle_is_gone_through_once_and_an_unknown_producer_is_skipped() -> None:
    spec = figure_3()
    wire = Wire("elevator_control", "elevator_demand", 1)
    modules = {"servo_driver_1": Running("tail_pe", "only", {"": wire}), "elevator_control": Running("tail_pe", "only")}
    assert shortfalls(spec, Configuration(modules), "servo_driver_1", None) == ()
    assert shortfalls(spec, Configuration({"servo_driver_1": modules["servo_driver_1"]}), "servo_driver_1", None) == ()


def test_an_input_that_the_phase_closes_is_not_missing() -> None:
    text = shipped_spec_path("elevator_and_chute").read_text()
    text = text.replace("release_command]}}", "{var: release_command, only_in: [glide]}]}}")
    text = text.replace("functions:\n", "phases:\n  climb: {}\n  glide: {}\nfunctions:\n", 1)
    spec = loads(text, "phased.dg.yaml")
    without = Situation(frozenset(("device:receiver",)), phase="climb")
    assert shortfalls(spec, plan(spec, without).configuration, "chute_driver", "climb") == ()
    without = Situation(frozenset(("device:receiver",)), phase="glide")
    assert shortfalls(spec, plan(spec, without).configuration, "chute_driver", "glide") == (
        "chute_logic runs without release_command",
    )
