"""The data traffic of a configuration: buses, bandwidth, and identifiers.

A *source* is a pair (producer, variable). A source is published on every bus of the routes to its consumers on other
PEs, once per bus, however many consumers there are (semantics rule 7). A `Hop` is a source on one of those buses.
Bandwidth is the worst-case number of bits of a frame times the rate, in thousandths of a bit/s, and exact.

A source has the same identifier on every bus. The best producer of a variable has the variable's standard identifier.
The other identifiers are allocated in the order of the producers' criticality. The criticality of a producer is the
best one of all functions that it could serve, in any phase and in any mode.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from heronry_dg.configuration import Configuration
from heronry_dg.field_types import CRITICALITIES
from heronry_dg.model import Function, Mode, Spec
from heronry_dg.situation import Survivors
from heronry_wire.canaerospace import HEADER_BYTES, DataType
from heronry_wire.identifiers import Source, allocate
from heronry_wire.timing import worst_bits


@dataclass(frozen=True, slots=True)
class Hop:
    """A source on one bus of its route, with the mode of its producer.

    `after` is the previous bus, None on the first bus.
    """

    producer: str
    variable: str
    mode: str
    bus: str
    after: str | None = None


def frame_bits(spec: Spec, variable: str) -> int:
    """Return the length in bits of a variable's longest data frame (11-bit identifier), with its intermission."""
    return worst_bits(HEADER_BYTES + DataType[spec.variables[variable].type].payload_bytes)


def source_mbit_per_s(spec: Spec, variable: str, mode: Mode) -> int:
    """Bandwidth that a variable takes on each bus if its producer runs in `mode`, in thousandths of a bit/s."""
    return frame_bits(spec, variable) * mode.rate_mhz


def hops(left: Survivors, configuration: Configuration) -> tuple[Hop, ...]:
    """Return the hops of every source, in order of first use; a wire without a route gives no hops."""
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
    """Return the bandwidth that the published sources take on each bus of the spec, in thousandths of a bit/s."""
    loads = dict.fromkeys(spec.buses, 0)
    for hop in published:
        mode = spec.modules[hop.producer].modes[hop.mode]
        loads[hop.bus] += source_mbit_per_s(spec, hop.variable, mode)
    return loads


def identifiers(spec: Spec) -> dict[tuple[str, str], int]:
    """Return the CAN identifier of every (producer, variable) of a spec; a smaller identifier has a higher priority.

    Raises WireError where the spec has more pairs than there are identifiers.
    """
    ranks = criticality_ranks(spec)
    return allocate(
        _identifier_source(spec, producer, variable, ranks[producer], order)
        for order, (producer, variable) in enumerate(spec.sources())
    )


def _identifier_source(spec: Spec, producer: str, variable: str, rank: int, order: int) -> Source:
    giving = [mode for mode in spec.modules[producer].modes.values() if variable in mode.gives]
    return Source(
        producer,
        variable,
        standard=spec.variables[variable].identifier,
        best_version=giving[0].gives[variable],
        criticality_rank=rank,
        rate_mhz=max(mode.rate_mhz for mode in giving),
        order=order,
    )


def criticality_ranks(spec: Spec) -> dict[str, int]:
    """Return for each module the best criticality, 0 (A) to 4 (E), of the functions to which it could contribute.

    All phases count, and all modes of the modules.
    """
    ranks = dict.fromkeys(spec.modules, len(CRITICALITIES) - 1)
    feeding = feeders(spec)
    for function in spec.functions.values():
        rank = best_rank(spec, function)
        for module in contributors(function.outputs, feeding):
            ranks[module] = min(ranks[module], rank)
    return ranks


def best_rank(spec: Spec, function: Function) -> int:
    """Best criticality, 0 (A) to 4 (E), of a function over the phases in which it is wanted.

    4 if the function is wanted in no phase.
    """
    phases: Sequence[str | None] = tuple(spec.phases) or (None,)
    wanted = [phase for phase in phases if function.priority_in(phase) > 0]
    return min((CRITICALITIES.index(function.criticality_in(phase)) for phase in wanted), default=4)


def feeders(spec: Spec) -> dict[str, set[str]]:
    """Find for each module the modules whose data it could read."""
    givers: dict[tuple[str, int], list[str]] = {}
    for module in spec.modules.values():
        for mode in module.modes.values():
            for datum in mode.gives.items():
                givers.setdefault(datum, []).append(module.name)
    return {
        module.name: {
            giver
            for mode in module.modes.values()
            for _, leaf in mode.leaves()
            for version in range(leaf.best, leaf.worst + 1)
            for giver in givers.get((leaf.variable, version), ())
        }
        for module in spec.modules.values()
    }


def contributors(outputs: Iterable[str], feeding: Mapping[str, set[str]]) -> set[str]:
    """Find these output modules, and the modules whose data could reach one of them.

    feeding: module -> the modules whose data it could read (`feeders`).
    """
    found, frontier = set[str](), list(outputs)
    while frontier:
        name = frontier.pop()
        if name not in found:
            found.add(name)
            frontier.extend(feeding[name])
    return found
