"""Each oracle of a simulated run finds the violations that it is for, and no others."""

import ast
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import pytest

from heronry_agent.module import Datum, Value
from heronry_dg.configuration import Configuration
from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_dg.traffic import identifiers
from heronry_manager import events
from heronry_manager.core.tables.compilation import Compiler
from heronry_tools.cli import main
from heronry_tools.recording.commanded import Epoch
from heronry_tools.runtime.witness import Outage, Witness
from heronry_tools.sim.faults.fault import MANAGER
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.oracles.priorities import PriorityCheck
from heronry_tools.sim.oracles.silence import LeftOut, stopped_by_silence
from heronry_tools.sim.world.bus import Clash, Sent
from heronry_tools.sim.world.planning import best_plan
from heronry_tools.sim.world.steps_seen import Driven, Moved
from heronry_wire.canaerospace import decode_data
from heronry_wire.frame import Frame, Malformed
from heronry_wire.identifiers import emcy_id, state_id
from heronry_wire.management import Activate, Control, ElementKind, Emergency, FaultCode, Operation, Prepare, Step
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage0, StatePage1
from lab.peers import command_frame, slice_messages

LIGHT_OR_NOISE = Path(__file__).parents[1] / "scenarios" / "light_or_noise.dg.yaml"
S = 1_000_000_000
SPEC = load(shipped_spec_path("elevator_and_chute"))
TABLES = {pe: Compiler(SPEC).table(pe) for pe in SPEC.pes}
WELL = Situation()
TAIL = 94


def sent(frame: Frame, sender: str = "tail_pe", t_ns: int = 0) -> Sent:
    return Sent(t_ns, "can0", sender, frame)


def activation(epoch: int, step: Step = Step.GO_ALL) -> Sent:
    return sent(command_frame(Activate(1, epoch, step, 5)), "manager 126")


def state(epoch: int, digest: int, incarnation: int = 1, state: PeState = PeState.ACTIVE, node: int = TAIL) -> Sent:
    return sent(Frame(state_id(node), StatePage0(state, PeFlags(0), incarnation, epoch, 0, digest).encode()))


def rules(checks: Checks, truth: Situation = WELL) -> list[str]:
    return [violation.rule for violation in checks.broken(truth, [])]


def commands(
    configuration: Configuration,
    *,
    absent: frozenset[str] = frozenset(),
    unstaged: frozenset[str] = frozenset(),
    digest: int | None = None,
    bodies: bool = True,
) -> list[Sent]:
    """A configuration on its way, as frames: PREPARE, slices, what the PEs say, ACTIVATE."""
    compiled = Compiler(SPEC).configuration(configuration)
    announced = compiled.digest if digest is None else digest
    frames = [command_frame(Prepare(1, 1, announced))]
    for pe in SPEC.pes.values():
        if pe.name not in absent:
            said = slice_messages(pe.node_id, 1, compiled.slices[pe.node_id], TABLES[pe.name].identity)
            frames += map(command_frame, said if bodies else said[:1])
            if pe.name not in unstaged:
                page = StatePage1(PeState.ACTIVE, PeFlags(0), 1, announced, Reason.NONE, 0)
                frames.append(Frame(state_id(pe.node_id), page.encode()))
    frames.append(command_frame(Activate(1, 1, Step.GO_ALL, announced)))
    return [sent(frame, "whoever") for frame in frames]


def assessed(frames: list[Sent]) -> list[str]:
    checks = Checks(SPEC, TABLES.values())
    for frame in frames:
        checks.see(frame)
    return [f"{violation.rule}: {violation.story}" for violation in checks.broken(WELL, [])]


BEST = best_plan(SPEC, WELL, None).configuration


def test_the_best_plan_staged_by_all_pes_is_in_order() -> None:
    assert assessed(commands(BEST)) == []


