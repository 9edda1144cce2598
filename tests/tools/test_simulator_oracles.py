"""The oracles of a flight without injected faults: each gets a flight with one violation, and must find it."""

from pathlib import Path
from typing import Any

import pytest

from heronry_agent.core.modules import RunningModules, mailboxes
from heronry_agent.core.vocabulary import Drive
from heronry_agent.module import Value
from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_dg.traffic import identifiers
from heronry_manager.core.authentication import attack_rate
from heronry_manager.core.situation import radio_links
from heronry_manager.core.situation.known_situation import KnownSituation
from heronry_manager.core.vocabulary import ClearElement, EnterPhase, FailElement
from heronry_tools.recording.commanded import Epoch
from heronry_tools.runtime.witness import Outage
from heronry_tools.sim.faults.fault import read_fault
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.outcome import Scenario, play
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles import limits as promised
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.oracles.exclusion import ExclusionCheck
from heronry_tools.sim.oracles.liveness import Losses
from heronry_tools.sim.oracles.oracle import StateSaid
from heronry_tools.sim.oracles.phase import PhaseCheck
from heronry_tools.sim.oracles.queues import QueueCheck
from heronry_tools.sim.oracles.service import Injected, ServiceCheck
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.oracles.waivers import Waivers
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.steps_seen import Moved
from heronry_tools.sim.world.stranger import Stranger
from heronry_wire import protocol_times
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, emcy_id, management_id, state_id
from heronry_wire.management import (
    FORWARD_ONLY,
    Alive,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Lease,
    Operation,
    Step,
)
from heronry_wire.protocol_times import HOLD_DOWN_PERIODS, LEASE_PERIODS, LONGEST_HOLD_DOWN_NS
from heronry_wire.state_frames import PeFlags, PeState, StatePage0
from lab.peers import command_frame
from scenarios.flights import KEY, MS, big_blue, elevator_and_chute, flying, two_tails

FAIL_OVER = Path(__file__).parents[2] / "dg_specs/examples/fail_over.dg.yaml"
PES = frozenset(elevator_and_chute().pes)
S = 1000 * MS
TAIL = 94
WELL = Situation()
UNSENT = Sent(0, "can0", "", Frame(0, b""))


def started(node: int, incarnation: int) -> StateSaid:
    """The state that a PE reports when it has just started."""
    return StateSaid(0, "can0", node, "", StatePage0(PeState.UNCONFIGURED, PeFlags(0), incarnation, 0, 0, 0))


def rules(simulation: Simulation) -> list[tuple[str, str]]:
    return [(violation.rule, violation.story) for violation in simulation.broken()]


# No PE publishes what its epoch does not give it


def datum(simulation: Simulation, variable: str, sender: str) -> Sent:
    """A data frame of the first producer of a variable, as if this PE had sent it."""
    producer = next(simulation.spec.producers(variable))[0].name
    frame = Frame(
        identifiers(simulation.spec)[producer, variable], bytes((simulation.spec.pes[sender].node_id, *b"abcdefg"))
    )
    return Sent(simulation.now_ns, "can0", sender, frame)


def test_what_no_epoch_asks_for_is_not_sent() -> None:
    simulation = flying(two_tails())
    simulation.checks.see(datum(simulation, "state_info", "tail_pe"))
    ((rule, story),) = rules(simulation)
    assert rule == "publishing"
    assert story.startswith("tail_pe sends 1")
    assert "not required by epoch 1" in story


def test_a_restarted_pe_sends_nothing_until_an_epoch_asks_for_it() -> None:
    simulation = flying(two_tails())
    asked = next(name for name in ("sensor_pe", "control_pe", "tail_pe") if publishes(simulation, name))
    (frame, *_) = publishes(simulation, asked)
    simulation.checks.see(Sent(simulation.now_ns, "can0", asked, frame))
    assert rules(simulation) == []
    anew = StatePage0(PeState.UNCONFIGURED, PeFlags(0), 77, 0, 0, 0)
    node = simulation.spec.pes[asked].node_id
    simulation.checks.see(Sent(simulation.now_ns, "can0", asked, Frame(state_id(node), anew.encode())))
    simulation.checks.see(Sent(simulation.now_ns, "can0", asked, frame))
    assert [rule for rule, _ in rules(simulation)] == ["publishing"]


def publishes(simulation: Simulation, pe: str) -> list[Frame]:
    """Data frames that a PE sends within a tenth of a second."""
    heard: list[Frame] = []
    data = set(simulation.fleet.data_identifiers)

    def tap(sent: Sent) -> None:
        if sent.sender == pe and sent.frame.can_id in data:
            heard.append(sent.frame)

    simulation.wiring.buses["can0"].taps.append(tap)
    simulation.run_for(100 * MS)
    simulation.wiring.buses["can0"].taps.remove(tap)
    return heard


# Once all is well the buses carry what was planned


def test_more_frames_than_planned_are_seen_and_as_many_as_planned_are_not() -> None:
    simulation = flying(two_tails())
    simulation.checks.is_well(simulation.now_ns)
    simulation.run_for(2 * S)
    assert simulation.checks.unplanned(simulation.now_ns, simulation.truth.situation) == []
    pe = next(name for name in ("sensor_pe", "control_pe", "tail_pe") if publishes(simulation, name))
    (frame, *_) = publishes(simulation, pe)
    for _ in range(300):
        simulation.checks.see(Sent(simulation.now_ns, "can0", pe, frame))
    (violation,) = simulation.checks.unplanned(simulation.now_ns, simulation.truth.situation)
    assert violation.rule == "planned_load"


