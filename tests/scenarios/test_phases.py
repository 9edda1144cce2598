"""Mission phases in flight: requests of PEs arrive, whichever frame is lost on the way; and orders of the operator."""

import pytest

from heronry_agent.module import Inputs, Module, Value
from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_manager.core.vocabulary import AskStatus, ClearElement, EnterPhase, FailElement, Order, Reply
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Tampering
from heronry_wire.identifiers import Command, emcy_id, management_id
from heronry_wire.management import Operation
from scenarios.flights import MS, big_blue, flying, management_frames, two_tails

ESTIMATOR = "  state_estimator: {"


def with_phases(phases: str, **images: str) -> Spec:
    """Figure 3 of the paper with phases, and with code of this file in some modules."""
    text = shipped_spec_path("elevator_and_chute").read_text()
    text = text.replace("criticality: D, priority: 20", "criticality: D, priority: {default: 20, land: 0}")
    for module, image in images.items():
        assert f"  {module}: {{" in text
        text = text.replace(f"  {module}: {{", f'  {module}: {{image: "scenarios.test_phases:{image}", ')
    return loads(text.replace("functions:\n", f"phases: {phases}\nfunctions:\n"), "phases.dg.yaml")


class AsksForLanding(Module):
    """Estimates nothing, and requests the landing from its fortieth step on, in every step."""

    steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it looks at nothing
        self.steps += 1
        if self.steps >= 40:
            self.ctx.request_phase("land")
        return {"state_info": 0.0}


class Rises(Module):
    """Estimates a number that rises by one each second, from 0 at its start."""

    steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it looks at nothing
        self.steps += 1
        return {"state_info": self.steps / 40}


RISING = with_phases(
    "{climb: {}, land: {when: {variable: state_info, above: 2.0, hold_ms: 300}}}", state_estimator="Rises"
)
ASKING = with_phases("{climb: {}, land: {}}", state_estimator="AsksForLanding")


def say(simulation: Simulation, order: Order) -> Reply:
    reply = simulation.operator.say(order)
    assert reply is not None
    return reply


def entered(simulation: Simulation) -> list[tuple[str, str]]:
    return [(told.phase, told.by) for told in simulation.events_of(events.PhaseChanged)]


def test_the_operator_changes_the_phase_and_what_is_not_wanted_stops() -> None:
    simulation = flying(with_phases("{climb: {}, land: {}}"))
    assert say(simulation, EnterPhase("land")).done
    assert simulation.settle() == []
    told = simulation.events_of(events.Reconfigured)[-1]
    assert told.causes == ("phase land, requested by the operator",)
    assert told.stopped == ("angle_driver", "servo_monitor")


def test_a_module_that_requests_a_phase_in_every_step_is_heard_once() -> None:
    simulation = flying(ASKING)
    simulation.run_for(2_000 * MS)
    assert [phase for phase, _ in entered(simulation)] == ["land"]
    assert simulation.settle() == []
    assert len(simulation.events_of(events.Reconfigured)) == 2


def test_a_rule_is_watched_where_its_variable_is_made() -> None:
    simulation = flying(RISING)
    simulation.run_for(1_900 * MS)
    assert entered(simulation) == []
    simulation.run_for(700 * MS)
    assert [phase for phase, _ in entered(simulation)] == ["land"]
    assert simulation.settle() == []


def test_what_the_operator_turns_back_is_led_forward_again_while_the_condition_of_the_rule_holds() -> None:
    simulation = flying(RISING)
    simulation.run_for(2_600 * MS)
    say(simulation, EnterPhase("climb"))
    simulation.run_for(2_000 * MS)
    assert simulation.checks.phase == "land"
    assert simulation.settle() == []


@pytest.mark.parametrize("spec", [RISING, ASKING], ids=["by a rule", "by a module"])
def test_another_mastership_receives_the_request_again(spec: Spec) -> None:
    simulation = flying(spec)
    simulation.run_for(3_000 * MS)
    assert simulation.checks.phase == "land"
    simulation.managers.kill()
    simulation.run_for(100 * MS)
    simulation.managers.start()
    assert simulation.settle() == []
    assert simulation.checks.phase == "land"


