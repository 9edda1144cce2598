"""Two views that do not fit on the bus together: one must have gone before the other comes, whatever a PE misses.

Nothing exclusive moves here, so without a look at the buses the first ACTIVATE would carry GO_ALL. Verified is what was
on the bus.
"""

from collections.abc import Callable
from functools import cache

import pytest

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.traffic import identifiers
from heronry_dg.transition import Transitions
from heronry_manager import events
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.identifiers import FIRST_MANAGER, Command, management_id
from heronry_wire.management import Activate, Step, decode_command
from heronry_wire.timing import exact_bits
from scenarios.flights import MS, at_end_of, fail_receiver, flying

SWAP = """
dg: 1
name: swap
buses: {can0: {bitrate: 100000, heartbeat_ms: 50}}
pes:
  left:  {node_id: 92, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  right: {node_id: 93, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  sink:  {node_id: 94, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
  key:   {node_id: 95, buses: [can0], cpu: 0.5, ram: 32KiB, flash: 64KiB}
variables:
  view_left: {type: FLOAT, deadline_ms: 100}
  view_right: {type: FLOAT, deadline_ms: 100}
  unlocked: {type: UCHAR}
modules:
  look_left:  {image: "scenarios.looking:LooksLeft", runs_on: [left], gives: {view_left: 1},
               cpu: 0.1, ram: 1KiB, rate_hz: 300}
  look_right: {image: "scenarios.looking:LooksRight", runs_on: [right], gives: {view_right: 1},
               cpu: 0.1, ram: 1KiB, rate_hz: 300}
  unlock: {image: "scenarios.looking:Unlocks", runs_on: [key], gives: {unlocked: 1}, cpu: 0.1, ram: 1KiB, rate_hz: 10}
  show_left: {image: "scenarios.looking:Shows", runs_on: [sink], needs: {and: [view_left, unlocked]},
              cpu: 0.1, ram: 1KiB, rate_hz: 10}
  show_right: {image: "scenarios.looking:Shows", runs_on: [sink], needs: view_right, cpu: 0.1, ram: 1KiB, rate_hz: 10}
functions:
  left:  {output: show_left, criticality: A, priority: 100}
  right: {output: show_right, criticality: B, priority: 50}
"""
WINDOW_NS = 40 * MS
MOST_BITS = 70_000 * WINDOW_NS // 1_000_000_000 + 135  # what may be published in a window, and one frame at its edge


@cache
def swap() -> Spec:
    return loads(SWAP, "swap.dg.yaml")


def flown(disturb: Callable[[Simulation], None] = lambda _: None) -> Simulation:
    """The left view is shown until its key is lost; then the right one is."""
    simulation = flying(swap(), keep_trace=True)
    disturb(simulation)
    simulation.fleet.kill("key")
    simulation.run_for(1_000 * MS)
    return simulation


def views(simulation: Simulation, producer: str, variable: str) -> list[int]:
    """When each frame of a view ended."""
    identifier = identifiers(swap())[producer, variable]
    return [sent.end_ns for sent in simulation.trace if sent.frame.can_id == identifier]


def activations(simulation: Simulation) -> list[tuple[Sent, Step]]:
    """Every ACTIVATE since the key was lost, and its step."""
    lost_ns = simulation.events_of(events.PeLost)[-1].t_ns
    found = []
    for sent in simulation.trace:
        if sent.frame.can_id == management_id(FIRST_MANAGER, Command.ACTIVATE) and sent.end_ns > lost_ns:
            message = decode_command(Command.ACTIVATE, sent.frame.data)
            assert isinstance(message, Activate)
            found.append((sent, message.step))
    return found


def most_data_bits(simulation: Simulation) -> int:
    """The most bits of views that ended within any 40 ms."""
    wanted = {identifiers(swap())[one] for one in (("look_left", "view_left"), ("look_right", "view_right"))}
    frames = [(s.end_ns, exact_bits(s.frame)) for s in simulation.trace if s.frame.can_id in wanted]
    return max(
        sum(bits for end_ns, bits in frames if start_ns <= end_ns < start_ns + WINDOW_NS) for start_ns, _ in frames
    )


def test_the_left_view_has_gone_when_the_right_one_comes() -> None:
    simulation = flown()
    assert [step for _, step in activations(simulation)] == [Step.BREAK, Step.GO_ALL]
    waited = [told.waiting_for for told in simulation.events_of(events.EpochStep) if told.step == "BREAK"]
    assert waited == [("left",)]
    assert views(simulation, "look_left", "view_left")[-1] < views(simulation, "look_right", "view_right")[0]
    assert simulation.settle() == []


def receive_failed_from(frame: Sent, pe: str) -> Callable[[Simulation], None]:
    """Let a PE miss this frame, and all others for two heartbeat periods."""
    return lambda flight: at_end_of(flight, frame, lambda: fail_receiver(flight, pe, 100 * MS))


@pytest.mark.parametrize("number", [0, 1], ids=["BREAK", "GO_ALL"])
@pytest.mark.parametrize("pe", ["left", "right", "sink"])
def test_the_bus_never_carries_both_whichever_pe_misses_a_step(number: int, pe: str) -> None:
    frame, _ = activations(flown())[number]
    simulation = flown(receive_failed_from(frame, pe))
    assert views(simulation, "look_left", "view_left")[-1] < views(simulation, "look_right", "view_right")[0]
    assert most_data_bits(simulation) <= MOST_BITS
    assert simulation.settle() == []


def test_without_a_look_at_the_buses_it_would_carry_both(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Transitions, "must_break", lambda _self, _may_run, _after, _now, exclusive: exclusive)
    ((frame, step),) = activations(flown())
    assert step is Step.GO_ALL
    (violation,) = flown().broken()
    assert violation.rule == "transition"
    assert violation.story.startswith("from epoch 1 to 2: rule t.bus, bus can0: it carries up to 81000")
    simulation = flown(receive_failed_from(frame, "left"))
    assert views(simulation, "look_left", "view_left")[-1] > views(simulation, "look_right", "view_right")[10]
    assert most_data_bits(simulation) > MOST_BITS
