"""One illegal plan for every rule and sub-rule, which that rule alone reports, beside a legal twin.

Most vary one legal plan of one small aircraft. Capacities and deadlines are tried at their exact limit and one step
beyond.
"""

import random
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, situation
from heronry_dg.verify import verify

GLIDER = """
dg: 1
name: glider
buses:
  can0: {bitrate: 500000}
  can1: {bitrate: 125000, channels: 2}
pes:
  nose: {node_id: 92, buses: [can0], cpu: 0.4, ram: 8KiB, flash: 8KiB}
  mid: {node_id: 93, buses: [can0, can1], cpu: 0.4, ram: 8KiB, flash: 8KiB, features: [fpu]}
  tail: {node_id: 94, buses: [can1], cpu: 0.4, ram: 8KiB, flash: 8KiB, features: [fpu]}
devices:
  gps: {kind: sensor, pe: nose}
  servo_1: {kind: actuator, pe: tail}
  servo_2: {kind: actuator, pe: mid}
variables:
  position: {type: FLOAT, versions: 2}
  wind: {type: FLOAT}
  demand: {type: FLOAT}
  log_entry: {type: UCHAR, initial: 0}
gates:
  surface: {demux: demand}
modules:
  receiver: {device: gps, gives: {position: 1}, cpu: 0.1, ram: 1KiB, flash: 1KiB, rate_hz: 10}
  dead_reckoning: {runs_on: [nose, mid], gives: {position: 2}, cpu: 0.1, ram: 1KiB, flash: 1KiB, rate_hz: 10}
  wind_filter: {requires: [fpu], gives: {wind: 1}, cpu: 0.1, ram: 1KiB, flash: 1KiB, rate_hz: 10}
  control:
    flash: 1KiB
    modes:
      full:
        needs: {and: ["position@1", {or: {k: 1, of: [wind, {and: [log_entry]}]}}]}
        gives: {demand: 1}
        cpu: 0.2
        ram: 2KiB
        rate_hz: 50
      simple:
        needs: {xor: ["position@1", "position@2"]}
        gives: {demand: 1}
        cpu: 0.1
        ram: 1KiB
        rate_hz: 10
  driver_1: {needs: surface, device: servo_1, cpu: 0.05, ram: 1KiB, flash: 1KiB, rate_hz: 50}
  driver_2: {needs: {and: [surface]}, device: servo_2, cpu: 0.05, ram: 1KiB, flash: 1KiB, rate_hz: 50}
  trim_driver: {needs: demand, device: servo_1, cpu: 0.05, ram: 1KiB, flash: 1KiB, rate_hz: 50}
  logger:
    needs: {or: {k: 0, of: [{and: [position, wind]}, demand]}}
    gives: {log_entry: 1}
    cpu: 0.05
    ram: 1KiB
    flash: 1KiB
    rate_hz: 10
  recorder: {needs: log_entry, cpu: 0.05, ram: 1KiB, flash: 1KiB, rate_hz: 10}
functions:
  steering: {output: surface, criticality: A, priority: 10}
  trimming: {output: trim_driver}
  logging: {output: recorder, priority: {default: 1, landing: 0}}
phases: {cruise: {}, landing: {}}
"""

Modules = dict[str, Running]

POSITION, WIND = Wire("receiver", "position", 1), Wire("wind_filter", "wind", 1)
DEMAND, LOG_ENTRY = Wire("control", "demand", 1), Wire("logger", "log_entry", 1)

# receiver (nose) -- can0 --> control (mid) -- can1 --> driver_1 (tail); wind comes the other way over can1.
FLYING: Modules = {
    "receiver": Running("nose", "only"),
    "wind_filter": Running("tail", "only"),
    "control": Running("mid", "full", {"0": POSITION, "1.0": WIND}),
    "driver_1": Running("tail", "only", {"": DEMAND}),
}
LOGGING: Modules = {
    **FLYING,
    "logger": Running("mid", "only", {"0.0": POSITION, "0.1": WIND}),
    "recorder": Running("mid", "only", {"": LOG_ENTRY}),
}
# Without GPS: the worse position is made on the PE that uses it.
SIMPLE: Modules = {
    "dead_reckoning": Running("mid", "only"),
    "control": Running("mid", "simple", {"1": Wire("dead_reckoning", "position", 2)}),
    "driver_2": Running("mid", "only", {"0": DEMAND}),
}
# One module drives servo_1 instead of the other.
TRIMMING: Modules = {
    **{name: running for name, running in FLYING.items() if name != "driver_1"},
    "trim_driver": Running("tail", "only", {"": DEMAND}),
}
# The log and the control feed each other.
FEEDBACK: Modules = {
    "receiver": Running("nose", "only"),
    "control": Running("mid", "full", {"0": POSITION, "1.1.0": LOG_ENTRY}),
    "logger": Running("mid", "only", {"1": DEMAND}),
    "driver_1": Running("tail", "only", {"": DEMAND}),
}