def test_a_configuration_that_breaks_a_rule_of_the_graph_is_seen() -> None:
    unwired = {
        name: replace(running, inputs={}) if name == "servo_driver_1" else running
        for name, running in BEST.modules.items()
    }
    (story, *_) = assessed(commands(Configuration(unwired)))
    assert story.startswith("configuration: epoch 1: rule ")


def test_a_pe_that_has_not_staged_is_not_activated() -> None:
    stories = assessed(commands(BEST, unstaged=frozenset({"tail_pe"})))
    assert stories == ["configuration: epoch 1 was activated before tail_pe reported it as staged"]


def test_what_could_be_served_is_not_dropped() -> None:
    (story,) = assessed(commands(Configuration({})))
    assert story.startswith("service: epoch 1 serves (0, 0, 0, 0) by criticality")


def test_what_cannot_be_served_without_the_absent_pes_may_be_dropped() -> None:
    left = best_plan(SPEC, Situation(frozenset({"pe:tail_pe"})), None).configuration
    assert assessed(commands(left, absent=frozenset({"tail_pe"}))) == []
    assert any(story.startswith("service: ") for story in assessed(commands(left)))


def test_what_was_reported_and_acknowledged_counts_as_failed() -> None:
    left = best_plan(SPEC, Situation(frozenset({"module:chute_driver"})), None).configuration
    position = list(SPEC.modules).index("chute_driver")
    heard = Control(1, TAIL, Operation.ACKNOWLEDGE, ElementKind.MODULE, position)
    acknowledged = sent(command_frame(heard), "manager 126")
    assert assessed([acknowledged, *commands(left)]) == []
    assert any(story.startswith("service: ") for story in assessed(commands(left)))


def test_slices_that_were_not_sent_or_are_not_what_was_announced_are_seen() -> None:
    assert "it was activated before the slice of node" in assessed(commands(BEST, bodies=False))[0]
    assert "do not have the digest that PREPARE has announced" in assessed(commands(BEST, digest=77))[0]


def driven_by_another_pe(simulation: Simulation, value: Value) -> Driven:
    """A step, now, of a branch of a DEMUX whose input comes from another PE."""
    modules = simulation.events_of(events.PlanReady)[-1].plan.modules
    branches = [branch for demux in simulation.spec.demuxes.values() for branch in demux.branches if branch in modules]
    branch, path, wire = next(
        (branch, path, wire)
        for branch in branches
        for path, wire in modules[branch].inputs.items()
        if modules[wire.producer].pe != modules[branch].pe
    )
    inputs = {path: (wire.variable, Datum(value, 1, 0))}
    return Driven(simulation.now_ns, modules[branch].pe, branch, inputs, simulation.now_ns)


def last_demand(simulation: Simulation) -> Value:
    """What the elevator was last told, as it went over the bus."""
    identifier = identifiers(simulation.spec)["elevator_control", "elevator_demand"]
    frame = next(sent.frame for sent in reversed(simulation.trace) if sent.frame.can_id == identifier)
    datum = decode_data(frame)
    assert not isinstance(datum, Malformed)
    assert isinstance(datum.value, float)
    return datum.value


def test_a_branch_that_is_driven_by_what_was_heard_long_ago_is_seen() -> None:
    simulation = Simulation(load(shipped_spec_path("big_blue")), keep_trace=True)
    simulation.run_for(2_000_000_000)
    driven = driven_by_another_pe(simulation, last_demand(simulation))
    simulation.checks.driven(driven)
    simulation.checks.driven(driven._replace(t_ns=simulation.now_ns + 80_000_000))  # a slow processor
    assert simulation.broken() == []
    simulation.checks.driven(driven._replace(asked_ns=simulation.now_ns + 500_000_000))
    (violation,) = simulation.broken()
    assert (violation.rule, "last heard 5" in violation.story) == ("freshness", True)


def test_a_branch_that_is_driven_by_what_its_producer_has_not_sent_is_seen() -> None:
    simulation = Simulation(load(shipped_spec_path("big_blue")))
    simulation.run_for(2_000_000_000)
    simulation.checks.driven(driven_by_another_pe(simulation, 123.0))
    (violation,) = simulation.broken()
    assert (violation.rule, "has sent no 123.0 lately" in violation.story) == ("foreign", True)