def test_a_request_or_its_acknowledgement_that_is_lost_costs_a_repetition() -> None:
    recorded = flying(ASKING, keep_trace=True)
    started_ns = recorded.now_ns
    recorded.run_for(1_500 * MS)
    requests = {emcy_id(pe.node_id) for pe in ASKING.pes.values()}
    answers = management_id(126, Command.CONTROL)
    told = [
        sent
        for sent in management_frames(recorded.trace, started_ns, recorded.now_ns)
        if sent.frame.can_id in requests
        or (sent.frame.can_id == answers and sent.frame.data[3] == Operation.ACKNOWLEDGE)
    ]
    assert len(told) > 2  # the answer again, each time that the phase is told
    for sent in told[:2]:
        simulation = flying(ASKING)
        simulation.wiring.tamper(sent, Tampering(0))
        simulation.run_for(1_500 * MS)
        assert [phase for phase, _ in entered(simulation)] == ["land"]
        assert simulation.settle() == []


def test_big_blue_in_another_phase_loses_a_processor_and_gets_it_back() -> None:
    simulation = flying(big_blue())
    say(simulation, EnterPhase("landing"))
    assert simulation.settle() == []
    simulation.fleet.kill("flight")
    assert simulation.settle() == []
    simulation.fleet.restore("flight")
    assert simulation.settle() == []
    assert simulation.checks.phase == "landing"


def test_a_pe_that_the_operator_fails_stops_driving_and_comes_back_when_it_is_cleared() -> None:
    simulation = flying(two_tails())
    say(simulation, FailElement("pe:tail_pe"))
    simulation.truth.failed("pe:tail_pe")
    assert simulation.settle() == []
    status = say(simulation, AskStatus()).status
    assert status is not None
    assert status["pes"]["tail_pe"]["state"] == "down"
    say(simulation, ClearElement("pe:tail_pe"))
    simulation.run_for(1_000 * MS)
    assert simulation.events_of(events.PeJoined)[-1].pe == "tail_pe"
    assert simulation.broken() == []


def test_a_mastership_that_begins_beside_a_dead_pe_does_not_wait_for_it() -> None:
    simulation = flying(two_tails())
    simulation.fleet.kill("sensor_pe")
    assert simulation.settle() == []
    simulation.managers.kill()
    simulation.managers.start()
    begun_ns = simulation.now_ns
    simulation.run_for(300 * MS)
    (absent,) = [told for told in simulation.events_of(events.PeAbsent) if told.t_ns > begun_ns]
    assert absent.pe == "sensor_pe"
    assert simulation.settle() == []


def test_an_advisor_beside_a_manager_sends_nothing_and_plans_the_same() -> None:
    simulation = flying(two_tails())
    active_manager = simulation.managers.foremost
    simulation.managers.start(127, advise=True)
    simulation.run_for(1500 * MS)
    assert simulation.events_of(events.Adopted)[-1].epoch == simulation.events_of(events.Reconfigured)[-1].epoch
    simulation.fleet.kill("tail_pe")
    assert simulation.settle() == []
    assert active_manager is not None
    assert active_manager.stopped is None
    assert simulation.events_of(events.SecondManager) == []
    told, holds = simulation.managers.running[127].core.status(), active_manager.core.status()
    assert [told[one] for one in ("epoch", "stage", "functions")] == [
        holds[one] for one in ("epoch", "stage", "functions")
    ]
    assert told["pes"]["control_pe"]["epoch"] == told["epoch"]
    assert simulation.events_of(events.UnknownEpoch) == []


@pytest.mark.soak
def test_big_blue_is_released_and_glides_by_its_own_rules() -> None:
    simulation = Simulation(big_blue(), aloft_ns=85_000 * MS)  # high up, on its line, with its wings out
    simulation.run_until(18_000 * MS)
    assert [phase for phase, _ in entered(simulation)] == ["deployment", "glide"]
    assert simulation.settle() == []
    (glide,) = [told for told in simulation.events_of(events.Reconfigured) if "phase glide" in told.causes[0]]
    assert "cutdown_logic" in glide.stopped  # nothing left to cut