@cache
def glider() -> Spec:
    return loads(GLIDER, "glider.dg.yaml")


def broken(modules: Modules, now: Situation | None = None, spec: Spec | None = None) -> list[str]:
    """Names of the rules that a plan breaks."""
    spec = spec or glider()
    return [violation.rule for violation in verify(spec, now or situation(spec), Configuration(modules))]


def without(modules: Modules, *names: str) -> Modules:
    return {name: running for name, running in modules.items() if name not in names}


def moved(modules: Modules, name: str, pe: str) -> Modules:
    return {**modules, name: replace(modules[name], pe=pe)}


def wired(modules: Modules, name: str, inputs: dict[str, Wire | None]) -> Modules:
    """The plan with some inputs of a module wired otherwise; None: not wired."""
    after = {**modules[name].inputs, **inputs}
    kept = {path: wire for path, wire in after.items() if wire is not None}
    return {**modules, name: replace(modules[name], inputs=kept)}


@pytest.mark.parametrize("modules", [{}, FLYING, LOGGING, SIMPLE, TRIMMING, FEEDBACK])
def test_the_plans_that_the_others_vary_are_legal(modules: Modules) -> None:
    assert broken(modules) == []


@pytest.mark.parametrize(
    ("rule", "modules"),
    [
        ("1.module", {**FLYING, "ghost": Running("mid", "only")}),
        ("1.mode", {**FLYING, "recorder": Running("mid", "fast")}),
        ("1.pe", moved(FLYING, "driver_1", "wing")),
        ("1.runs_on", moved(SIMPLE, "dead_reckoning", "tail")),
        ("1.requires", moved(FLYING, "wind_filter", "nose")),
        ("1.device", moved(FLYING, "receiver", "mid")),
        ("2.input", wired(FLYING, "driver_1", {"0": DEMAND})),
        ("2.producer", without(SIMPLE, "dead_reckoning")),
        ("2.variable", wired(LOGGING, "logger", {"1": WIND})),
        ("2.gives", wired(LOGGING, "logger", {"1": Wire("wind_filter", "demand", 1)})),
        ("2.version", wired(FLYING, "control", {"0": Wire("receiver", "position", 2)})),
        (
            "2.accepts",
            wired(
                {**without(FLYING, "receiver"), "dead_reckoning": Running("nose", "only")},
                "control",
                {"0": Wire("dead_reckoning", "position", 2)},
            ),
        ),
        ("3.leaf", {**FLYING, "recorder": Running("mid", "only")}),
        ("3.and", without(wired(FLYING, "control", {"0": None}), "receiver")),
        ("3.or", without(wired(FLYING, "control", {"1.0": None}), "wind_filter")),
        ("3.xor", without(wired(SIMPLE, "control", {"1": None}), "dead_reckoning")),
        ("3.xor", wired({**SIMPLE, "receiver": Running("nose", "only")}, "control", {"0": POSITION})),
        ("3.below", wired(LOGGING, "logger", {"0.1": None})),
        ("4.branches", {**FLYING, "driver_2": Running("mid", "only", {"0": DEMAND})}),
        ("4.wired", {"driver_1": Running("tail", "only")}),
        ("4.wired", {"driver_2": Running("mid", "only")}),
        ("5.idle", {**FLYING, "dead_reckoning": Running("mid", "only")}),
        ("10.drivers", {**TRIMMING, "driver_1": Running("tail", "only", {"": DEMAND})}),
    ],
)
def test_one_fault_in_a_plan_is_one_violation(rule: str, modules: Modules) -> None:
    assert broken(modules) == [rule]


@pytest.mark.parametrize(
    ("rule", "down", "modules"),
    [
        ("1.pe_down", "pe:nose", FLYING),
        ("1.device_down", "device:gps", FLYING),
        ("1.failed", "module:receiver", FLYING),
        ("1.failed_there", "module:wind_filter@tail", FLYING),
    ],
)
def test_what_is_down_must_not_be_used(rule: str, down: str, modules: Modules) -> None:
    now = situation(glider(), [down])
    assert broken(modules, now) == [rule]
    assert broken(SIMPLE, now) == []


def test_behind_a_dead_bus_nothing_can_be_commanded_or_reached() -> None:
    far = moved(LOGGING, "recorder", "tail")
    far = {**SIMPLE, "logger": Running("mid", "only"), "recorder": far["recorder"]}
    one_channel = situation(glider(), ["channel:can1.1"])
    both_channels = situation(glider(), ["channel:can1.1", "channel:can1.2"])
    assert broken(far, one_channel) == []
    assert broken(far, both_channels) == ["1.cut_off", "2.route"]
    assert broken(moved(far, "recorder", "mid"), both_channels) == []