def test_what_was_heard_before_a_wire_broke_is_no_foreign_datum_as_long_as_it_is_fresh() -> None:
    simulation = Simulation(load(shipped_spec_path("big_blue")))
    simulation.run_for(2_500_000_000)
    simulation.fleet.cut("ground")
    simulation.run_for(500_000_000)  # twenty frames of what may be three periods of a slower mode old
    simulation.fleet.mend("ground")
    simulation.run_for(200_000_000)
    assert simulation.broken() == []


def test_more_data_than_a_bus_has_a_budget_for_is_seen() -> None:
    checks = Checks(SPEC, TABLES.values())
    for i in range(8_000):
        checks.see(sent(Frame(1536, bytes(8)), t_ns=i * 124_000))
    checks.see(sent(Frame(1536, bytes(8)), t_ns=2_000_000_000))
    assert rules(checks) == ["load"]


class Silent(Witness):
    """A witness that has heard the elevator stop at 5 ns, and the parachute at 3."""

    def __init__(self) -> None:
        super().__init__(SPEC)

    def outages(self, now_ns: int) -> list[Outage]:
        return [Outage("elevator", 5, now_ns), Outage("parachute", 3, None)]


def test_an_outage_without_a_fault_but_the_managers_is_a_violation() -> None:
    witness = Silent()
    left_out = LeftOut(SPEC, {}, lambda _from_ns, _to_ns: [WELL])
    (violation,) = stopped_by_silence(SPEC, (MANAGER, "standby"), witness, range(4, 9), left_out)
    assert violation.story.split()[0] == "elevator"
    assert (violation.since_ns, violation.t_ns) == (5, 5 + witness.patience_ns("elevator"))
    assert stopped_by_silence(SPEC, (MANAGER, "pe:tail_pe"), witness, range(4, 9), left_out) == []


def light_falls_silent(spec: Spec, in_force: Situation, *ran: Situation) -> bool:
    """Tell whether the oracle accepts that the light is heard last at 10 s, and was due again at 11 s.

    Of the best plans for the situations `ran`, one is activated each second from 9 s on. in_force: the situation since.
    """
    epochs = {
        number: Epoch(number, 0, 8 * S + number * S, 1, activated_ns=8 * S + number * S, configuration=plan)
        for number, plan in enumerate((best_plan(spec, now, None).configuration for now in ran), start=1)
    }
    left_out = LeftOut(spec, epochs, lambda _from_ns, _to_ns: [in_force])
    return left_out.explains(Outage("light", 10 * S, None), S)


def test_a_function_may_fall_silent_if_the_plan_for_changed_priorities_leaves_it_out() -> None:
    spec = load(LIGHT_OR_NOISE)
    noisy, equal, none = (Situation(priorities={"noise": priority}) for priority in (90, 50, 0))
    assert light_falls_silent(spec, noisy, WELL, WELL, noisy)
    assert light_falls_silent(spec, noisy, noisy)
    assert light_falls_silent(spec, equal, noisy)  # both plans are equally good
    assert not light_falls_silent(spec, WELL, WELL, WELL, noisy)  # the light is more important
    assert not light_falls_silent(spec, none, WELL, noisy)
    assert not light_falls_silent(spec, noisy, WELL, WELL, WELL)  # the plan that runs serves the light
    assert not light_falls_silent(spec, noisy, noisy, WELL)  # and so does this one, since 10 s
    assert not light_falls_silent(spec, noisy, WELL, WELL, WELL, noisy)  # the light was due a second before
    assert not light_falls_silent(spec, noisy)


