"""A flight of big_blue in the simulator, as the events of its manager, with the loads of its buses."""

from functools import cache

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_manager.core.vocabulary import EnterPhase
from heronry_manager.events import BusSeen, Event
from heronry_tools.sim.flight.simulation import Simulation
from heronry_wire.frame import LoggedFrame

S = 1_000_000_000


@cache
def big_blue() -> Spec:
    return load(shipped_spec_path("big_blue"))


def flown() -> tuple[Event, ...]:
    """The flight computer dies and comes back, then a phase begins, and the navigation computer dies."""
    return _flown()[0]


def flown_frames() -> tuple[LoggedFrame, ...]:
    """The frames of that flight, on all buses."""
    return _flown()[1]


@cache
def _flown() -> tuple[tuple[Event, ...], tuple[LoggedFrame, ...]]:
    flight = Simulation(big_blue(), 41, keep_trace=True)
    flight.run_until(2 * S)
    flight.fleet.kill("flight")
    flight.run_for(1 * S)
    flight.fleet.arrive("flight")
    flight.run_for(5 * S)
    flight.operator.say(EnterPhase("glide"))
    flight.run_for(1 * S)
    flight.fleet.kill("nav")
    flight.run_for(2 * S)
    loads = [load_line(second) for second in range(1, flight.now_ns // S)]
    frames = tuple(LoggedFrame(sent.end_ns, sent.bus, sent.frame) for sent in flight.trace)
    return tuple(sorted([*flight.events, *loads], key=lambda event: event.t_ns)), frames


def load_line(second: int) -> BusSeen:
    """What a listener tells of the manager's bus after a second."""
    share = 0.2 + 0.01 * (second % 7)
    bits = {"data": round(share * 800_000), "heartbeat": 20_000, "management": 30_000}
    return BusSeen(second * S, "can0", share, share + 0.1, bits, 900 + second, errors=0, error_state="active")


@cache
def three_lost() -> tuple[Event, ...]:
    """In the glide the navigation, air data and flight computers die, one after the other."""
    flight = Simulation(big_blue(), 41)
    flight.run_until(2 * S)
    flight.operator.say(EnterPhase("glide"))
    for pe in ("nav", "air", "flight"):
        flight.run_for(1 * S)
        flight.fleet.kill(pe)
    flight.run_for(2 * S)
    return tuple(flight.events)