def test_two_modules_on_a_pe_that_is_cut_off_still_reach_each_other() -> None:
    both = moved(moved(LOGGING, "logger", "tail"), "recorder", "tail")
    both = {"logger": Running("tail", "only"), "recorder": both["recorder"]}
    assert broken(both, situation(glider(), ["bus:can1"])) == ["1.cut_off", "1.cut_off"]


def test_with_the_managers_bus_down_only_the_empty_plan_is_legal() -> None:
    now = situation(glider(), ["bus:can0"])
    assert broken({}, now) == []
    assert set(broken(SIMPLE, now)) == {"1.cut_off"}


def test_optional_inputs_may_all_be_missing() -> None:
    assert broken(wired(LOGGING, "logger", {"0.0": None, "0.1": None})) == []
    assert broken(wired(LOGGING, "logger", {"1": DEMAND})) == []


def test_what_a_phase_does_not_want_is_idle_unless_it_feeds_something_wanted() -> None:
    landing = situation(glider(), phase="landing")
    assert broken(FLYING, landing) == []
    assert broken(LOGGING, landing) == ["5.idle", "5.idle"]
    assert broken(FEEDBACK, landing) == []


def test_modules_that_feed_only_each_other_serve_nothing() -> None:
    assert broken(without(FEEDBACK, "driver_1")) == ["5.idle", "5.idle", "5.idle"]


def test_a_cycle_needs_an_initial_value() -> None:
    spec = glider()
    entry = replace(spec.variables["log_entry"], initial=None)
    bare = replace(spec, variables={**spec.variables, "log_entry": entry})
    assert broken(FEEDBACK, spec=bare) == ["6.cycle"]
    assert broken(LOGGING, spec=bare) == []


@pytest.mark.parametrize(("field", "used"), [("cpu_millis", 200), ("ram", 2048), ("flash", 1024)])
def test_a_pe_can_be_full_but_not_fuller(field: str, used: int) -> None:
    def with_mid(capacity: int) -> Spec:
        spec = glider()
        changes = {"cpu_millis": 400, "ram": 8192, "flash": 8192, field: capacity}
        mid = replace(spec.pes["mid"], **changes)  # type: ignore[arg-type]
        return replace(spec, pes={**spec.pes, "mid": mid})

    assert broken(FLYING, spec=with_mid(used)) == []
    assert broken(FLYING, spec=with_mid(used - 1)) == [f"7.{field.removesuffix('_millis')}"]


def test_a_shrunk_pe_is_rounded_down_to_a_thousandth() -> None:
    assert broken(FLYING, situation(glider(), limits=["pe:mid=50%"])) == []
    assert broken(FLYING, situation(glider(), limits=["pe:mid=49.9999%"])) == ["7.cpu"]


def test_a_bus_can_be_full_but_not_fuller() -> None:
    def with_room(bits_per_s: Fraction) -> Spec:
        spec = glider()
        bus = spec.buses["can1"]
        return replace(
            spec, buses={**spec.buses, "can1": replace(bus, max_load=bus.reserve + bits_per_s / bus.bitrate)}
        )

    demand_and_wind = Fraction(50 * 135 + 10 * 135)
    assert broken(FLYING, spec=with_room(demand_and_wind)) == []
    assert broken(FLYING, spec=with_room(demand_and_wind - Fraction(1, 10**9))) == ["7.bus"]


def test_a_shrunk_bus_is_not_rounded() -> None:
    # Of 125 000 bit/s 70 % are for data, and 8 100 bit/s are used: 9.257142... %.
    assert broken(FLYING, situation(glider(), limits=["bus:can1=9.2572%"])) == []
    assert broken(FLYING, situation(glider(), limits=["bus:can1=9.2571%"])) == ["7.bus"]


def test_modules_kept_apart() -> None:
    spec = replace(glider(), separate=(("control", "driver_1", "logger"),))
    assert broken(FLYING, spec=spec) == []
    assert broken(moved(FLYING, "control", "tail"), spec=spec) == ["8.separate"]


def test_modules_kept_together() -> None:
    spec = replace(glider(), together=(("logger", "wind_filter", "control"),))
    assert broken(FLYING, spec=spec) == ["8.together"]
    assert broken(moved(FLYING, "control", "tail"), spec=spec) == []