def test_nothing_is_planned_before_a_command_or_before_any_pe_is_well() -> None:
    checks = Checks(two_tails())
    checks.see(Sent(0, "can0", "tail_pe", Frame(1536, bytes(8))))
    assert checks.unplanned(S, Situation()) == []
    checks.is_well(S)
    assert checks.unplanned(2 * S, Situation()) == []


# Every queue runs dry


def test_a_bus_that_never_falls_idle_has_not_emptied_its_queues() -> None:
    simulation = flying(two_tails())
    queues = QueueCheck(simulation.now_ns, simulation.wiring.buses)
    simulation.run_for(100 * MS)
    assert queues.look(simulation.now_ns, simulation.wiring.buses) == []
    strangers = [
        Stranger(simulation.clock, simulation.wiring.buses["can0"], Frame(can_id, bytes(8))) for can_id in (1, 2)
    ]
    simulation.run_for(100 * MS)
    (violation,) = queues.look(simulation.now_ns, simulation.wiring.buses)
    assert violation.rule == "queues"
    assert "frames wait on can0" in violation.story
    for stranger in strangers:
        stranger.leave()
    simulation.run_for(100 * MS)
    queues.look(simulation.now_ns, simulation.wiring.buses)
    simulation.run_for(100 * MS)
    assert queues.look(simulation.now_ns, simulation.wiring.buses) == []


def test_a_frame_that_its_sender_holds_back_for_ever_is_seen() -> None:
    simulation = flying(two_tails())
    queues = QueueCheck(simulation.now_ns, simulation.wiring.buses)
    bus, held = simulation.wiring.buses["can0"], simulation.fleet.running["tail_pe"].stations[0][1]
    bus.stand_back(held, simulation.now_ns + 10 * S)
    bus.offer(held, Frame(1999, b""))
    for _ in range(2):
        simulation.run_for(100 * MS)
        assert queues.look(simulation.now_ns, simulation.wiring.buses) == []
    simulation.run_for(100 * MS)
    (violation,) = queues.look(simulation.now_ns, simulation.wiring.buses)
    assert violation.story == "1999 of tail_pe has waited on can0 for over 100 ms"


# All is well within a bound


def alive(losses: Losses, t_ns: int, *pes: str, term: int = 1) -> None:
    spec = elevator_and_chute()
    losses.alive(t_ns, Alive(term, 0, frozenset(spec.pes[pe].node_id for pe in pes)))


def held_down_ns(losses: Losses) -> int:
    """What the bound allows for the way back, beyond the shortest."""
    return losses.bound_ns() - Losses(elevator_and_chute()).bound_ns()


def test_the_bound_doubles_with_every_loss_of_a_pe_up_to_a_minute_and_forgets_what_is_forgiven() -> None:
    losses, period_ns = Losses(elevator_and_chute()), 20 * MS
    shortest_ns = HOLD_DOWN_PERIODS * period_ns
    for times in range(1, 12):
        alive(losses, times * S, *PES)
        assert held_down_ns(losses) == min(shortest_ns << (times - 1), LONGEST_HOLD_DOWN_NS) - shortest_ns
        alive(losses, times * S + 1, *PES - {"tail_pe"})
    assert losses.available == PES - {"tail_pe"}
    alive(losses, 20 * S, *PES)
    alive(losses, 80 * S, *PES - {"tail_pe"})
    assert held_down_ns(losses) == shortest_ns


def test_a_mastership_may_end_with_a_loss_that_it_did_not_tell_and_a_deposed_one_is_not_heard() -> None:
    losses, shortest_ns = Losses(elevator_and_chute()), HOLD_DOWN_PERIODS * 20 * MS
    alive(losses, 1, *PES)
    alive(losses, 2)
    assert held_down_ns(losses) == shortest_ns
    alive(losses, 3, "tail_pe", term=2)
    alive(losses, 4, "tail_pe", term=3)  # the one before may have fallen silent, since it heard it no more
    assert held_down_ns(losses) == 3 * shortest_ns
    alive(losses, 5, term=4)
    alive(losses, 6, "tail_pe", term=5)
    assert held_down_ns(losses) == 7 * shortest_ns
    alive(losses, 7, term=1)
    assert losses.available == {"tail_pe"}


def test_the_manager_that_sends_is_active_once_a_higher_term_has_fallen_silent() -> None:
    losses, lease_ns = Losses(elevator_and_chute()), LEASE_PERIODS * 20 * MS
    alive(losses, 1, *PES, term=5)  # in a part of the aircraft that had been cut off
    alive(losses, 1 + lease_ns, "tail_pe", term=2)
    assert losses.available == PES
    alive(losses, 2 + lease_ns, "tail_pe", term=2)
    assert losses.available == {"tail_pe"}


def test_what_does_not_come_right_within_the_bound_is_a_violation() -> None:
    simulation = flying(two_tails())
    simulation.fleet.running["tail_pe"].wire(transmit_failed=True)  # for good, and unknown to the oracles
    bound_ns = simulation.checks.liveness_bound_ns()
    begun_ns = simulation.now_ns
    assert "tail_pe is healthy, but sends no state" in [violation.story for violation in simulation.settle()]
    assert bound_ns <= simulation.now_ns - begun_ns < bound_ns + 200 * MS


# Nothing critical is silent without need


