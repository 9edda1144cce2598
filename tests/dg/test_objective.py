"""What a configuration is worth, level by level, calculated by hand on the paper's Figure 3."""

from dataclasses import replace

import pytest

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.objective import Objective, Placement, score
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation

FIGURE_3 = load(shipped_spec_path("elevator_and_chute"))

ELEVATOR = {
    "state_estimator": Running("tail_pe", "only"),
    "elevator_control": Running("tail_pe", "only", {"": Wire("state_estimator", "state_info", 1)}),
    "servo_driver_2": Running("tail_pe", "only", {"": Wire("elevator_control", "elevator_demand", 1)}),
}
# Two consumers of one pressure: one on its own PE, one across the bus, which is what costs bandwidth.
PARACHUTE = {
    "pressure_driver": Running("sensor_pe", "only"),
    "gps_driver": Running("sensor_pe", "only"),
    "high_quality_altitude": Running(
        "control_pe",
        "fused",
        {"0": Wire("gps_driver", "gps_altitude", 1), "1": Wire("pressure_driver", "absolute_pressure", 1)},
    ),
    "chute_logic": Running("control_pe", "only", {"0.0": Wire("high_quality_altitude", "altitude", 1)}),
    "chute_driver": Running("control_pe", "only", {"": Wire("chute_logic", "chute_release", 1)}),
}


def worth(
    modules: dict[str, Running],
    running: Configuration | Placement | None = None,
    spec: Spec = FIGURE_3,
) -> Objective:
    return score(spec, situation(spec), Configuration(modules), running)


def test_every_level_of_a_plan() -> None:
    assert worth({**ELEVATOR, **PARACHUTE}) == Objective(
        critical=(100, 80, 0, 0),
        utility=100 * 100 + 80 * 100,
        inputs=3,  # altitude@1 of three versions, below a XOR
        changes=0,
        branches=1,  # the second servo
        bus_mbit_per_s=135 * 10_000 + 135 * 80_000,  # GPS altitude and pressure; both frames carry 8 bytes
        cpu_millis=100 + 120 + 30 + 20 + 50 + 200 + 20 + 10,
    )


def test_the_empty_plan_is_worth_nothing() -> None:
    assert worth({}).key() == (0,) * 10


def test_a_key_says_all_of_an_objective() -> None:
    assert Objective.of_key(BASE.key()) == BASE
    with pytest.raises(ValueError, match="values to unpack"):
        Objective.of_key(BASE.key()[:-1])


def test_a_change_is_a_start_a_stop_a_move_or_another_mode() -> None:
    before = {name: (running.mode, running.pe) for name, running in ELEVATOR.items()}
    assert worth(ELEVATOR, before).changes == 0
    assert worth(ELEVATOR, Configuration(ELEVATOR)).changes == 0
    assert worth({**ELEVATOR, **PARACHUTE}, before).changes == 5
    assert worth({}, before).changes == 3
    moved = {**ELEVATOR, "state_estimator": Running("control_pe", "only")}
    assert worth(moved, before).changes == 1
    assert worth(PARACHUTE, {"high_quality_altitude": ("gps_only", "control_pe")}).changes == 5
    assert worth(ELEVATOR, None).changes == 0


def test_criticality_and_priority_are_those_of_the_phase() -> None:
    elevator = FIGURE_3.functions["elevator"]
    glide = replace(elevator, criticality={None: "A", "glide": "C"}, priority={None: 100, "glide": 7})
    spec = replace(FIGURE_3, functions={**FIGURE_3.functions, "elevator": glide})
    now = replace(situation(spec), phase="glide")
    assert score(spec, now, Configuration(ELEVATOR), None).critical == (0, 0, 7, 0)
    assert score(spec, now, Configuration(ELEVATOR), None).utility == 700


def test_class_e_counts_for_utility_alone() -> None:
    elevator = replace(FIGURE_3.functions["elevator"], criticality={None: "E"})
    spec = replace(FIGURE_3, functions={**FIGURE_3.functions, "elevator": elevator})
    objective = worth(ELEVATOR, spec=spec)
    assert objective.critical == (0, 0, 0, 0)
    assert objective.utility == 10_000


def test_bits_are_compared_exactly_and_reported_rounded_down() -> None:
    objective = replace(worth(ELEVATOR), bus_mbit_per_s=1_999)
    assert objective.bus_bits_per_s == 1
    assert objective.key() > replace(objective, bus_mbit_per_s=2_000).key()


BASE = Objective((5, 5, 5, 5), 5, 5, 5, 5, 5, 5)


@pytest.mark.parametrize(
    "better",
    [
        replace(BASE, critical=(6, 0, 0, 0), utility=0),
        replace(BASE, critical=(5, 6, 0, 0), utility=0),
        replace(BASE, critical=(5, 5, 5, 6), utility=0),
        replace(BASE, utility=6, inputs=0),
        replace(BASE, inputs=6, changes=99),
        replace(BASE, changes=4, branches=99),
        replace(BASE, branches=4, bus_mbit_per_s=99),
        replace(BASE, bus_mbit_per_s=4, cpu_millis=99),
        replace(BASE, cpu_millis=4),
    ],
)
def test_the_first_difference_decides(better: Objective) -> None:
    assert better.key() > BASE.key()
