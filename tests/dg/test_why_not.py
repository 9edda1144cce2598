"""Why a function is not served: the sentence names the root cause, on the paper's Figure 3 and on odder cases."""

import random
from collections.abc import Sequence

import pytest

from heronry_dg.gates import Leaf, could_hold
from heronry_dg.loader import load, loads
from heronry_dg.model import Mode, Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation, elements, situation, survivors
from heronry_dg.why_not import Feasibility, Feasible, feasible, why_not
from lab.benches.check import chain
from planner.random_specs import random_spec, with_phase_inputs

FIGURE_3 = load(shipped_spec_path("elevator_and_chute"))


def reason(function: str, *down: str, spec: Spec = FIGURE_3, phase: str | None = None) -> str:
    return why_not(feasible(spec, situation(spec, down, phase=phase)), spec.functions[function])


@pytest.mark.parametrize(
    ("function", "down", "sentence"),
    [
        ("parachute", "device:chute_solenoid", "chute_driver needs device chute_solenoid, which is down"),
        ("parachute", "pe:control_pe", "chute_driver needs device chute_solenoid on control_pe, which is down"),
        ("parachute", "bus:can0", "nothing can be commanded, because the manager's bus can0 is down"),
        ("servo_monitoring", "module:servo_monitor", "servo_monitor has failed"),
        (
            "servo_monitoring",
            "device:elevator_angle_sensor",
            (
                "servo_monitor needs elevator_angle from angle_driver, which needs device elevator_angle_sensor, "
                "which is down"
            ),
        ),
        (
            "servo_monitoring",
            "module:state_estimator",
            (
                "servo_monitor needs elevator_demand from elevator_control, which needs state_info from "
                "state_estimator, which has failed"
            ),
        ),
        (
            "elevator",
            "module:elevator_control",
            "each of servo_driver_1 and servo_driver_2 needs elevator_demand from elevator_control, which has failed",
        ),
    ],
)
def test_one_fault(function: str, down: str, sentence: str) -> None:
    assert reason(function, down) == sentence


def test_both_branches_of_a_demux_have_their_reason() -> None:
    assert reason("elevator", "device:elevator_servo_1", "module:servo_driver_2") == (
        "servo_driver_1 needs device elevator_servo_1, which is down, and servo_driver_2 has failed"
    )


def test_what_could_run_was_left_out_for_resources_or_for_something_better() -> None:
    found = feasible(FIGURE_3, situation(FIGURE_3, ["device:gps"]))
    parachute = FIGURE_3.functions["parachute"]
    assert why_not(found, parachute).startswith("it could run, but")
    assert why_not(found, parachute, alone=True).startswith("it could run alone, but")
    assert why_not(found, parachute, alone=False).endswith("cannot fit it, even alone")


ODD = """
dg: 1
buses: {near: {bitrate: 500000}, far: {bitrate: 500000}}
pes:
  home: {node_id: 92, buses: [near], cpu: 1, ram: 1KiB, flash: 1KiB}
  gate: {node_id: 93, buses: [near, far], cpu: 1, ram: 1KiB, flash: 1KiB}
  away: {node_id: 94, buses: [far], cpu: 1, ram: 1KiB, flash: 1KiB}
variables:
  picture: {type: FLOAT, versions: 3}
  first: {type: FLOAT, initial: 0}
  second: {type: FLOAT, initial: 0}
modules:
  sharp: {gives: {picture: 1}, cpu: 0, ram: 0, rate_hz: 1, runs_on: [away]}
  plain: {gives: {picture: 2}, cpu: 0, ram: 0, rate_hz: 1, runs_on: [gate, away]}
  sketch: {gives: {picture: 3}, cpu: 0, ram: 0, rate_hz: 1}
  viewer: {needs: "picture@<=2", cpu: 0, ram: 0, rate_hz: 1, runs_on: [home]}
  expert: {needs: {and: [{or: {k: 1, of: ["picture@1", "picture@2", first]}}, second]}, cpu: 0, ram: 0, rate_hz: 1}
  chicken: {needs: first, gives: {second: 1}, cpu: 0, ram: 0, rate_hz: 1}
  egg: {needs: second, gives: {first: 1}, cpu: 0, ram: 0, rate_hz: 1}
functions:
  view: {output: viewer, priority: {default: 1, night: 0}}
  study: {output: expert}
  none: {output: sketch, priority: 0}
phases: {day: {}, night: {}}
"""