def assessed(check: ServiceCheck, *injected: Injected, function: str = "elevator", lasts_ns: int = 5 * S) -> list[str]:
    """What the oracle says of a function that is silent from the tenth second on."""
    outage = Outage(function, 10 * S, 10 * S + lasts_ns)
    return [violation.story for violation in check.silences([outage], injected, 30 * S)]


@pytest.fixture
def service() -> ServiceCheck:
    check = ServiceCheck(two_tails())
    check.alive(S, PES)
    return check


def test_a_critical_function_that_is_silent_for_long_for_no_reason_is_seen(service: ServiceCheck) -> None:
    (story,) = assessed(service)
    assert story == "elevator was silent for 5000 ms without a new fault, but a plan without [] serves it"
    assert assessed(service, lasts_ns=service.longest_ns) == []
    lasting = Outage("elevator", 10 * S, None)
    assert len(service.silences([lasting], (), 30 * S)) == 1


def epoch_for_nothing(spec: Spec, prepared_ns: int, contingency: int = 0, *, is_adopted: bool = False) -> Epoch:
    """An epoch that every PE has staged, and that serves nothing."""
    epoch = Epoch(2, 0, prepared_ns, 1, contingency=contingency, configuration=Configuration(), is_adopted=is_adopted)
    epoch.staged.update(pe.node_id for pe in spec.pes.values())
    return epoch


def beats(check: ServiceCheck, pes: frozenset[str], period_ns: int = 20 * MS) -> None:
    """ALIVE has come in every period, until just before 5 s."""
    for before in range(3, 0, -1):
        check.alive(5 * S - before * period_ns + MS, pes)


def called(service: ServiceCheck, alive_ns: int, pes: frozenset[str], *, begins_mastership: bool = False) -> list[str]:
    """What the oracle says of an epoch that serves nothing, called by number at 5 s, at the next ALIVE."""
    beats(service, PES)
    service.activated(5 * S + MS, epoch_for_nothing(two_tails(), 5 * S, contingency=3))
    assert service.violations == []
    if begins_mastership:
        service.began(alive_ns)
    service.alive(alive_ns, pes)
    return [violation.story for violation in service.violations]


def test_a_pe_that_stages_what_is_called_by_its_number_takes_part_if_it_is_available(service: ServiceCheck) -> None:
    assert "by criticality, but a plan serves (100, 80, 0, 20) without []" in called(service, 5 * S + 15 * MS, PES)[0]


def test_a_pe_that_is_not_available_takes_no_part_even_if_that_is_told_later(service: ServiceCheck) -> None:
    assert called(service, 5 * S + 15 * MS, frozenset()) == []


def test_the_pes_that_took_part_are_not_known_where_the_manager_dies_first(service: ServiceCheck) -> None:
    assert called(service, 5 * S + 15 * MS, PES, begins_mastership=True) == []
    assert called(service, 6 * S, PES) == []


@pytest.mark.parametrize(
    ("beats_ms", "is_known"), [((-49, -29, -9), True), ((-39, -4), False), ((-74, -54, -34), False)]
)
def test_the_pes_that_took_part_are_not_known_where_the_managers_frames_have_waited(
    service: ServiceCheck, beats_ms: tuple[int, ...], *, is_known: bool
) -> None:
    for beat_ms in beats_ms:
        service.alive(5 * S + beat_ms * MS, PES)
    service.activated(5 * S + MS, epoch_for_nothing(two_tails(), 5 * S, contingency=3))
    service.alive(5 * S + 11 * MS, PES)
    assert bool(service.violations) is is_known


def test_a_manager_that_adopts_what_runs_drops_nothing_by_that(service: ServiceCheck) -> None:
    service.alive(4 * S, PES)
    for is_adopted in (True, False):
        service.activated(5 * S + MS, epoch_for_nothing(two_tails(), 5 * S, is_adopted=is_adopted))
        assert bool(service.violations) is not is_adopted


def test_a_pe_that_may_have_been_away_between_two_alives_of_a_slow_manager_need_not_have_taken_part() -> None:
    spec = load(Path(__file__).parent.parent / "scenarios" / "fast_far_bus.dg.yaml")  # ALIVE every 220 ms, f1 every 20
    for alive_ns, is_known in ((5 * S + 100 * MS, True), (5 * S + 210 * MS, False)):
        service = ServiceCheck(spec)
        beats(service, frozenset(spec.pes), spec.buses[spec.manager.bus].heartbeat_ns)
        service.activated(5 * S + MS, epoch_for_nothing(spec, 5 * S, contingency=3))
        service.alive(alive_ns, frozenset(spec.pes))
        assert bool(service.violations) is is_known


def test_a_function_may_be_silent_where_no_plan_serves_it_or_no_node_can_tell(service: ServiceCheck) -> None:
    assert assessed(service, Injected("pe:control_pe", 9 * S, None), Injected("pe:tail_pe", 9 * S, 16 * S)) == []
    assert assessed(service, Injected(None, 9 * S, 16 * S)) == []
    (story,) = assessed(service, Injected("pe:tail_pe", 9 * S, None), Injected("pe:control_pe", 5 * S, 6 * S))
    assert "a plan without ['pe:tail_pe'] serves it" in story


def test_a_mastership_that_begins_where_no_pe_runs_anything_may_wait_for_its_start_up_window(
    service: ServiceCheck,
) -> None:
    service.ran(10 * S)
    service.began(11 * S)
    service.ran(16 * S)
    assert assessed(service, lasts_ns=7 * S) == []
    (story,) = assessed(service, lasts_ns=8 * S)  # of these two seconds after the window
    assert "silent for 2000 ms" in story


