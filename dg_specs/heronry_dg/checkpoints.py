"""What the checkpoints of a spec cost: frames, bandwidth, and how late a state may arrive.

A module with `checkpoint` sends its state `hz` times a second to the other PEs on which it may run (semantics rule 7,
protocol rule 10). So it takes bandwidth on every wired bus of the routes to those of them that are up. A bus that
several routes use carries each frame once. Checkpoints have the lowest priorities on the bus: response times of data do
not depend on them, apart from one frame that has just started, which is counted anyway (semantics rule 9).

*How late.* The sender hands over one frame of a round each GAP, and begins a new round instead of a late rest. The time
from `save` to the arrival of the last frame is bounded for every legal configuration, so the table of a PE can tell it:

- The last frame is handed over `(frames - 1) x gap` after `save`, at the latest one period after it.
- All that is sent takes at most `max_load` of a bus (rules 7 and 9, and the reserve). So after a time t a bus has sent
  at least `(1 - max_load) x t` bits beyond what regular messages need, apart from one frame of each of them that waits
  at the beginning, and from the rounds of the checkpoints. When these bits are sent, the last frame has arrived.

A PE and a gateway drop a frame whose transmission has not begun by then (`wait_ns`). So the bound also holds on an
overloaded bus: there no round becomes whole.

On a route over several buses the second part counts for each bus. A state does not cross a radio.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import ceil

from heronry_dg.configuration import Configuration
from heronry_dg.model import Bus, Module, Spec
from heronry_dg.model.software import Checkpoint
from heronry_dg.situation import Survivors, hosts_when_all_is_up
from heronry_wire.checkpoint_frames import frame_count
from heronry_wire.timing import WORST_BLOCKING_BITS

GAP_NS = 1_000_000
"""Longest time in ns between two frames of a round."""

_NS_PER_S = 1_000_000_000
_FRAMES_OF_A_PE = 4  # state, CANopen heartbeat, output echo, report on a radio
_COMMANDS = 2  # LEASE, ALIVE


def numbers(spec: Spec) -> dict[str, int]:
    """Return the number of each module with a checkpoint, which its frames carry: from 0, in the spec's order."""
    return {name: number for number, name in enumerate(kept_modules(spec))}


def kept_modules(spec: Spec) -> Iterator[str]:
    """Yield the modules with a checkpoint, in the spec's order."""
    yield from (module.name for module in spec.modules.values() if module.checkpoint is not None)


def frames_mbit_per_s(checkpoint: Checkpoint) -> int:
    """Return the bandwidth of a checkpoint on each bus that carries it, in thousandths of a bit/s."""
    return frame_count(checkpoint.data_bytes) * WORST_BLOCKING_BITS * checkpoint.rate_mhz


def period_ns(checkpoint: Checkpoint) -> int:
    """Return the time in ns from one round to the next."""
    return 1000 * _NS_PER_S // checkpoint.rate_mhz


def gap_ns(checkpoint: Checkpoint) -> int:
    """Return the time in ns from one frame of a round to the next: GAP_NS, or less if a round would last too long."""
    return min(GAP_NS, period_ns(checkpoint) // frame_count(checkpoint.data_bytes))


def carriers(left: Survivors, module: Module, pe: str) -> tuple[str, ...]:
    """Return the buses that carry the checkpoints of a module that runs on `pe`, in the spec's order.

    These are the wired buses of the routes to the other possible PEs of the module that are up.
    """
    if module.checkpoint is None:
        return ()
    reached = {
        bus
        for other in hosts_when_all_is_up(left.spec, module)
        if other != pe and other in left.pe_cpu_millis
        for bus in left.route(pe, other) or ()
    }
    return tuple(bus.name for bus in left.spec.buses.values() if bus.name in reached and bus.kind == "wired")


@dataclass(frozen=True, slots=True)
class Carried:
    """The checkpoints of a running module on one bus."""

    module: str
    pe: str
    bus: str
    mbit_per_s: int


def carried(left: Survivors, configuration: Configuration) -> Iterator[Carried]:
    """Yield what the checkpoints of the running modules take, bus by bus; every name must exist in the spec."""
    for name, running in configuration.modules.items():
        module = left.spec.modules[name]
        if module.checkpoint is not None:
            load = frames_mbit_per_s(module.checkpoint)
            yield from (Carried(name, running.pe, bus, load) for bus in carriers(left, module, running.pe))


def loads_mbit_per_s(left: Survivors, configuration: Configuration) -> dict[str, int]:
    """Return what checkpoints take of each bus that carries any, in thousandths of a bit/s."""
    loads: dict[str, int] = {}
    for one in carried(left, configuration):
        loads[one.bus] = loads.get(one.bus, 0) + one.mbit_per_s
    return loads


def late_ns(spec: Spec, checkpoint: Checkpoint, route: Iterable[str]) -> int | None:
    """Return the longest time in ns from `save` to the arrival of the last frame over the buses of `route`.

    None: there is no bound, because a bus of the route is a radio, or its `max_load` is 1.
    """
    total = min((frame_count(checkpoint.data_bytes) - 1) * gap_ns(checkpoint), period_ns(checkpoint))
    for bus in route:
        busy_ns = _backlog_ns(spec, spec.buses[bus])
        if busy_ns is None:
            return None
        total += busy_ns
    return total


def wait_ns(spec: Spec, bus: Bus) -> int:
    """Return how long a frame of a checkpoint may wait for a bus; 0: there is no bound."""
    backlog_ns = _backlog_ns(spec, bus)
    return 0 if backlog_ns is None else backlog_ns - ceil(Fraction(WORST_BLOCKING_BITS * _NS_PER_S, bus.bitrate))


def _backlog_ns(spec: Spec, bus: Bus) -> int | None:
    """Return the time in ns in which a bus has sent whatever may wait at one moment; None: no bound is known."""
    spare = bus.bitrate * (1 - bus.max_load)
    if bus.kind != "wired" or spare <= 0:
        return None
    sources = sum(
        len({variable for mode in m.modes.values() for variable in mode.gives}) for m in spec.modules.values()
    )
    rounds = sum(frame_count(m.checkpoint.data_bytes) for m in spec.modules.values() if m.checkpoint is not None)
    frames = sources + rounds + len(bus.foreign) + _COMMANDS + _FRAMES_OF_A_PE * len(spec.pes) + 1
    longest = max([WORST_BLOCKING_BITS, *(one.bits for one in bus.foreign)])
    return ceil(Fraction(frames * longest * _NS_PER_S) / spare)
