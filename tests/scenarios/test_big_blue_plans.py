"""BIG BLUE III as planned: what the spec holds, what the plans serve, and what they give up first."""

from functools import cache

import pytest

from heronry_dg.field_types import CRITICALITIES
from heronry_dg.gates import leaves
from heronry_dg.loader import load
from heronry_dg.plan import Plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_dg.verify import verify
from heronry_manager.planner.exact import plan
from heronry_wire.standard_identifiers import standard_identifiers

SPEC = load(shipped_spec_path("big_blue"))
PHASES = tuple(SPEC.phases)


@cache
def planned(phase: str, down: tuple[str, ...] = (), limits: tuple[str, ...] = ()) -> Plan:
    now = situation(SPEC, down, limits, phase)
    made = plan(SPEC, now)
    assert verify(SPEC, now, made.configuration) == []
    return made


def unserved(made: Plan, phase: str) -> set[str]:
    """Functions that the phase wants and the plan does not serve, as `A:elevator`."""
    running = made.configuration.modules
    return {
        f"{f.criticality_in(phase)}:{f.name}"
        for f in SPEC.functions.values()
        if f.priority_in(phase) > 0 and not any(output in running for output in f.outputs)
    }


def modes(made: Plan) -> dict[str, str]:
    return {name: running.mode for name, running in made.configuration.modules.items()}


def source(made: Plan, module: str, variable: str) -> str | None:
    """Where a running module gets a variable from."""
    wires = made.configuration.modules[module].inputs.values()
    return next((wire.producer for wire in wires if wire.variable == variable), None)


def test_it_is_the_size_of_a_real_aircraft() -> None:
    assert (len(SPEC.pes), len(SPEC.phases), SPEC.contingency.faults) == (9, 4, 2)
    assert len(SPEC.devices) >= 12
    assert len(SPEC.modules) >= 35
    assert {f.criticality_in(phase) for f in SPEC.functions.values() for phase in PHASES} == set(CRITICALITIES)
    assert sum(len(module.modes) > 1 for module in SPEC.modules.values()) >= 8
    assert len(SPEC.demuxes) == 4
    assert SPEC.separate
    assert SPEC.together
    assert any(variable.initial is not None for variable in SPEC.variables.values())


def test_no_variable_is_without_a_reader() -> None:
    read = {leaf.variable for m in SPEC.modules.values() for mode in m.modes.values() for _, leaf in leaves(mode.needs)}
    assert read == SPEC.variables.keys()


def test_standard_data_carry_their_own_type_and_unit() -> None:
    standard = [v for v in SPEC.variables.values() if v.identifier is not None]
    assert len(standard) >= 10
    for variable in standard:
        entry = standard_identifiers()[variable.identifier]
        assert variable.type in [data_type.name for data_type in entry.types]
        assert variable.unit == entry.unit


def test_each_redundant_output_has_its_branches_on_two_processors() -> None:
    for demux in SPEC.demuxes.values():
        hosts = [SPEC.devices[SPEC.modules[branch].device].pe for branch in demux.branches]
        assert len(set(hosts)) == len(hosts) == 2


@pytest.mark.parametrize("phase", PHASES)
def test_with_nothing_down_everything_is_served_at_its_best(phase: str) -> None:
    made = planned(phase)
    assert unserved(made, phase) == set()
    best = {name: next(iter(module.modes)) for name, module in SPEC.modules.items()}
    assert all(mode == best[name] for name, mode in modes(made).items())


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("pe", SPEC.pes)
def test_no_single_processor_takes_a_class_a_function_along(phase: str, pe: str) -> None:
    missing = unserved(planned(phase, (f"pe:{pe}",)), phase)
    assert not any(name.startswith("A:") for name in missing)
    if (phase, pe) != ("deployment", "wing"):  # there is one gas valve
        assert not any(name.startswith("B:") for name in missing)


@pytest.mark.parametrize("device", [d for d in SPEC.devices if SPEC.devices[d].kind == "actuator"])
def test_no_single_actuator_takes_a_class_a_function_along(device: str) -> None:
    for phase in ("deployment", "landing"):
        missing = unserved(planned(phase, (f"device:{device}",)), phase)
        assert not any(name.startswith("A:") for name in missing)