def monitor_falls_silent(*pes: str) -> bool:
    """Tell whether the oracle accepts that servo_monitoring is heard last at 1.5 s, and was due again at 2.5 s.

    The best plan is activated each second, with servo_monitor on the next one of `pes`.
    """
    best = best_plan(SPEC, WELL, None).configuration
    epochs = {}
    for number, pe in enumerate(pes, start=1):
        modules = {**best.modules, "servo_monitor": replace(best.modules["servo_monitor"], pe=pe)}
        t_ns = number * S
        epochs[number] = Epoch(number, 0, t_ns, 1, activated_ns=t_ns, configuration=Configuration(modules))
    left_out = LeftOut(SPEC, epochs, lambda _from_ns, _to_ns: [WELL])
    return left_out.explains(Outage("servo_monitoring", 3 * S // 2, None), S)


def test_a_function_may_fall_silent_while_its_module_moves() -> None:
    assert monitor_falls_silent("sensor_pe", "tail_pe")
    assert not monitor_falls_silent("sensor_pe", "sensor_pe")
    assert not monitor_falls_silent("sensor_pe", "sensor_pe", "tail_pe")  # it was due half a second before the move


def test_a_flight_in_which_a_priority_takes_a_function_away_breaks_no_rule(capsys: pytest.CaptureFixture[str]) -> None:
    acts = ["--act", "0.2 manager_pause manager for 0.005"]
    assert main(["sim", str(LIGHT_OR_NOISE), *acts, "--seconds", "2"]) == 0, capsys.readouterr().out


def drive(checks: Checks, *modules: str) -> None:
    for t_ns, module in enumerate(modules):
        checks.moved(Moved(t_ns, "tail_pe", module))


def test_a_demux_may_change_hands_with_every_epoch() -> None:
    checks = Checks(SPEC, TABLES.values())
    for epoch, module in enumerate(["servo_driver_1", "servo_driver_2", "servo_driver_1"], start=1):
        checks.see(activation(epoch))
        drive(checks, module, module)
    assert rules(checks) == []


def test_an_actuator_without_a_demux_has_one_driver_too() -> None:
    text = shipped_spec_path("elevator_and_chute").read_text()
    second = "  second_driver: {needs: chute_release, device: chute_solenoid, cpu: 0.01, ram: 1KiB, rate_hz: 10}"
    spec = loads(text.replace("functions:\n", f"{second}\nfunctions:\n"), "twice.dg.yaml")
    checks = Checks(spec)
    drive(checks, "chute_driver", "chute_driver", "second_driver")
    assert rules(checks) == []
    drive(checks, "chute_driver")
    assert rules(checks) == ["exclusion"]


def test_a_demux_driven_in_turn_within_an_epoch_has_two_drivers() -> None:
    checks = Checks(SPEC, TABLES.values())
    checks.see(activation(1))
    drive(checks, "servo_driver_1", "servo_driver_2", "servo_driver_1")
    checks.see(activation(2, Step.PREPARED))
    assert rules(checks) == ["exclusion"]


def test_what_an_epoch_gave_may_begin_to_drive_while_the_next_one_breaks() -> None:
    """Its frame waited for the bus and leaves before `broken`; the PE that gets the DEMUX back begins later, on GO."""
    checks = Checks(SPEC, TABLES.values())
    checks.see(activation(1))
    drive(checks, "servo_driver_1")
    checks.see(activation(2))
    checks.see(activation(3, Step.BREAK))
    drive(checks, "servo_driver_2")
    checks.see(activation(3, Step.GO))
    drive(checks, "servo_driver_1")
    assert rules(checks) == []


def test_go_all_hands_over_what_waited_longer_than_go() -> None:
    """A silent PE may begin what it was given before, until its lease is over; only then its successor gets it."""
    checks = Checks(SPEC, TABLES.values())
    for epoch, step in ((1, Step.GO_ALL), (2, Step.GO), (2, Step.GO_ALL)):
        checks.see(activation(epoch, step))
        drive(checks, "servo_driver_2" if step is Step.GO else "servo_driver_1")
    assert rules(checks) == []
    drive(checks, "servo_driver_2", "servo_driver_1")
    assert rules(checks) == ["exclusion", "exclusion"]


def test_modules_that_drive_in_turn_while_an_epoch_breaks_are_seen() -> None:
    checks = Checks(SPEC, TABLES.values())
    checks.see(activation(1))
    drive(checks, "servo_driver_1")
    checks.see(activation(2, Step.BREAK))
    drive(checks, "servo_driver_2", "servo_driver_1")
    assert rules(checks) == ["exclusion"]


def test_an_identifier_sent_in_turn_by_two_nodes_is_seen_and_on_another_bus_it_is_another() -> None:
    checks = Checks(load(shipped_spec_path("big_blue")))
    datum = Frame(1536, bytes(8))
    for sender in ("tail_pe", "sensor_pe"):
        checks.see(Sent(0, "can0", sender, datum))
        checks.see(Sent(0, "radio", "comms", datum))
    assert rules(checks) == []
    checks.see(Sent(0, "can0", "tail_pe", datum))
    assert rules(checks) == ["exclusion"]


def test_one_epoch_has_one_digest() -> None:
    checks = Checks(SPEC, TABLES.values())
    checks.see(state(1, 5))
    checks.see(state(1, 5, node=93))
    assert rules(checks) == []
    checks.see(state(1, 6, node=92))
    assert rules(checks) == ["digest"]


def test_an_epoch_goes_back_only_with_a_new_incarnation() -> None:
    checks = Checks(SPEC, TABLES.values())
    checks.see(state(3, 5))
    checks.see(state(0, 0, incarnation=2, state=PeState.UNCONFIGURED))
    checks.see(state(2, 7, incarnation=2))
    assert rules(checks) == []
    checks.see(state(1, 8, incarnation=2))
    assert rules(checks) == ["epoch"]


def test_a_report_of_what_has_not_failed_is_a_false_one() -> None:
    checks = Checks(SPEC, TABLES.values())
    emergency = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 7)
    checks.see(sent(Frame(emcy_id(TAIL), emergency.encode())))
    checks.see(sent(Frame(emcy_id(TAIL), Emergency(FaultCode.RESET, 0, ElementKind.PE, 0, 0).encode())))
    assert rules(checks, Situation(frozenset({"device:gps"}))) == []
    assert rules(checks) == ["blame"]


def test_a_servo_may_be_reported_for_a_fault_of_the_sensor_with_which_a_monitor_compares_it() -> None:
    spec = load(shipped_spec_path("big_blue"))
    checks, names = Checks(spec), list(spec.devices)
    emergency = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, names.index("elevator_servo_1"), 7)
    checks.see(sent(Frame(emcy_id(spec.pes["tail_a"].node_id), emergency.encode()), "tail_a"))
    assert rules(checks, Situation(frozenset({"device:elevator_angle_sensor"}))) == []
    assert rules(checks, Situation(frozenset({"device:gps"}))) == ["blame"]