def test_where_a_pe_flies_a_new_mastership_is_no_excuse(service: ServiceCheck) -> None:
    service.began(10 * S)
    for tick in range(1, 600):
        service.ran(tick * 50 * MS)
    assert len(assessed(service)) == 1


def test_time_begins_anew_with_whatever_happens_meanwhile(service: ServiceCheck) -> None:
    steps = [Injected("pe:tail_pe", (9 + i) * S, (10 + i) * S) for i in range(6)]
    assert assessed(service, *steps) == []


def test_a_pe_that_is_not_available_and_what_was_acknowledged_are_down(service: ServiceCheck) -> None:
    position = list(two_tails().modules).index("elevator_control")
    service.commanded(5 * S, "manager 126", Control(1, 94, Operation.ACKNOWLEDGE, ElementKind.MODULE, position))
    assert assessed(service) == []
    other = ServiceCheck(two_tails())
    other.alive(S, PES - {"tail_pe", "control_pe"})
    assert assessed(other) == []


def test_what_the_operator_has_failed_is_down_until_it_is_cleared(service: ServiceCheck) -> None:
    for later_ns in (0, MS):
        service.failed(9 * S + later_ns, "module:elevator_control")
    assert assessed(service) == []
    service.cleared(9 * S + 2 * MS, "pe:tail_pe", WELL, everywhere=True)
    assert assessed(service) == []
    service.cleared(9 * S + 3 * MS, "module:elevator_control", WELL, everywhere=True)
    assert len(assessed(service)) == 1


def test_what_a_pe_has_told_is_unknown_to_the_next_mastership_if_it_may_have_missed_a_word_since() -> None:
    missed_ns = {"tail_pe": 6 * S}
    service = ServiceCheck(two_tails(), lambda pe: missed_ns.get(pe, 0))
    for index, pe, t_ns in ((0, "tail_pe", 7 * S), (1, "tail_pe", 5 * S), (2, "control_pe", 5 * S)):
        service.emergency(UNSENT, pe, Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, index, 7))
        service.commanded(t_ns, "manager 126", Control(1, 94, Operation.ACKNOWLEDGE, ElementKind.DEVICE, index))
    first, second, third = (f"device:{device}" for device in list(two_tails().devices)[:3])
    assert service.held == {first, second, third}
    service.began(8 * S)
    assert service.held == {first, third}
    service.commanded(8 * S, "manager 126", Control(2, 94, Operation.ACKNOWLEDGE, ElementKind.DEVICE, 1))
    assert service.held == {first, second, third}


def epoch_of_nobody(service: ServiceCheck, prepared_ns: int, activated_ns: int) -> list[str]:
    """What the oracle says of an epoch that every PE stages, and that serves nothing."""
    service.activated(activated_ns, epoch_for_nothing(two_tails(), prepared_ns))
    return [violation.story for violation in service.violations]


def test_an_epoch_may_know_what_was_known_from_shortly_before_it_was_prepared(service: ServiceCheck) -> None:
    for pe in PES:
        service.failed(S, f"pe:{pe}")
        service.cleared(5 * S + MS, f"pe:{pe}", WELL, everywhere=True)
    assert epoch_of_nobody(service, 5 * S, 5 * S + 2 * MS) == []
    assert epoch_of_nobody(service, 5 * S + 5 * MS, 5 * S + 6 * MS) == []
    (story,) = epoch_of_nobody(service, 5 * S + 7 * MS, 5 * S + 8 * MS)
    assert story.startswith("epoch 2 serves (0, 0, 0, 0) by criticality, but a plan serves (")


def test_an_epoch_may_serve_the_phase_before_that_was_left_while_it_was_prepared() -> None:
    spec = big_blue()
    service = ServiceCheck(spec)
    for t_ns, phase in ((S, "glide"), (5 * S, "landing")):
        service.entered(t_ns, phase)
    assert service._phases_in(4 * S, 5 * S - 1) == ["glide"]
    assert service._phases_in(4 * S, 5 * S) == ["glide", "landing"]
    assert service._phases_in(0, S) == [spec.initial_phase(), "glide"]


def test_what_is_cleared_was_reported_rightly_and_is_well_until_it_is_reported_again() -> None:
    simulation = flying(two_tails())
    injected = (read_fault(simulation.spec, "0.01 raise module:servo_driver_1 for 0.5"),)
    Injections(simulation, injected, simulation.now_ns)
    simulation.run_for(400 * MS)
    assert "module:servo_driver_1" in simulation.truth.situation.down
    reply = simulation.operator.say(ClearElement("module:servo_driver_1"))
    assert reply is not None
    assert reply.done
    assert "module:servo_driver_1" not in simulation.truth.situation.down
    assert simulation.settle() == []


def test_a_module_that_has_failed_everywhere_is_down_until_it_is_cleared_itself() -> None:
    simulation = flying(load(FAIL_OVER))
    raises = tuple(read_fault(simulation.spec, f"0 raise module:chute_logic@{pe} for 9") for pe in ("right", "left"))
    injections = Injections(simulation, raises, simulation.now_ns)
    simulation.run_for(600 * MS)
    assert simulation.operator.latched() == ["module:chute_logic", "module:chute_logic@right"]
    for pe in ("right", "left"):  # the manager clears the first place, and refuses the second: it is not latched
        simulation.operator.clear(f"module:chute_logic@{pe}")
        assert "module:chute_logic" in simulation.truth.situation.down
    simulation.run_for(600 * MS)
    assert simulation.unsettled() == []
    injections.heal()
    simulation.operator.clear("module:chute_logic")
    assert simulation.truth.situation.down == frozenset()
    simulation.run_for(600 * MS)
    assert simulation.unsettled() == []


