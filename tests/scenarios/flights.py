"""The aircraft of the scenario tests, and how a flight is begun, disturbed and evaluated."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_tools.sim.flight.simulation import DEFAULT_DECIDE_NS, Simulation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.planning import Planners
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.identifiers import Use, classify

MS = 1_000_000
KEY = Key(bytes(KEY_BYTES))
LONGEST_START_NS = 5_000 * MS


@cache
def big_blue() -> Spec:
    return load(shipped_spec_path("big_blue"))


@cache
def elevator_and_chute() -> Spec:
    return load(shipped_spec_path("elevator_and_chute"))


@cache
def two_tails() -> Spec:
    """Figure 3 of the paper with its two servos on two PEs, so that the DEMUX has to move between them."""
    text = shipped_spec_path("elevator_and_chute").read_text()
    apart = text.replace(
        "elevator_servo_2: {kind: actuator, pe: tail_pe", "elevator_servo_2: {kind: actuator, pe: control_pe"
    )
    assert apart != text
    return loads(apart, "two_tails.dg.yaml")


@cache
def twin_wires() -> Spec:
    """Replicated buses, one of them behind a gateway."""
    return load(Path(__file__).parent / "twin_wires.dg.yaml")


@cache
def kept_state() -> Spec:
    """Two modules with a checkpoint, which may run on either of two PEs."""
    return load(Path("dg_specs/examples/kept_state.dg.yaml"))


def flying(
    spec: Spec,
    seed: int = 0,
    *,
    keep_trace: bool = False,
    decide_ns: int = DEFAULT_DECIDE_NS,
    planners: Planners = Planners.BEST,
    key: Key | None = None,
) -> Simulation:
    """A flight after its start, as soon as all is well."""
    simulation = Simulation(spec, seed, keep_trace=keep_trace, decide_ns=decide_ns, planners=planners, key=key)
    while not simulation.events_of(events.Reconfigured) or simulation.unsettled():
        simulation.run_for(50 * MS)
        assert simulation.now_ns < LONGEST_START_NS, simulation.unsettled()
    return simulation


def at_end_of(simulation: Simulation, frame: Sent, what: Callable[[], None]) -> None:
    """Call `what` at the end of a frame known from an equal flight, before any node has received the frame."""
    simulation.wiring.tap(frame.bus, lambda sent: what() if sent == frame else None)


def fail_receiver(simulation: Simulation, pe: str, duration_ns: int) -> None:
    """Let a running PE's receiver fail; the PE goes on sending."""
    node = simulation.fleet.running[pe]
    node.wire(receive_failed=True)
    simulation.at(simulation.now_ns + duration_ns, lambda: node.wire(receive_failed=False))


def placed_on(simulation: Simulation, pe: str) -> set[str]:
    """Modules that the last plan puts on a PE."""
    modules = simulation.events_of(events.PlanReady)[-1].plan.modules
    return {name for name, running in modules.items() if running.pe == pe}


def management_frames(trace: list[Sent], from_ns: int, to_ns: int) -> list[Sent]:
    """Commands, states and emergencies between two instants."""
    uses = {Use.MANAGEMENT, Use.STATE, Use.EMCY}
    return [sent for sent in trace if from_ns <= sent.end_ns <= to_ns and classify(sent.frame.can_id).use in uses]


def times_are_told(simulation: Simulation) -> None:
    """Every reconfiguration tells its four times, and none is negative."""
    for told in simulation.events_of(events.Reconfigured):
        assert min(told.times_ns.by_name().values()) >= 0, told