def test_what_a_gateway_passes_on_is_not_its_own_report() -> None:
    """A node beyond without a key may say anything in the name of any other: no PE is blamed for that."""
    checks = Checks(SPEC, TABLES.values())
    slander = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 7)
    checks.see(sent(Frame(emcy_id(TAIL), slander.encode()), "control_pe"))
    assert rules(checks) == []
    assert checks.reported == {}
    checks.see(sent(Frame(emcy_id(TAIL), replace(slander, index=200).encode()), "control_pe"))
    assert rules(checks) == []
    checks.see(sent(Frame(emcy_id(TAIL), replace(slander, index=200).encode()), "tail_pe"))
    assert rules(checks) == ["blame"]


def test_a_gateway_that_passes_on_out_of_order_is_no_return_of_a_pe_to_an_older_term() -> None:
    spec = load(shipped_spec_path("big_blue"))
    checks, ground = Checks(spec), spec.pes["ground"].node_id

    def says(epoch: int, bus: str, sender: str) -> None:
        checks.see(state(epoch, 7, node=ground)._replace(bus=bus, sender=sender))

    for term, epoch in ((1, 1), (5, 65)):
        prepare = command_frame(Prepare(term, epoch, 7))
        checks.see(sent(prepare, "manager 126"))
    for bus, sender in (("radio", "ground"), ("can0", "comms")):
        says(65, bus, sender)
    says(1, "can0", "comms")
    assert rules(checks) == []
    says(1, "radio", "ground")
    assert rules(checks) == ["epoch", "term"]