def test_what_the_operator_says_is_the_truth_and_is_repeated_to_a_manager_that_may_not_know() -> None:
    simulation = Simulation(two_tails(), standby=True)
    simulation.run_for(2 * S)
    assert simulation.operator.say(FailElement("pe:tail_pe")) is not None
    assert simulation.operator.failed == {"pe:tail_pe"}
    assert "pe:tail_pe" in simulation.truth.situation.down
    simulation.managers.kill()
    assert simulation.operator.say(EnterPhase("glide")) is None
    simulation.operator.clear("pe:tail_pe")
    assert simulation.operator.failed == {"pe:tail_pe"}  # no manager has heard it
    simulation.operator.insist()
    simulation.run_for(S)
    assert simulation.operator.failed == frozenset()
    assert simulation.settle() == []


# The cores are found out where they fail to do what they say


def flown(spec: Spec, *faults: str, seconds: float = 4.0) -> list[tuple[str, str]]:
    """What the oracles say of a flight with these faults."""
    scenario = Scenario(0, seconds, tuple(read_fault(spec, fault) for fault in faults))
    return [(violation.rule, violation.story) for violation in play(spec, scenario).violations]


def test_a_phase_that_is_not_told_is_seen_in_the_end() -> None:
    simulation = flying(big_blue())
    assert simulation.settle() == []
    simulation.checks.ordered(simulation.now_ns, "landing", 1)
    assert "the phase is landing, but the manager sends ascent" in [v.story for v in simulation.unsettled()]


@pytest.mark.soak  # until it is seen, it is flown for long
def test_a_manager_that_says_yes_to_a_phase_and_stays_where_it_is_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(KnownSituation, "enter", lambda *_: ())
    stories = flown(big_blue(), "1 order_phase phase:glide", seconds=2)
    assert ("phase", "the manager of term 1 sends ascent, but glide was requested last") in stories
    assert ("phase", "the phase is glide, but the manager sends ascent") in stories


def test_a_manager_that_plans_with_what_has_failed_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        KnownSituation,
        "down",
        lambda self: frozenset(f"pe:{pe}" for pe in self._spec.pes if not self._health.is_available(pe)),
    )
    for fault in ("1 order_fail device:elevator_servo_1", "1 order_fail module:servo_driver_1"):
        assert "legal" in {rule for rule, _ in flown(two_tails(), fault)}, fault


def test_an_actuator_that_moves_late_and_without_authorization_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    faults = ("1 overrun module:servo_driver_1 for 1", "1.04 pause pe:tail_pe for 0.6")
    assert flown(two_tails(), *faults) == []

    def without_asking(self: RunningModules, running: Any, writes: tuple[Value, ...]) -> None:
        self._turn.do(*(Drive(running.entry.index, value) for value in writes))

    monkeypatch.setattr(RunningModules, "_drive", without_asking)
    assert "exclusion" in {rule for rule, _ in flown(two_tails(), *faults)}


def test_a_module_that_drives_nothing_and_is_given_what_is_old_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    faults = ("1 stuck pe:sensor_pe for 1",)
    assert flown(elevator_and_chute(), *faults) == []
    monkeypatch.setattr(mailboxes, "FRESH_PERIODS", 1000)
    (story,) = [story for rule, story in flown(elevator_and_chute(), *faults) if rule == "freshness"]
    assert story.startswith("chute_logic on control_pe is given altitude of high_quality_altitude, last heard")


# What cannot be promised is not verified for as long as that is so


def test_a_rule_is_waived_from_its_fault_on_until_all_has_settled_and_no_other_is() -> None:
    waivers = Waivers(settling_ns=S)
    waiver = waivers.begin(frozenset(("clash",)), 5 * S)
    assert [waivers.cover("clash", t_ns) for t_ns in (5 * S - 1, 5 * S, 100 * S)] == [False, True, True]
    waiver.to_ns = 6 * S
    assert [waivers.cover("clash", t_ns) for t_ns in (7 * S, 7 * S + 1)] == [True, False]
    assert not waivers.cover("exclusion", 6 * S)
    known = [Violation(8 * S, "clash", "", since_ns) for since_ns in (7 * S, 7 * S + 1)]
    early = [Violation(t_ns, "clash", "", 0) for t_ns in (5 * S - 1, 5 * S)]
    assert waivers.promised([*known, *early]) == (known[1], early[0])
    waivers.begin(frozenset(("clash", "mastership")), 6 * S).to_ns = 8 * S
    waivers.begin(frozenset(), 0)
    assert waivers.unverified_ns(10 * S) == {"clash": 4 * S, "mastership": 3 * S}
    assert waivers.unverified_ns(8 * S) == {"clash": 3 * S, "mastership": 2 * S}


