"""The component graph of a plan: its modules, their devices, the physical world, and how all are wired.

    leaf M            each running module. Ports: `V` for each variable that its mode gives, with the
                      bandwidth of the variable (frame bits times rate) as weight; `V:PATH` for each input
                      of its mode, wired or not; `device:` if it has a device; `none` if it has none of
                      these. Image `IMAGE:MODE@PE`
    leaf device:D     each device of a running module: ports `module` and `world`
    leaf plant:P      each plant: ports `device:D` for each device that moves or sees it, `to:Q` for each
                      plant that it affects, `from:Q` for each plant that affects it; `none` if it has none
                      of these
    composite pe:P    the modules and devices on a PE
    composite side:P  the modules, the devices and the composites pe:* of a side. A side is a set of PEs
                      that wired buses join; P is the first PE of the side in the spec

Empty composites are left out, and plants are in no composite. Edges follow wires. They also lead from a
sensor to its module and from a module to its actuator, from an actuator to the plants that it moves, and
from a plant to the sensors that see it and to the plants that it affects. A device that no running module
uses has no leaf. The field `side` of a device's leaf is the side of its PE. A module's leaf has a side only
if all PEs that may run the module are on one side; then the field `side` is that side.
"""

from collections.abc import Iterable, Iterator, Mapping

from heronry_dg.configuration import Configuration
from heronry_dg.model import Mode, Module, Plant, Spec
from heronry_dg.situation import hosts_when_all_is_up
from heronry_dg.traffic import source_mbit_per_s
from heronry_pcs.graph import Edge, Graph, Leaf, Part, inside

DEVICE_PORT = "device:"
NO_PORT = "none"


def plan_graph(spec: Spec, configuration: Configuration) -> Graph:
    """Derive the graph of a configuration; every name in it must exist in the spec."""
    sides = sides_of(spec)
    modules = {name: module_leaf(spec, name, one.mode, one.pe, sides) for name, one in configuration.modules.items()}
    used = {spec.modules[name].device for name in modules}
    devices = [device for device in spec.devices.values() if device.name in used]
    leaves = {
        **modules,
        **{f"device:{one.name}": _device_leaf(f"device:{one.name}", f"side:{sides[one.pe]}") for one in devices},
        **{f"plant:{plant.name}": _plant_leaf(spec, plant) for plant in spec.plants.values()},
    }
    vertices = frozenset(vertex for leaf in leaves.values() for vertex in leaf.vertices())
    edges = frozenset((*wire_edges(configuration), *_device_edges(spec, modules), *_plant_edges(spec, leaves)))
    on_pe = {pe: [name for name, one in configuration.modules.items() if one.pe == pe] for pe in spec.pes}
    for device in devices:
        on_pe[device.pe].append(f"device:{device.name}")
    composites = dict(_composites(on_pe, sides, leaves, edges))
    return Graph(spec.name, leaves, composites, Part(vertices, edges, frozenset((*leaves, *composites))))


def sides_of(spec: Spec) -> dict[str, str]:
    """Return for each PE the name of its side: the PE of this side that comes first in the spec.

    A *side* is a largest set of PEs that are joined by wired buses.
    """
    first: dict[str, str] = {}
    for name in spec.pes:
        if name not in first:
            first.update(dict.fromkeys(_joined(spec, name), name))
    return first


def _joined(spec: Spec, pe: str) -> set[str]:
    found, waiting = {pe}, [pe]
    while waiting:
        buses = {bus for bus in spec.pes[waiting.pop()].buses if spec.buses[bus].kind == "wired"}
        new = {other.name for other in spec.pes.values() if not buses.isdisjoint(other.buses)} - found
        found |= new
        waiting += new
    return found


def managers_side(spec: Spec) -> str | None:
    """Return the side of the PEs on the manager's bus as `side:P`; P is the first PE of this side (`sides_of`).

    Returns None if no PE is on that bus.
    """
    sides = sides_of(spec)
    return next((f"side:{sides[pe.name]}" for pe in spec.pes.values() if spec.manager.bus in pe.buses), None)