def odd(function: str, *down: str, phase: str | None = None) -> str:
    return reason(function, *down, spec=loads(ODD, "odd.dg.yaml"), phase=phase)


def test_a_gateway_takes_along_what_is_behind_it() -> None:
    assert odd("view", "pe:gate") == (
        "viewer needs picture@<=2 from sharp, which may run on away only, which has no route to the manager's bus "
        "near, or from plain, which may run only on PEs that are gone: gate is down, away has no route to the "
        "manager's bus near"
    )


def test_many_producers_are_not_all_listed() -> None:
    spec = loads(ODD.replace('"picture@<=2"', "picture"), "odd.dg.yaml")
    told = reason("view", "module:sharp", "module:plain", "module:sketch", spec=spec)
    assert told == (
        "viewer needs picture from sharp, which has failed, or from plain, which has failed, "
        "or from 1 more that cannot run either"
    )


def test_feedback_carries_itself_until_a_link_breaks() -> None:
    assert odd("study").startswith("it could run")
    assert odd("study", "module:egg") == (
        "expert needs second from chicken, which needs first from egg, which has failed"
    )


def test_what_is_not_wanted() -> None:
    assert odd("view", phase="night") == "it is not wanted in phase night"
    spec = loads(ODD.replace("phases: {day: {}, night: {}}", "").replace(", night: 0", ""), "odd.dg.yaml")
    assert reason("none", spec=spec) == "its priority is 0"


def test_a_module_may_be_out_on_each_pe_for_another_reason() -> None:
    places = ("module:elevator_control@sensor_pe", "module:elevator_control@control_pe")
    assert reason("servo_monitoring", *places, "pe:tail_pe").startswith("servo_monitor needs elevator_angle")
    down = (*places, "module:elevator_control@tail_pe")
    assert reason("elevator", *down) == (
        "each of servo_driver_1 and servo_driver_2 needs elevator_demand from elevator_control, which cannot run "
        "anywhere: sensor_pe cannot run it, control_pe cannot run it, tail_pe cannot run it"
    )
    one_is_down = reason(
        "elevator", "module:elevator_control@control_pe", "module:elevator_control@tail_pe", "pe:sensor_pe"
    )
    assert one_is_down.endswith("sensor_pe is down, control_pe cannot run it, tail_pe cannot run it")


def _round_by_round(spec: Spec, now: Situation) -> dict[tuple[str, str], int]:
    """Remove modes as `Feasible` defines it: every round looks at every mode that is left."""
    left, planned = survivors(spec, now), spec.in_phase(now.phase)
    modes = {(module.name, mode.name): mode for module in planned.modules.values() for mode in module.modes.values()}
    lost = {key: 0 for key in modes if not left.hosts(planned.modules[key[0]])}
    for number in range(1, len(modes) + 2):
        up = [mode for key, mode in modes.items() if key not in lost]

        def is_given(leaf: Leaf, up: Sequence[Mode] = up) -> bool:
            return any(leaf.variable in mode.gives and leaf.accepts(mode.gives[leaf.variable]) for mode in up)

        gone = [k for k, m in modes.items() if k not in lost and m.needs and not could_hold(m.needs, is_given)]
        lost.update(dict.fromkeys(gone, number))
    return lost


@pytest.mark.parametrize("seed", range(60))
def test_what_a_fault_takes_away_is_what_a_look_at_every_mode_in_every_round_finds(seed: int) -> None:
    spec = with_phase_inputs(random.Random(seed), random_spec(random.Random(seed), modules=12))
    for phase in (*spec.phases, None):
        feasibility = Feasibility(spec, phase)
        for down in (frozenset[str](), *(frozenset({element}) for element in elements(spec))):
            now = Situation(down, phase=phase)
            assert feasibility.in_situation(now).lost == _round_by_round(spec, now)


def test_a_fault_is_followed_to_its_readers_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    feasibility = Feasibility(loads(chain(1_000), "chain"), None)
    asked: list[int] = []
    can_hold = Feasible.can_hold
    monkeypatch.setattr(Feasible, "can_hold", lambda *given: asked.append(1) or can_hold(*given))
    found = feasibility.in_situation(Situation(frozenset({"module:m500"})))
    assert found.lost["m509", "only"] == 9
    assert len(asked) < 30