def test_a_report_long_after_data_were_wrong_is_verified() -> None:
    simulation = flying(two_tails())
    injected = (read_fault(simulation.spec, "0.01 wrong module:elevator_control for 0.1"),)
    Injections(simulation, injected, simulation.now_ns)
    simulation.run_for(500 * MS)
    report = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 0)
    (device, *_) = simulation.spec.devices
    sent = Sent(
        simulation.now_ns, "can0", "tail_pe", Frame(emcy_id(simulation.spec.pes["tail_pe"].node_id), report.encode())
    )
    late = sent._replace(end_ns=simulation.now_ns + 10 * S)
    simulation.checks.see(sent)
    assert f"device:{device}" in simulation.truth.situation.down
    assert rules(simulation) == []
    other = flying(two_tails())
    Injections(other, injected, other.now_ns)
    other.run_for(500 * MS)
    other.checks.see(late)
    assert [rule for rule, _ in rules(other)] == ["blame"]


def test_what_is_forged_is_verified_where_there_is_a_key() -> None:
    fault = read_fault(two_tails(), "0.1 forge bus:can0 for 0.2")
    for key in (None, KEY):
        simulation = flying(two_tails(), key=key)
        injections = Injections(simulation, (fault,), simulation.now_ns)
        simulation.run_for(S)
        assert injections.hits.total() == 1
        assert simulation.waivers.cover("exclusion", simulation.now_ns + 100 * S) == (key is None)


# The phase is the one that was requested last


def phases(*, of_two: bool = False) -> tuple[PhaseCheck, list[str | None]]:
    """An oracle of big_blue's phases, and those that it has seen begin."""
    begun: list[str | None] = []
    check = PhaseCheck(big_blue(), lambda _, phase: begun.append(phase))
    if of_two:
        check.may_forget_phase()
    return check, begun


def tells(check: PhaseCheck, t_ns: int, phase: str, term: int = 1) -> list[str]:
    """What the oracle says when a mastership tells a phase."""
    before = len(check.violations)
    check.commanded(
        t_ns, "manager 126", Control(term, 0, Operation.HOLDS, ElementKind.PHASE, list(big_blue().phases).index(phase))
    )
    return [violation.story for violation in check.violations[before:]]


def requests(check: PhaseCheck, phase: str, number: int, node: int = 92) -> None:
    """A PE requests a phase, and the manager hears it."""
    index = list(big_blue().phases).index(phase)
    check.requested(node, Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, index, number))
    check.commanded(0, "manager 126", Control(1, node, Operation.ACKNOWLEDGE, ElementKind.PHASE, number))


def test_the_phase_told_is_the_one_requested_last_or_on_its_way() -> None:
    check, begun = phases()
    assert tells(check, 0, "ascent") == []
    check.ordered(S, "glide", 1)
    assert tells(check, S + 90 * MS, "ascent") == []
    assert tells(check, S + 110 * MS, "ascent") == ["the manager of term 1 sends ascent, but glide was requested last"]
    assert tells(check, 2 * S, "landing") == ["the manager of term 1 sends landing, but glide was requested last"]
    assert begun == ["glide"]


def test_a_request_counts_once_it_is_acknowledged_and_once_for_each_number() -> None:
    check, begun = phases()
    requests(check, "glide", 1)
    check.ordered(S, "ascent", 1)
    requests(check, "glide", 1)
    assert check.current == "ascent"
    requests(check, "glide", 2)
    requests(check, "ascent", 3 | FORWARD_ONLY)
    assert begun == ["glide", "ascent", "glide"]
    check.commanded(0, "manager 126", Control(1, 92, Operation.ACKNOWLEDGE, ElementKind.PHASE, 99))
    check.commanded(0, "manager 126", Control(1, 92, Operation.ACKNOWLEDGE, ElementKind.MODULE, 3))
    assert check.current == "glide"


def test_a_request_of_a_restarted_pe_counts_anew() -> None:
    check, begun = phases()
    check.told(started(92, 1))
    requests(check, "glide", 2)
    check.ordered(S, "ascent", 1)
    check.told(started(92, 1))
    requests(check, "glide", 1)
    assert begun == ["glide", "ascent"]
    check.told(started(92, 2))
    requests(check, "glide", 1)
    assert begun == ["glide", "ascent", "glide"]


@pytest.mark.parametrize("of_two", [False, True])
def test_in_another_term_a_request_counts_again_only_where_that_mastership_may_not_know_of_it(of_two: bool) -> None:
    check, _ = phases(of_two=of_two)
    requests(check, "glide", 1)
    check.ordered(S, "ascent", 1)
    assert tells(check, 2 * S, "ascent", term=2) == []
    glide = list(big_blue().phases).index("glide")
    check.requested(92, Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, glide, FORWARD_ONLY | 1))
    assert bool(tells(check, 3 * S, "glide", term=2)) is not of_two
    requests(check, "glide", FORWARD_ONLY | 1)
    check.ordered(4 * S, "ascent", 2)
    requests(check, "glide", FORWARD_ONLY | 1)
    assert check.current == "ascent"


def test_a_phase_may_be_told_before_the_request_for_it_is_acknowledged() -> None:
    check, begun = phases()
    check.ordered(S, "glide", 1)
    index = list(big_blue().phases).index
    check.requested(92, Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, index("ascent"), FORWARD_ONLY | 1))
    assert tells(check, 2 * S, "ascent") == ["the manager of term 1 sends ascent, but glide was requested last"]
    check.requested(92, Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, index("landing"), 2))
    assert tells(check, 3 * S, "landing") == []
    assert begun == ["glide", "landing"]


def test_a_new_mastership_goes_on_in_the_phase_that_was_or_is_requested() -> None:
    check, begun = phases()
    check.ordered(S, "glide", 1)
    assert tells(check, 2 * S, "glide", term=2) == []
    assert tells(check, 3 * S, "ascent", term=3) == [
        "the manager of term 3 begins with ascent, but the phase was glide"
    ]
    index = list(big_blue().phases).index("landing")
    check.requested(92, Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, index, 7))
    assert tells(check, 4 * S, "landing", term=4) == []
    assert begun == ["glide", "ascent", "landing"]


