"""Routes between PEs, the elements on the manager's route to each PE, and the bus load of each variable."""

from dataclasses import dataclass

from heronry_dg.checkpoints import frames_mbit_per_s
from heronry_dg.situation import Situation, hosts_when_all_is_up, survivors
from heronry_dg.traffic import frame_bits
from heronry_manager.planner.greedy.numbering import Numbering


@dataclass(frozen=True, slots=True)
class Routes:
    """Routes between PEs, and the load that each variable puts on a bus.

    way: for each PE, the PEs and buses on the route from the manager to this PE. The set is an integer, with one
        bit for each element: PEs from bit 0 on, buses from bit `first_bus` on. If there is no such route, the
        integer is `never`, in which only the first bit after those of all buses is set.
    """

    route: list[list[tuple[int, ...]]]  # from one PE to another one: the buses between them
    way: list[int]  # by PE
    first_bus: int
    never: int
    bits: list[int]  # by variable: bits of a frame
    load: list[dict[int, int]]  # by variable: mode -> thousandths of a bit/s
    kept: dict[int, tuple[int, int]]  # module with a checkpoint -> thousandths of a bit/s, set of its possible PEs
    wired: frozenset[int]  # buses


def routed(numbers: Numbering) -> Routes:
    """Compute the routes; they never depend on faults, because the buses form a forest."""
    spec, pes = numbers.spec, numbers.pes
    healthy = survivors(spec, Situation())
    first_bus = len(pes)
    never = 1 << (first_bus + len(numbers.buses))
    bits = [frame_bits(spec, variable) for variable in numbers.variables]
    return Routes(
        route=[
            [tuple(numbers.bus_number[bus] for bus in healthy.route(one.name, other.name) or ()) for other in pes]
            for one in pes
        ],
        way=_ways(numbers, first_bus, never),
        first_bus=first_bus,
        never=never,
        bits=bits,
        load=[
            {number: of_one * mode.rate_mhz for number, (_, mode) in enumerate(numbers.modes) if name in mode.gives}
            for name, of_one in zip(numbers.variables, bits, strict=True)
        ],
        kept={
            number: (
                frames_mbit_per_s(module.checkpoint),
                sum(1 << numbers.pe_number[pe] for pe in hosts_when_all_is_up(spec, module)),
            )
            for number, module in enumerate(numbers.modules)
            if module.checkpoint is not None
        },
        wired=frozenset(number for number, bus in enumerate(numbers.buses) if bus.kind == "wired"),
    )


def _ways(numbers: Numbering, first_bus: int, never: int) -> list[int]:
    ways = [never] * len(numbers.pes)
    frontier = [(numbers.spec.manager.bus, 0)]
    seen = {numbers.spec.manager.bus}
    while frontier:
        bus, so_far = frontier.pop()
        so_far |= 1 << (first_bus + numbers.bus_number[bus])
        for number, pe in enumerate(numbers.pes):
            if bus in pe.buses and ways[number] == never:
                ways[number] = so_far | 1 << number
                further = [other for other in pe.buses if other not in seen]
                seen.update(further)
                frontier.extend((other, ways[number]) for other in further)
    return ways
