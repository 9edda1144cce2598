"""What a configuration sends: on which buses, how many bits, under which identifiers, and how late it can arrive.

A *source* is a (producer, variable). It is published on every bus of the route to each of its consumers on another
PE, once however many consume it (semantics.md rule 7). A `Hop` is a source on one of those buses.

Bandwidth is worst-case frame bits times rate, in thousandths of a bit/s, and exact.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from heronry_dg.configuration import Configuration
from heronry_dg.model import Mode, Spec
from heronry_dg.situation import Survivors
from heronry_wire.canaerospace import HEADER_BYTES, DataType


@dataclass(frozen=True, slots=True)
class Hop:
    """A source, in the mode its producer runs in, on one bus of its way; `after` is the bus it comes from.

    The first bus of a route has no `after`.
    """

    producer: str
    variable: str
    mode: str
    bus: str
    after: str | None = None


def frame_bits(spec: Spec, variable: str) -> int:
    """Worst-case bits of a variable's data frame (11-bit identifier), with stuff bits and the space between frames."""
    return 55 + 10 * (HEADER_BYTES + DataType[spec.variables[variable].type].payload_bytes)


def source_mbit_per_s(spec: Spec, variable: str, mode: Mode) -> int:
    """Bandwidth that a variable takes on each bus when its producer runs in `mode`, in thousandths of a bit/s."""
    return frame_bits(spec, variable) * mode.rate_mhz


def hops(left: Survivors, configuration: Configuration) -> tuple[Hop, ...]:
    """Every source on every bus it is published on, in order of first use; a wire without a route has none."""
    found: dict[Hop, None] = {}
    for consumer, _, wire in configuration.wires():
        producer = configuration.modules.get(wire.producer)
        if producer is None:
            continue
        route = left.route(producer.pe, configuration.modules[consumer].pe) or ()
        for after, bus in zip((None, *route), route, strict=False):
            found[Hop(wire.producer, wire.variable, producer.mode, bus, after)] = None
    return tuple(found)


def bus_loads_mbit_per_s(spec: Spec, published: Iterable[Hop]) -> dict[str, int]:
    """Add up what is published on each bus of the spec, in thousandths of a bit/s."""
    loads = dict.fromkeys(spec.buses, 0)
    for hop in published:
        mode = spec.modules[hop.producer].modes[hop.mode]
        loads[hop.bus] += source_mbit_per_s(spec, hop.variable, mode)
    return loads