def test_of_two_managers_one_may_know_less_and_two_that_are_apart_do_not_agree() -> None:
    check, _ = phases(of_two=True)
    check.ordered(S, "glide", 1)
    assert tells(check, 2 * S, "ascent", term=2) == []
    assert tells(check, 3 * S, "glide", term=2) != []
    check.bus_split(0, "can0", True)
    assert tells(check, 4 * S, "glide", term=2) == []
    assert tells(check, 5 * S, "landing", term=2) == [
        "the manager of term 2 begins with landing, but the phase was glide"
    ]


@pytest.mark.parametrize(("is_answered", "phase"), [(False, "ascent"), (True, "glide")])
def test_what_was_just_left_is_on_its_way_though_a_request_for_it_is_made_again(
    *, is_answered: bool, phase: str
) -> None:
    check, _ = phases(of_two=True)
    requests(check, "glide", 3)
    assert tells(check, S, "glide") == []
    repeated = Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, list(big_blue().phases).index("glide"), 3)
    assert tells(check, 2 * S, "glide", term=2) == []
    check.ordered(2 * S + MS, "ascent", 2)
    check.requested(92, repeated)
    assert tells(check, 2 * S + 2 * MS, "glide", term=2) == []
    if is_answered:
        check.commanded(2 * S + 3 * MS, "manager 126", Control(2, 92, Operation.ACKNOWLEDGE, ElementKind.PHASE, 3))
    assert check.current == phase
    assert tells(check, 3 * S, phase, term=2) == []
    assert (tells(check, 4 * S, "ascent", term=2) == []) is not is_answered


def test_an_answer_from_before_an_order_was_on_its_way() -> None:
    check, _ = phases()
    check.ordered(0, "glide", 1)
    check.ordered(S, "ascent", 1)
    index = list(big_blue().phases).index("glide")
    check.requested(92, Emergency(FaultCode.PHASE_REQUEST, 0, ElementKind.PHASE, index, 3))
    check.commanded(S + MS, "manager 126", Control(1, 92, Operation.ACKNOWLEDGE, ElementKind.PHASE, 3))
    assert check.current == "glide"
    assert tells(check, S + 110 * MS, "ascent") == []
    assert tells(check, 2 * S, "ascent") == []
    assert tells(check, 3 * S, "glide") == ["the manager of term 1 sends glide, but ascent was requested last"]


def test_what_a_deposed_manager_promises_does_not_bind_the_active_manager() -> None:
    check, begun = phases(of_two=True)
    assert tells(check, 0, "ascent", term=5) == []
    check.ordered(S, "glide", 4)
    assert tells(check, 2 * S, "ascent", term=5) == []
    check.ordered(3 * S, "glide", 5)
    assert tells(check, 4 * S, "ascent", term=5) == ["the manager of term 5 sends ascent, but glide was requested last"]
    assert begun == ["glide", "ascent", "glide"]


def test_what_a_lower_term_tells_where_the_higher_one_is_silent_counts_for_nothing() -> None:
    check, begun = phases(of_two=True)
    assert tells(check, 0, "ascent", term=4) == []
    check.ordered(S, "landing", 5)
    assert tells(check, 2 * S, "ascent", term=4) == []
    assert (check.current, begun) == ("landing", ["landing"])
    assert tells(check, 3 * S, "ascent", term=5) == [
        "the manager of term 5 sends ascent, but landing was requested last"
    ]


def turns(*handovers: tuple[int, int], leased: bool = True, spoken: bool = True) -> list[str]:
    """What the oracle says when two modules drive a DEMUX in turn, each after a LEASE of this term and epoch."""
    check = ExclusionCheck(two_tails())
    for n, (term, epoch) in enumerate(handovers):
        check.commanded(n * S, "manager 126", Lease(term, epoch, Step.GO_ALL, 0))
        if leased or n == 0:
            check.leased(n * S)
        if spoken:
            check.said(started(94, 1)._replace(t_ns=n * S, pe="right"))
        check.moved(Moved(n * S, *(("left", "servo_driver_1"), ("right", "servo_driver_2"))[n % 2]))
    return [violation.story for violation in check.violations]


def test_a_handover_is_a_newer_epoch_or_any_other_one_of_a_higher_term() -> None:
    assert turns((1, 51), (1, 52), (1, 53)) == []
    again = "DEMUX elevator_out is driven by servo_driver_1 on left again, after servo_driver_2 on right, in epoch"
    assert turns((1, 51), (1, 52), (1, 52)) == [f"{again} 52"]
    assert turns((1, 51), (1, 52), (1, 40)) == [f"{again} 52"]
    assert turns((1, 51), (1, 52), (2, 52)) == [f"{again} 52"]
    assert turns((1, 51), (1, 52), (2, 40)) == []
    assert turns((1, 51), (2, 40), (2, 40)) == [f"{again} 40"]


def test_where_no_manager_is_active_and_the_other_pe_is_not_heard_it_may_have_let_go() -> None:
    assert turns((1, 51), (1, 52), (1, 52), leased=False, spoken=False) == []
    assert turns((1, 51), (1, 52), (1, 52), leased=False) != []
    assert turns((1, 51), (1, 52), (1, 52), spoken=False) != []