def test_a_clash_is_a_violation() -> None:
    (violation,) = Checks(SPEC, TABLES.values()).broken(WELL, [Clash(5, "can0", 1536, ("a", "b"))])
    assert str(violation) == "0.000000 s  clash: a and b both wanted to send 1536 on can0"


def test_silence_is_not_settled() -> None:
    stories = [violation.story for violation in Checks(SPEC, TABLES.values()).unsettled(WELL, 1_000_000_000)]
    assert "tail_pe is healthy, but sends no state" in stories
    assert "class A: no output heard of elevator, which could be served" in stories
    nothing_left = Situation(frozenset(f"pe:{pe}" for pe in SPEC.pes))
    assert Checks(SPEC, TABLES.values()).unsettled(nothing_left, 1_000_000_000) == []


def test_pes_in_different_epochs_or_on_their_way_are_not_settled() -> None:
    checks = Checks(SPEC, TABLES.values())
    checks.see(state(1, 5, node=92))
    checks.see(state(2, 6, node=93))
    checks.see(state(2, 6, node=94, state=PeState.BROKEN))
    stories = [violation.story for violation in checks.unsettled(WELL, 1)]
    assert "tail_pe is BROKEN in epoch 2" in stories
    assert "the healthy PEs are in epochs [1, 2]" in stories


# Words, and what follows from a spec; a disk is read as its manager reads it.
ORACLES_KNOW = {
    "heronry_agent.module": {"freshness"},
    "heronry_manager.shell.journal": {"journal"},
    "heronry_manager.core.memory": {"journal"},
    "heronry_manager.core.topology": {
        "authenticity",
        "commanded",
        "configurations",
        "liveness",
        "radio",
        "service",
        "stale",
        "solitude",
    },
}


def test_oracles_share_no_more_with_what_they_verify_than_is_listed_here() -> None:
    import_of = defaultdict(set)
    oracles = Path("tools/heronry_tools/sim/oracles").glob("*.py")
    for file in (*oracles, Path("tools/heronry_tools/recording/commanded.py")):  # what an oracle reads frames with
        for node in ast.walk(ast.parse(file.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                if name.startswith(("heronry_agent", "heronry_manager")):
                    import_of[name].add(file.stem)
    assert import_of == ORACLES_KNOW


def test_requested_priorities_change_seldom_but_what_a_new_mastership_remembers_is_no_change() -> None:
    oracle = PriorityCheck(load(LIGHT_OR_NOISE), lambda _t_ns, _priorities: None)
    noise = 1 << 8

    def tell(t_ns: int, term: int, priority: int) -> None:
        told = Control(term, 0, Operation.HOLDS, noise | ElementKind.PRIORITY, priority)
        oracle.commanded(t_ns, "manager", told)

    for priority in (60, 90):
        oracle.wanted_priority(Emergency(FaultCode.PRIORITY_REQUEST, 0, ElementKind.PRIORITY, noise, priority))
    tell(1 * S, 1, 60)
    tell(3 * S, 1, 90)
    tell(3 * S + 500, 2, 60)  # the HOLDS of before had not reached this manager
    tell(3 * S + 900, 2, 90)
    tell(5 * S, 2, 60)
    oracle.manager_jumped(5 * S + 1, 999_000_000)
    tell(5 * S + 2, 2, 90)
    assert oracle.violations == []
    tell(5 * S + 950, 2, 60)
    (violation,) = oracle.violations
    assert violation.story == "priority 60 of noise: changed after 0 ms"