def test_attitude_falls_back_from_gravity_to_gyros_to_the_horizon() -> None:
    flown = [
        planned("glide"),
        planned("glide", ("pe:nav",)),
        planned("glide", ("pe:flight", "pe:nav")),
    ]
    assert [source(made, "elevator_control", "pitch_angle") for made in flown] == [
        "attitude_filter",
        "attitude_filter",
        "horizon_attitude",
    ]
    assert modes(flown[0])["attitude_filter"] == "fused"
    assert modes(flown[1])["attitude_filter"] == "gyro_only"
    assert unserved(flown[2], "glide") == {"E:experiment"}


def test_altitude_falls_back_from_fused_to_either_source() -> None:
    assert modes(planned("glide"))["high_quality_altitude"] == "fused"
    assert source(planned("glide", ("device:gps",)), "chute_logic", "altitude") == "low_quality_altitude"
    without_pressure = tuple(f"device:pressure_sensor_{i}" for i in (1, 2, 3))
    assert modes(planned("glide", without_pressure))["high_quality_altitude"] == "gps_only"
    one_pressure = without_pressure[:2]
    assert modes(planned("glide", one_pressure))["pressure_voter"] == "single"


def test_the_experiment_steers_while_its_link_carries_it_and_the_one_on_board_stands_by() -> None:
    made = planned("glide")
    assert source(made, "elevator_control", "pitch_command") == "experimental_autopilot"
    assert modes(made)["guidance"] == "route"
    lost = planned("glide", ("bus:radio",))
    assert source(lost, "elevator_control", "pitch_command") == "guidance"
    assert unserved(lost, "glide") == {"C:telemetry", "E:experiment", "E:imaging"}


def test_the_landing_takes_the_ground_s_computer_away_from_the_experiment() -> None:
    made = planned("landing")
    assert "pilot_view" in made.configuration.modules
    assert "experimental_autopilot" not in made.configuration.modules
    assert source(made, "elevator_control", "pitch_command") == "guidance"


def test_a_radio_that_fades_gives_up_inputs_then_pictures_then_the_experiment_then_its_rate() -> None:
    def flown(percent: int) -> tuple[str, bool, str]:
        made = planned("glide", (), (f"bus:radio={percent}%",))
        assert not any(name.startswith(("A:", "B:", "C:")) for name in unserved(made, "glide"))
        return modes(made)["imaging"], "experimental_autopilot" in made.configuration.modules, modes(made)["telemetry"]

    assert flown(70) == ("full", True, "live")
    assert flown(40) == ("preview", True, "live")
    assert flown(20) == ("preview", False, "live_without_position")
    assert flown(10) == ("preview", False, "slow")


@pytest.mark.parametrize(
    ("down", "lost"),
    [
        (("pe:tail_a", "pe:tail_b"), {"A:elevator", "B:rudder", "C:servo_watch"}),
        (("pe:wing", "pe:payload"), {"A:parachute", "C:wing_inflation", "C:wing_watch", "D:flight_log", "E:imaging"}),
    ],
)
def test_two_processors_that_hold_both_halves_of_a_pair_cost_it(down: tuple[str, ...], lost: set[str]) -> None:
    assert unserved(planned("glide", down), "glide") == lost


@pytest.mark.parametrize("down", [("pe:flight", "pe:air"), ("pe:flight", "pe:tail_a"), ("pe:flight", "pe:payload")])
def test_two_losses_cost_quality_and_no_function_of_classes_a_to_c(down: tuple[str, ...]) -> None:
    made = planned("glide", down)
    best = {name: next(iter(module.modes)) for name, module in SPEC.modules.items()}
    assert any(mode != best[name] for name, mode in modes(made).items())
    assert not any(name.startswith(("A:", "B:", "C:")) for name in unserved(made, "glide"))


def test_the_balloon_s_line_can_be_cut_as_long_as_there_is_a_balloon_and_no_longer() -> None:
    wanted = {phase: SPEC.functions["balloon_release"].priority_in(phase) > 0 for phase in PHASES}
    assert wanted == {"ascent": True, "deployment": True, "glide": False, "landing": False}
    assert "cutdown_driver_1" in planned("ascent").configuration.modules
    assert "cutdown_driver_1" not in planned("glide").configuration.modules