def module_leaf(spec: Spec, name: str, mode: str, pe: str, sides: Mapping[str, str]) -> Leaf:
    """The leaf of a module that runs in a mode on a PE."""
    module = spec.modules[name]
    ports = dict(_module_ports(spec, module, module.modes[mode]))
    on = {sides[host] for host in hosts_when_all_is_up(spec, module)}
    return Leaf(
        name=name,
        ports=ports or {NO_PORT: 0},
        image=image_of(module, mode, pe),
        side=f"side:{on.pop()}" if len(on) == 1 else None,
    )


def image_of(module: Module, mode: str, pe: str) -> str:
    """Return the text `IMAGE:MODE@PE` of a module that runs in a mode on a PE."""
    return f"{module.image}:{mode}@{pe}"


def _module_ports(spec: Spec, module: Module, mode: Mode) -> Iterator[tuple[str, int]]:
    for variable in mode.gives:
        yield variable, source_mbit_per_s(spec, variable, mode)
    for path, leaf in mode.leaves():
        yield f"{leaf.variable}:{path}", 0
    if module.device is not None:
        yield DEVICE_PORT, 0


def _device_leaf(name: str, side: str) -> Leaf:
    return Leaf(name, {"module": 0, "world": 0}, name, side=side)


def _plant_leaf(spec: Spec, plant: Plant) -> Leaf:
    name = f"plant:{plant.name}"
    ports = [
        *(f"device:{device}" for device in (*plant.moved_by, *plant.seen_by)),
        *(f"to:{other}" for other in plant.affects),
        *(f"from:{other.name}" for other in spec.plants.values() if plant.name in other.affects),
    ]
    return Leaf(name, dict.fromkeys(ports or [NO_PORT], 0), name, plant=True)


def wire_edges(configuration: Configuration) -> Iterator[Edge]:
    """Edges of the wires of a configuration."""
    for consumer, path, wire in configuration.wires():
        yield f"{wire.producer}.{wire.variable}", f"{consumer}.{wire.variable}:{path}"


def _device_edges(spec: Spec, modules: Iterable[str]) -> Iterator[Edge]:
    for name in modules:
        device = spec.modules[name].device
        if device is not None:
            edge = f"device:{device}.module", f"{name}.{DEVICE_PORT}"
            yield edge if spec.devices[device].kind == "sensor" else edge[::-1]


def _plant_edges(spec: Spec, leaves: Mapping[str, Leaf]) -> Iterator[Edge]:
    for plant in spec.plants.values():
        here = f"plant:{plant.name}"
        for actuator in plant.moved_by:
            if f"device:{actuator}" in leaves:
                yield f"device:{actuator}.world", f"{here}.device:{actuator}"
        for sensor in plant.seen_by:
            if f"device:{sensor}" in leaves:
                yield f"{here}.device:{sensor}", f"device:{sensor}.world"
        for other in plant.affects:
            yield f"{here}.to:{other}", f"plant:{other}.from:{plant.name}"


def _composites(
    on_pe: Mapping[str, list[str]], sides: Mapping[str, str], leaves: Mapping[str, Leaf], edges: frozenset[Edge]
) -> Iterator[tuple[str, Part]]:
    """Yield name and content of the composite of each side, and then of each PE.

    A PE without modules and devices gets no composite. A side that has only such PEs gets none either.

    on_pe: by PE, the leaves of its modules and devices. sides: by PE, the first PE of its side.
    """
    for side in dict.fromkeys(sides.values()):
        pes = [pe for pe in on_pe if sides[pe] == side and on_pe[pe]]
        if pes:
            here = [*(name for pe in pes for name in on_pe[pe]), *(f"pe:{pe}" for pe in pes)]
            yield f"side:{side}", _composite(here, leaves, edges)
    for pe, names in on_pe.items():
        if names:
            yield f"pe:{pe}", _composite(names, leaves, edges)


def _composite(names: list[str], leaves: Mapping[str, Leaf], edges: frozenset[Edge]) -> Part:
    vertices = frozenset(vertex for name in names if name in leaves for vertex in leaves[name].vertices())
    return Part(vertices, inside(edges, vertices), frozenset(names))


def level_view(graph: Graph, level: str) -> frozenset[str]:
    """Return a view of a plan's graph: its plants, and its composites of one level.

    level: `pe` for the composites `pe:P`, `side` for the composites `side:P`.
    """
    plants = {name for name, leaf in graph.leaves.items() if leaf.plant}
    return frozenset(plants | {name for name in graph.composites if name.startswith(f"{level}:")})
