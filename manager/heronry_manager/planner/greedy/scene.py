"""The scene: the part of a spec that a situation leaves, in the integers of `Tables`.

A scene has the same facts as `heronry_dg.situation.survivors` and `planner.candidates`. To work out a scene takes less
than a tenth of the time of these two: `Scenery` starts from the scene without faults, and only works out the
consequences of the down elements. The buses form a forest, so between two PEs that the manager can command there is
always the same route. So no route depends on faults.

A mode is *possible* if three conditions are met:

- Its module works.
- A PE that could run the module in this mode is up.
- The needs of the mode could hold if every other possible mode ran.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from heronry_dg.situation import Situation, room_mbit_per_s
from heronry_manager.planner.greedy.leaves import LEAF, Node
from heronry_manager.planner.greedy.numbering import element_numbers
from heronry_manager.planner.greedy.orders import Orders
from heronry_manager.planner.greedy.tables import Tables

_NOTHING: Mapping[int, list[tuple[tuple[int, int], ...]]] = {}


@dataclass(frozen=True, slots=True)
class Scene:
    """What faults leave of a spec: the PEs, capacities and modes that can be used in one situation."""

    pes: int  # set of PEs that are up and can be commanded
    hosts: list[int]  # by mode: set of PEs, up or down, that could run it; without places that are down
    cpu: list[int]  # by PE, thousandths
    bus_room: list[int]  # by bus: thousandths of a bit/s for data
    possible: int  # set of modes
    kept: Mapping[int, list[tuple[tuple[int, int], ...]]]  # module -> by PE: what its checkpoints take of which buses


class Scenery:
    """Works out the scene of any situation of one spec: the PEs, capacities and modes that can be used in it."""

    def __init__(self, tables: Tables) -> None:
        """Compute the scene without faults; `scene` derives the scene of every situation from it."""
        self._tables = tables
        self._elements = element_numbers(tables.numbers)
        self._cpu = tables.sizes.pe_cpu
        self._buses = tables.numbers.buses
        self._bus_room = [room_mbit_per_s(bus) for bus in self._buses]
        self._modules_of_device = [
            sum(1 << tables.numbers.module_number[m.name] for m in tables.numbers.modules if m.device == device)
            for device in tables.numbers.spec.devices
        ]
        self._modes_of_module = [sum(1 << mode for mode in modes) for modes in tables.numbers.modes_of]
        self._pes = sum(1 << number for number, way in enumerate(tables.routes.way) if way != tables.routes.never)
        placeable = sum(1 << mode for mode, hosts in enumerate(tables.sizes.hosts) if hosts & self._pes)
        self._possible = self._shrunk(placeable, placeable)

    def scene(self, now: Situation) -> Scene:
        """Return the scene of a situation: what can be used in it."""
        tables = self._tables
        down, modules = self._down(now)
        pes, hosts = self._pes, self._hosts(now)
        if down:
            pes = sum(1 << number for number, way in enumerate(tables.routes.way) if not way & down)
        cpu, bus_room = self._cpu, self._bus_room
        if now.limits:
            cpu, bus_room = self._limited(now.limits)
        gone = 0
        for number, modes in enumerate(self._modes_of_module):
            if modules >> number & 1:
                gone |= modes
        if pes != self._pes or now.limits or hosts is not tables.sizes.hosts:
            gone |= self._homeless(hosts, pes, cpu, limited=bool(now.limits))
        kept = self._kept(pes) if tables.routes.kept else _NOTHING
        return Scene(pes, hosts, cpu, bus_room, self._without(gone & self._possible), kept)

    def _kept(self, pes: int) -> dict[int, list[tuple[tuple[int, int], ...]]]:
        """Return what the checkpoints of each module take if it runs on a PE, while the PEs in the set `pes` are up.

        The result has, by module and PE, (bus, thousandths of a bit/s) of each bus that carries these checkpoints.
        """
        routes = self._tables.routes
        kept: dict[int, list[tuple[tuple[int, int], ...]]] = {}
        for module, (load, homes) in routes.kept.items():
            others = [number for number in range(len(self._cpu)) if (homes & pes) >> number & 1]
            reached = [{bus for other in others for bus in way[other]} for way in routes.route]  # by PE
            kept[module] = [tuple((bus, load) for bus in sorted(routes.wired & buses)) for buses in reached]
        return kept

    def _hosts(self, now: Situation) -> list[int]:
        """Return, for each mode, the set of PEs that could run the mode, as the bits of an integer.

        A PE is left out of the set if the place of the module on that PE is down.
        """
        hosts, pes = self._tables.sizes.hosts, len(self._cpu)
        lost = [number for kind, number in map(self._elements.__getitem__, now.down) if kind == "place"]
        if lost:
            hosts = hosts.copy()
        for module, pe in (divmod(number, pes) for number in lost):
            for mode in self._tables.numbers.modes_of[module]:
                hosts[mode] &= ~(1 << pe)
        return hosts

    def _down(self, now: Situation) -> tuple[int, int]:
        """Return two sets as bits: the PEs and buses that are down, and the modules that cannot run.

        PEs and buses are numbered as in `Routes.way`. A module cannot run if it or its device is down.
        """
        tables, down, modules = self._tables, self._tables.routes.never, 0
        channels: dict[int, int] = {}
        for element in now.down:
            kind, number = self._elements[element]
            match kind:
                case "pe":
                    down |= 1 << number
                case "bus":
                    down |= 1 << (tables.routes.first_bus + number)
                case "module":
                    modules |= 1 << number
                case "device":
                    modules |= self._modules_of_device[number]
                case "channel":
                    channels[number] = channels.get(number, 0) + 1
        for bus, lost in channels.items():
            if lost == tables.numbers.buses[bus].channels:
                down |= 1 << (tables.routes.first_bus + bus)
        return down, modules

    def _limited(self, limits: Mapping[str, Fraction]) -> tuple[list[int], list[int]]:
        cpu, bus_room = list(self._cpu), list(self._bus_room)
        for element, share in limits.items():
            kind, number = self._elements[element]
            if kind == "pe":
                cpu[number] = int(cpu[number] * share)
            else:
                bus_room[number] = room_mbit_per_s(self._buses[number], share)
        return cpu, bus_room

    def _homeless(self, hosts: list[int], pes: int, cpu: list[int], *, limited: bool) -> int:
        """Return the set of modes that no PE could run.

        hosts: by mode, the set of PEs that could run the mode if they are up.
        pes: the set of PEs that are up.
        cpu: by PE, the usable CPU in thousandths of the reference core.
        limited: False: no CPU is limited, so `cpu` need not be checked.
        """
        tables, homeless = self._tables, 0
        for mode, carriers in enumerate(hosts):
            left = carriers & pes
            if not left or (
                limited and not any(left >> pe & 1 and tables.sizes.cpu[mode] <= room for pe, room in enumerate(cpu))
            ):
                homeless |= 1 << mode
        return homeless

    def _without(self, gone: int) -> int:
        """Return the modes that can still run if the modes in `gone` cannot.

        Both are sets of modes, as the bits of an integer.
        """
        readers, possible = self._tables.orders.readers, self._possible & ~gone
        touched = 0
        while gone:
            low = gone & -gone
            gone ^= low
            touched |= readers[low.bit_length() - 1]
        return self._shrunk(possible, touched & possible)

    def _shrunk(self, possible: int, touched: int) -> int:
        """Return `possible` without the modes whose needs cannot be met by the modes that are left.

        possible: a set of modes, as the bits of an integer. touched: the modes to check first, likewise.
        """
        orders = self._tables.orders
        while touched:
            low = touched & -touched
            touched ^= low
            mode = low.bit_length() - 1
            node = orders.needs[mode]
            if node is not None and not _attainable(orders, node, possible):
                possible ^= low
                touched = (touched | orders.readers[mode]) & possible
        return possible


def _attainable(orders: Orders, node: Node, possible: int) -> bool:
    most, number, inputs, _ = node
    if most == LEAF:
        return orders.givers[number] & possible != 0
    if number == len(inputs):
        return all(_attainable(orders, one, possible) for one in inputs)
    return number == 0 or sum(_attainable(orders, one, possible) for one in inputs) >= number