def test_a_pe_that_a_foreign_node_names_may_take_that_for_new() -> None:
    for named_ns, is_seen in ((2 * S - 101 * MS, True), (2 * S - 100 * MS, False)):
        check = ExclusionCheck(two_tails())
        for n, pe in enumerate(("left", "right", "left", "right")):
            check.leased(n * S)
            check.misled(named_ns, ["left"])
            check.moved(Moved(n * S, pe, f"servo_driver_{1 + n % 2}"))
        assert bool(check.violations) is is_seen


@pytest.mark.parametrize(
    ("frame", "sender", "key", "is_seen"),
    [
        (Frame(state_id(TAIL), bytes(8)), "stranger 1", None, False),
        (Frame(state_id(TAIL), bytes(8)), "stranger 1", KEY, True),
        (Frame(state_id(TAIL), bytes(8)), "tail_pe", None, True),
        (Frame(emcy_id(TAIL), bytes(8)), "stranger 1", None, True),
        (command_frame(Alive(1, 0, frozenset({TAIL}))), "stranger 1", KEY, False),
        (Frame(management_id(126, Command.ALIVE), b""), "stranger 1", None, True),
    ],
)
def test_a_pe_imitated_or_named_by_a_foreign_node_is_not_verified(
    *, frame: Frame, sender: str, key: Key | None, is_seen: bool
) -> None:
    checks = Checks(two_tails(), key=key)
    for n, pe in enumerate(("tail_pe", "control_pe", "tail_pe")):
        checks.see(Sent(n, "can0", sender, frame))
        checks.moved(Moved(n * MS, pe, f"servo_driver_{1 + n % 2}"))
    stories = [violation for violation in checks.broken(Situation(), []) if violation.rule == "exclusion"]
    assert bool(stories) is is_seen


def test_where_a_higher_term_is_silent_the_one_before_goes_on_with_its_own_numbers() -> None:
    assert turns((1, 51), (2, 60), (1, 52)) == []
    assert turns((1, 51), (2, 60), (1, 51)) != []
    assert turns((1, 51), (2, 60), (1, 50)) != []


def test_the_oracles_know_the_limits_that_are_promised() -> None:
    assert {name: value for name, value in vars(promised).items() if name.isupper()} == {
        "LEASE_PERIODS": protocol_times.LEASE_PERIODS,
        "CHANNEL_REPORT_NS": protocol_times.CHANNEL_REPORT_NS,
        "START_UP_WINDOW_NS": protocol_times.START_UP_WINDOW_NS,
        "PATIENCE_PERIODS": protocol_times.PATIENCE_PERIODS,
        "FRESH_PERIODS": protocol_times.FRESH_PERIODS,
        "SILENT_PERIODS": protocol_times.SILENT_PERIODS,
        "SILENCE_REPORT_NS": protocol_times.SILENCE_REPORT_NS,
        "HOLD_DOWN_PERIODS": protocol_times.HOLD_DOWN_PERIODS,
        "LONGEST_HOLD_DOWN_NS": protocol_times.LONGEST_HOLD_DOWN_NS,
        "FORGIVEN_AFTER_NS": protocol_times.FORGIVEN_AFTER_NS,
        "RADIO_WINDOW_PERIODS": protocol_times.RADIO_WINDOW_PERIODS,
        "RADIO_DOUBLINGS": radio_links.MOST_DOUBLINGS,
        "RADIO_STEPS": radio_links.STEPS,
        "UNPRICED_PERCENT": attack_rate.PRICE_PERCENT,
    }


def test_what_is_not_critical_or_not_wanted_in_the_phase_may_be_silent() -> None:
    def check(spec: Spec, phase: str | None) -> ServiceCheck:
        found = ServiceCheck(spec)
        found.alive(S, frozenset(spec.pes))
        found.entered(2 * S, phase)
        return found

    spec = big_blue()
    unwanted = next(
        (function.name, phase)
        for function in spec.functions.values()
        for phase in spec.phases
        if not function.priority_in(phase) and any(function.priority_in(other) for other in spec.phases)
    )
    assert assessed(check(spec, unwanted[1]), function=unwanted[0], lasts_ns=15 * S) == []


def test_injected_faults_record_what_they_did_and_until_when() -> None:
    simulation = flying(two_tails())
    start_ns = simulation.now_ns
    texts = (
        "0 crash pe:tail_pe",
        "0.1 cut pe:sensor_pe for 0.2",
        "0.1 loss bus:can0 for 0.2 level 1",
        "0.4 bus_off pe:control_pe",
    )
    injections = Injections(simulation, tuple(read_fault(simulation.spec, text) for text in texts), start_ns)
    simulation.run_for(500 * MS)
    assert {
        (one.element, one.from_ns - start_ns, one.to_ns and one.to_ns - start_ns) for one in injections.injected
    } == {
        ("pe:tail_pe", 0, None),
        ("pe:sensor_pe", 100 * MS, 300 * MS),
        (None, 100 * MS, 300 * MS),
        ("pe:control_pe", 400 * MS, 400 * MS),
    }


def test_no_phase_and_no_fault_leaves_every_critical_function_of_every_aircraft_to_be_served() -> None:
    for spec in (elevator_and_chute(), two_tails()):
        check = ServiceCheck(spec)
        check.alive(0, PES)
        critical = [f.name for f in spec.functions.values() if f.criticality_in(None) in "ABCD"]
        assert [name for name in critical if assessed(check, function=name)] == critical
        assert Situation() == Situation(frozenset(), {}, spec.initial_phase())