def test_a_datum_can_arrive_at_its_deadline_but_not_later() -> None:
    def with_deadline(deadline_ns: int) -> Spec:
        spec = glider()
        demand = replace(spec.variables["demand"], deadline_ns=deadline_ns)
        return replace(spec, variables={**spec.variables, "demand": demand})

    # On can1, before the demand: a frame that has just started, two PEs, LEASE and ALIVE; then itself.
    longest_ns = 6 * 135 * 8_000
    assert broken(FLYING, spec=with_deadline(longest_ns)) == []
    assert broken(FLYING, spec=with_deadline(longest_ns - 1)) == ["9.deadline"]


def test_the_order_of_a_plan_does_not_matter() -> None:
    bad = {**moved(FLYING, "control", "nowhere"), "ghost": Running("x", "y"), "recorder": Running("mid", "only")}
    backwards = {name: replace(r, inputs=dict(reversed([*r.inputs.items()]))) for name, r in reversed(bad.items())}
    spec = glider()
    found = verify(spec, situation(spec), Configuration(bad))
    assert found == verify(spec, situation(spec), Configuration(backwards))
    assert [violation.rule for violation in found] == ["1.module", "1.pe", "3.leaf"]


def test_a_violation_as_a_person_reads_it() -> None:
    spec = glider()
    (violation,) = verify(spec, situation(spec, ["module:receiver"]), Configuration(FLYING))
    assert str(violation) == "rule 1.failed, module receiver: the module has failed and must not run"


places, modes, leaves = ("ghost", "nose", "mid", "tail"), ("only", "full", "simple"), ("", "0", "1.0")
words = st.sampled_from([*places, *modes, *leaves, *LOGGING, "position", "wind", "demand"])
wires = st.builds(Wire, words, words, st.integers(-1, 9))
plans = st.dictionaries(words, st.builds(Running, words, words, st.dictionaries(words, wires, max_size=3)), max_size=8)


@given(plans)
def test_whatever_a_plan_says_the_verifier_answers_in_sentences(modules: Modules) -> None:
    spec = glider()
    for violation in verify(spec, situation(spec), Configuration(modules)):
        assert violation.where
        assert "\n" not in violation.sentence


@given(st.randoms(use_true_random=False))
def test_the_order_of_a_random_plan_does_not_matter(rng: random.Random) -> None:
    modules = {**LOGGING, "driver_2": Running("mid", "only"), "ghost": Running("x", "y")}
    names = rng.sample(list(modules), len(modules))
    spec, now = glider(), situation(glider(), ["bus:can1"])
    shuffled = Configuration({name: modules[name] for name in names})
    assert verify(spec, now, shuffled) == verify(spec, now, Configuration(modules))


def test_a_branch_is_wired_to_an_expression_in_front_of_its_demux() -> None:
    spec = loads(GLIDER.replace("{demux: demand}", "{demux: {and: [demand, {xor: [wind, log_entry]}]}}"), "x.dg.yaml")
    wiring = {"0": DEMAND, "1.0": WIND}
    flying = {**FLYING, "driver_1": Running("tail", "only", wiring)}
    assert broken(flying, spec=spec) == []
    assert broken({**SIMPLE, "driver_2": Running("mid", "only")}, spec=spec) == ["4.wired", "5.idle", "5.idle"]
    assert broken({"driver_1": Running("tail", "only")}, spec=spec) == ["4.wired"]
    assert broken({**flying, "driver_1": Running("tail", "only", {"0": DEMAND})}, spec=spec) == ["3.xor"]
    assert broken(wired(flying, "driver_1", {"0": None}), spec=spec) == ["3.and", "5.idle", "5.idle"]


def test_two_ends_of_a_demux_do_not_run_at_once() -> None:
    spec = load(Path("dg_specs/examples/demux_paths.dg.yaml"))
    contrast, angle = Wire("horizon_driver", "horizon_contrast", 1), Wire("horizon_attitude", "pitch_angle", 1)
    demand, limited = Wire("elevator_control", "elevator_demand", 1), Wire("elevator_limiter_1", "servo_demand_1", 1)
    path = {
        "horizon_driver": Running("flight", "only"),
        "horizon_attitude": Running("flight", "only", {"": contrast}),
        "elevator_control": Running("flight", "only", {"": angle}),
        "elevator_limiter_1": Running("flight", "only", {"": demand}),
        "limited_servo_1": Running("tail_a", "only", {"": limited}),
    }
    assert verify(spec, situation(spec), Configuration(path)) == []
    stray = {**path, "limited_servo_3": Running("tail_c", "only")}
    violations = verify(spec, situation(spec), Configuration(stray))
    assert [violation.rule for violation in violations] == ["3.leaf", "4.ends"]
    assert violations[1].sentence == "limited_servo_1 and limited_servo_3 run, but only one of these ends may run"
    idle = {name: running for name, running in path.items() if name != "limited_servo_1"}
    assert {v.rule for v in verify(spec, situation(spec), Configuration(idle))} == {"5.idle"}
