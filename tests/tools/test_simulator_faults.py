"""Faults of nodes: what a pause, a hung module or a clock that jumps does, and that it ends when it should."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_tools.console.errors import UserError
from heronry_tools.sim.faults.drawing import drawn_faults
from heronry_tools.sim.faults.fault import KINDS, LEVELS, Fault, possible_targets, read_fault
from heronry_tools.sim.faults.protocol_state import STATES, ProtocolState
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.outcome import Outcome, Scenario, play
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.steps_seen import Driven
from scenarios.flights import MS, big_blue, elevator_and_chute, flying, kept_state, twin_wires, two_tails
from thoroughness import part_of

Written = tuple[Callable[[], Spec], str, int | None]


def injected(simulation: Simulation, *texts: str) -> Injections:
    """Inject faults into a flight from now on."""
    faults = tuple(read_fault(simulation.spec, text) for text in texts)
    return Injections(simulation, faults, simulation.now_ns)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_fault_is_injected_ends_and_leaves_an_aircraft_that_recovers(kind: str) -> None:
    specs = {"phase": big_blue, "kept_place": kept_state}
    specs |= dict.fromkeys(("gateway", "far_bus", "channel", "twin_pe"), twin_wires)
    spec = specs.get(KINDS[kind].target_kind, two_tails)()
    target = possible_targets(spec, kind)[-1]
    lasts = f" for {min(KINDS[kind].lasts_ms[1], 400) / 1000:g}" if KINDS[kind].lasts_ms[1] else ""
    level = f" level {KINDS[kind].levels[-1]}" if KINDS[kind].levels != (0,) else ""
    fault = read_fault(spec, f"0.1 {kind} {target}{lasts}{level}")
    latched = (read_fault(spec, "0.05 raise module:servo_driver_1 for 0.2"),) if kind == "order_clear" else ()
    outcome = play(spec, Scenario(1, 1.0, (*latched, replace(fault, at_ms=500) if latched else fault)))
    assert outcome.violations == ()
    assert sum(count for (injected_by, _), count in outcome.hits.items() if injected_by == kind) == 1


def test_a_fault_reads_as_it_writes() -> None:
    for seed in range(20):
        for fault in drawn_faults(big_blue(), seed, 30.0):
            assert read_fault(big_blue(), str(fault)) == fault


@st.composite
def texts(draw: st.DrawFn) -> Written:
    """A fault of any kind as a user may write it, with its spec and its level."""
    kind, spec = draw(st.sampled_from([(kind, spec) for kind in KINDS for spec in (big_blue, twin_wires)]))
    targets = possible_targets(spec(), kind)
    assume(targets)
    times = st.integers(0, 999_999_999).map(lambda ms: f"{ms / 1000:.3f}")
    words = [draw(times), kind, draw(st.sampled_from(targets))]
    words += ["for", draw(times)] if draw(st.booleans()) else []
    words += ["in", draw(st.sampled_from(STATES))] if draw(st.booleans()) else []
    level = draw(st.none() | st.integers(0, 999_999_999) | st.integers(*LEVELS.get(kind, (0, 0))))
    words += [] if level is None else ["level", str(level)]
    return spec, " ".join(words), level


@given(texts())
@settings(max_examples=part_of(400))
def test_a_fault_of_any_kind_is_refused_or_reads_as_it_writes(written: Written) -> None:
    make, text, level = written
    spec = make()
    kind = text.split()[1]
    lowest, highest = LEVELS.get(kind, (0, 0))
    if level is not None and not lowest <= level <= highest:
        with pytest.raises(UserError, match="has a level from" if highest else "has no level; leave it out"):
            read_fault(spec, text)
        return
    fault = read_fault(spec, text)
    assert fault.level == (KINDS[kind].levels[0] if level is None else level)
    assert read_fault(spec, str(fault)) == fault


def test_levels_that_are_drawn_can_be_written() -> None:
    for name, kind in KINDS.items():
        lowest, highest = LEVELS.get(name, (0, 0))
        assert all(lowest <= level <= highest for level in kind.levels), name


@pytest.mark.parametrize("fault", ["babble bus:can0 for 0.1 level 0", "babble bus:can0 for 0.1 level 2047"])
def test_a_foreign_node_may_have_any_identifier(fault: str) -> None:
    assert play(two_tails(), Scenario(1, 0.5, (read_fault(two_tails(), f"0.1 {fault}"),))).violations == ()


def test_a_fault_late_in_a_long_flight_keeps_its_milliseconds() -> None:
    fault = read_fault(big_blue(), "12345.678 pause pe:nav for 1234.567")
    assert str(fault) == "12345.678 pause pe:nav for 1234.567"


def test_a_seed_draws_its_kinds_first_or_only_the_kind_that_was_given() -> None:
    swarms = [{fault.kind for fault in drawn_faults(big_blue(), seed, 60.0)} for seed in range(10)]
    assert len(set(map(frozenset, swarms))) == 10
    assert all(len(swarm) < len(KINDS) for swarm in swarms)
    pauses = drawn_faults(big_blue(), 1, 60.0, ["pause"])
    assert {fault.kind for fault in pauses} <= {"pause", "crash", "cut", "reboot", "manager_crash", "manager_pause"}
    assert "forge" not in set().union(*swarms)


def test_a_kind_that_is_drawn_apart_leaves_the_other_faults_of_a_seed_as_they_are() -> None:
    modules = {name: replace(module, checkpoint=None) for name, module in kept_state().modules.items()}
    spec = replace(kept_state(), modules=modules)
    has_one = []
    for seed in range(40):
        others, drawn = (set(drawn_faults(one, seed, 20.0, of_two=True)) for one in (spec, kept_state()))
        assert others <= drawn
        assert "other_code" not in {fault.kind for fault in others}
        has_one.append("other_code" in {fault.kind for fault in drawn})
        assert has_one[-1] or others == drawn
    assert 10 < sum(has_one) < 30
    assert "other_code" in {fault.kind for fault in drawn_faults(kept_state(), 1, 20.0, ["other_code"])}


def test_the_same_faults_give_the_same_flight_and_one_fault_less_leaves_the_others_as_they_are() -> None:
    faults = tuple(
        read_fault(two_tails(), text) for text in ("0.1 loss bus:can0 for 0.2 level 100", "0.5 slow pe:tail_pe for 0.2")
    )

    def digest(*some: Fault) -> Outcome:
        return play(two_tails(), Scenario(3, 1.0, some))

    assert digest(*faults).digest == digest(*faults).digest
    assert digest(*faults).digest != digest(faults[1]).digest


def test_a_core_that_dies_of_something_is_a_violation_and_no_end_of_the_campaign(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def dies(_core: ManagerCore) -> None:
        raise ValueError("of an empty sequence")

    monkeypatch.setattr(ManagerCore, "validate", dies)
    (violation,) = play(two_tails(), Scenario(0, 1.0, ())).violations
    assert (violation.rule, violation.story) == ("invariant", "ValueError: of an empty sequence")


def test_a_paused_pe_is_silent_but_for_its_mailbox_and_catches_up_with_what_it_missed() -> None:
    simulation = flying(two_tails(), keep_trace=True)
    begun_ns = simulation.now_ns
    injected(simulation, "0 pause pe:tail_pe for 0.2")
    simulation.run_for(190 * MS)
    said = [sent for sent in simulation.trace if sent.sender == "tail_pe" and sent.end_ns > begun_ns]
    assert len(said) <= 1
    assert simulation.settle() == []
    assert "silent for 3 heartbeat periods" in simulation.events_of(events.PeLost)[-1].cause


def test_a_pause_within_a_longer_one_changes_nothing() -> None:
    simulation = flying(two_tails())
    injected(simulation, "0 pause pe:tail_pe for 0.2", "0.05 pause pe:tail_pe for 0.01")
    simulation.run_for(150 * MS)
    assert not simulation.fleet.running["tail_pe"].is_awake
    simulation.run_for(60 * MS)
    assert simulation.fleet.running["tail_pe"].is_awake


def test_a_step_that_has_waited_for_longer_than_t_lease_is_not_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Driven] = []
    monkeypatch.setattr(Checks, "driven", lambda _, driven: told.append(driven))
    simulation = flying(elevator_and_chute())
    injected(simulation, "0 slow pe:tail_pe for 2")
    simulation.run_for(500 * MS)
    while simulation.fleet.running["tail_pe"].is_awake:  # until a step takes its time, with another one behind it
        simulation.run_for(MS)
    simulation.fleet.running["tail_pe"].pause(150 * MS)
    simulation.run_for(500 * MS)
    waited_ns = [driven.t_ns - driven.asked_ns for driven in told]
    assert 0 < max(waited_ns) < 100 * MS


def test_modules_that_hang_are_silent_while_the_heartbeat_goes_on() -> None:
    simulation = flying(elevator_and_chute())
    injected(simulation, "0 stuck pe:tail_pe for 1.5")
    simulation.run_for(1_000 * MS)
    assert not simulation.witness.served("elevator", simulation.now_ns)
    assert simulation.events_of(events.PeLost) == []
    assert simulation.settle() == []


def test_a_manager_that_stands_still_fails_no_pe_for_its_own_pause() -> None:
    simulation = flying(big_blue())
    injected(simulation, "0 manager_pause manager for 0.5")
    assert simulation.settle() == []
    assert simulation.events_of(events.PeLost) == []
    assert simulation.witness.outages(simulation.now_ns) == []


def test_a_clock_is_fast_or_slow_and_jumps() -> None:
    clock = Clock()
    fast, slow = LocalClock(clock, 1_000, 500), LocalClock(clock, 0, -500)
    clock.run_until(10_000_000)
    assert (fast.now_ns(), slow.now_ns()) == (10_006_000, 9_995_000)
    for local in (fast, slow):
        due_ns = local.now_ns() + 12_345
        clock.run_until(local.when_ns(due_ns) - 1)
        assert local.now_ns() < due_ns
        clock.run_until(clock.now_ns + 1)
        assert local.now_ns() >= due_ns
    fast.jump(50)
    assert fast.now_ns() - clock.now_ns > 6_050 - 50


def test_a_fault_waits_for_its_state_and_for_no_longer_than_three_seconds() -> None:
    simulation = flying(two_tails())
    injections = injected(
        simulation, "0 pause pe:control_pe for 0.01 in planning", "0 doubled bus:can0 for 0.1 in preparing level 1"
    )
    simulation.run_for(1_000 * MS)
    assert sum(injections.hits.values()) == 0
    simulation.fleet.kill("sensor_pe")
    simulation.run_for(1_500 * MS)
    assert injections.hits == {("pause", "planning"): 1, ("doubled", "preparing"): 1}
    late = injected(simulation, "0 pause pe:control_pe for 0.01 in activating")
    simulation.run_for(3_000 * MS)
    assert late.hits == {("pause", "idle"): 1}


def test_a_fault_that_comes_too_late_for_its_state_waits_for_the_next_time() -> None:
    simulation = flying(two_tails(), 1)
    injections = injected(
        simulation, "0 doubled bus:can0 for 0.1 in going level 10"
    )  # 2 ms after the first one has begun
    simulation.fleet.kill("sensor_pe")
    simulation.run_for(500 * MS)
    assert (simulation.managers.protocol.entered["going"], sum(injections.hits.values())) == (2, 0)
    simulation.fleet.restore("sensor_pe")
    simulation.run_for(1_000 * MS)
    assert injections.hits == {("doubled", "going"): 1}


def test_a_dead_pe_is_no_target_and_nothing_is_injected_after_the_end() -> None:
    simulation = flying(two_tails())
    injections = injected(simulation, "0 crash pe:tail_pe", "0.1 pause pe:tail_pe for 0.1", "0.5 crash pe:sensor_pe")
    simulation.run_for(200 * MS)
    injections.heal()
    simulation.run_for(500 * MS)
    assert injections.hits == {("crash", "idle"): 1}
    assert set(simulation.fleet.running) == {"sensor_pe", "control_pe"}


REQUESTED = events.PlanRequested(1, 1, (), {}, None, ("first",))


def test_the_state_of_the_protocol_follows_the_managers_events() -> None:
    clock = Clock()
    protocol, seen = ProtocolState(clock), []
    for event in (
        events.PeSuspected(1, "a", "silent", 2),
        REQUESTED,
        events.EpochPrepared(1, 1, "00A1B2", 0, ("a",), 9),
        events.EpochStep(1, 1, "BREAK", ()),
        events.EpochStep(1, 1, "GO_ALL", ()),
        events.Reconfigured(1, 1, ("a",), events.Times(1, 1, 1, 1), (), (), ()),
        events.PeLost(1, "a", "silent", 1),
        events.PeHeardAgain(1, "a", "heard"),
    ):
        protocol.take(event)
        seen.append(protocol.now)
    assert seen == ["suspect", "planning", "preparing", "activating", "going", "suspect", "idle", "rejoining"]
    assert {*seen, "orphaned"} == set(STATES)
    clock.run_until(3_000 * MS)
    assert protocol.now == "idle"
    protocol.take(REQUESTED)
    protocol.take(events.ManagerStarted(1, "s", "ab", 126, 1, "can0", None, advises=False, key=None))
    assert protocol.now == "idle"


def test_a_surface_that_no_branch_drives_excuses_a_report_of_its_sensor() -> None:
    simulation = flying(elevator_and_chute())
    injected(simulation, "0.1 raise module:servo_driver_1 for 0.2", "0.5 overrun module:servo_driver_2 for 0.2")
    simulation.run_for(200 * MS)
    assert simulation.truth.excusable == {"module:servo_driver_1", "device:elevator_servo_1"}
    simulation.run_for(600 * MS)
    assert "device:elevator_angle_sensor" in simulation.truth.excusable
    assert "device:barometer" not in simulation.truth.excusable
