"""Situations: which elements are down or limited, and what they leave of the system.

An element is written `kind:name`: `pe:nav`, `device:gps`, `module:autopilot`, `bus:radio`, `channel:can0.1` (channels
are numbered from 1). A *place* is an element, too: `module:autopilot@nav` is down when the module cannot run on that
PE, because the module's code is not there or the module has failed there. A module with two or more possible PEs has a
place for each of them; `module:autopilot` stands for all these places together.

A `Situation` has the faults, limits, phase and changed priorities. `Survivors` has what a situation leaves of the
system. The devices of a PE that is down are out of use, and so are routes over that PE. A PE without a route to the
manager's bus cannot be commanded and counts as down. If the manager's own bus is down, nothing is left.

A changed priority replaces the spec's priority in every phase in which the function is wanted. A changed priority of 0
makes the function unwanted. In a phase that does not want the function, a changed priority has no effect.

Because the buses form a forest over the PEs, a route between two PEs is unique or absent.
"""

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

from heronry_dg.model import Bus, Function, Module, Spec
from heronry_wire.errors import HeronryError
from heronry_wire.management import MOST_PRIORITY
from heronry_wire.spelling import close, kind_word, meant

_KINDS = ("pe", "device", "module", "bus", "channel")
_OF_NO_ROUTE = ("device:", "module:")  # elements of which no route and no capacity depends
_PRIORITY = re.compile(r"(?P<function>[^=]+)=(?P<priority>\d{1,5})", re.ASCII)
_LIKENESS = 0.75  # least similarity of an element that is suggested; elements of a wrong kind reach 0.7
_LIMIT = re.compile(r"(?P<element>[^=]+)=(?P<percent>\d{1,3}(\.\d{1,12})?)%", re.ASCII)


class UnknownElementError(HeronryError, ValueError):
    """The spec lacks an element, phase or function, or a limit is invalid; the message says what to write instead."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Faults, limited capacities, the mission phase (None where the spec has no phases), and changed priorities."""

    down: frozenset[str] = frozenset()
    limits: Mapping[str, Fraction] = field(default_factory=dict)  # "bus:radio" -> share of its capacity, 0..1
    phase: str | None = None
    priorities: Mapping[str, int] = field(default_factory=dict)  # by function: priorities changed by module or operator

    def __hash__(self) -> int:
        return hash((self.down, frozenset(self.limits.items()), self.phase, frozenset(self.priorities.items())))

    def priority_of(self, function: Function) -> int:
        """Priority of a function now; 0: the function is not wanted."""
        of_the_spec = function.priority_in(self.phase)
        return self.priorities.get(function.name, of_the_spec) if of_the_spec else 0


def situation(
    spec: Spec,
    down: Iterable[str] = (),
    limits: Iterable[str] = (),
    phase: str | None = None,
    priorities: Iterable[str] = (),
) -> Situation:
    """Make a situation from texts of a user: limits such as `bus:radio=40%`, priorities such as `chute=3`.

    If a function has several priorities, the last one counts.

    Raises UnknownElementError for a name that the spec does not have, for a limit or priority that is not written as
    above, and for an element that is limited twice.
    """
    if phase is not None:
        checked_phase(spec, phase)
    return Situation(
        down=frozenset(checked_element(spec, element) for element in down),
        limits=_limits(spec, limits),
        phase=phase if phase is not None else spec.initial_phase(),
        priorities=dict(_priority(spec, text) for text in priorities),
    )


def elements(spec: Spec) -> tuple[str, ...]:
    """Return every element that can be down, in the spec's order."""
    by_kind: list[tuple[str, Iterable[str]]] = [
        ("pe", spec.pes),
        ("device", spec.devices),
        ("module", spec.modules),
        ("bus", spec.buses),
        ("channel", _channels(spec)),
    ]
    return tuple(f"{kind}:{name}" for kind, names in by_kind for name in names)


def places(spec: Spec, module: str) -> tuple[str, ...]:
    """Return the places of a module, in the order of the PEs; a module with one possible PE has none."""
    hosts = hosts_when_all_is_up(spec, spec.modules[module])
    return tuple(f"module:{module}@{pe}" for pe in hosts) if len(hosts) > 1 else ()


def is_place(element: str) -> bool:
    """Tell whether an element is a place, `module:NAME@PE`."""
    return "@" in element


def module_of(place: str) -> str:
    """Return the element `module:NAME` of a place `module:NAME@PE`."""
    return place.partition("@")[0]


def checked_element(spec: Spec, element: str) -> str:
    """Return `element` if the spec has it; raises UnknownElementError otherwise."""
    kind, colon, name = element.partition(":")
    if not colon or kind not in _KINDS:
        raise UnknownElementError(f"'{element}' is not an element; {_what_was_meant(spec, element)}")
    names: Iterable[str] = {
        "pe": spec.pes,
        "device": spec.devices,
        "module": spec.modules,
        "bus": spec.buses,
        "channel": _channels(spec),
    }[kind]
    module, at, pe = name.partition("@") if kind == "module" else (name, "", "")
    if module not in names:
        raise UnknownElementError(_unknown(kind, module, names))
    if at and element not in places(spec, module):
        raise UnknownElementError(_no_place(spec, module, pe))
    return element


def _no_place(spec: Spec, module: str, pe: str) -> str:
    if pe not in spec.pes:
        return _unknown("pe", pe, spec.pes)
    there_are = places(spec, module)
    hint = f"write one of {', '.join(there_are)}" if there_are else f"write module:{module}: it has no choice of PEs"
    return f"module '{module}' has no place on '{pe}'; {hint}"


def checked_phase(spec: Spec, phase: str) -> str:
    """Return `phase` if the spec has it; raises UnknownElementError otherwise."""
    if phase not in spec.phases:
        raise UnknownElementError(_unknown("phase", phase, spec.phases))
    return phase


def checked_function(spec: Spec, function: str) -> str:
    """Return `function` if the spec has it; raises UnknownElementError otherwise."""
    if function not in spec.functions:
        raise UnknownElementError(_unknown("function", function, spec.functions))
    return function


def _priority(spec: Spec, text: str) -> tuple[str, int]:
    match = _PRIORITY.fullmatch(text.strip())
    if match is None or int(match["priority"]) > MOST_PRIORITY:
        raise UnknownElementError(f"'{text}' is not a priority; write FUNCTION=N with N from 0 to {MOST_PRIORITY}")
    return checked_function(spec, match["function"]), int(match["priority"])


def _channels(spec: Spec) -> tuple[str, ...]:
    return tuple(f"{b.name}.{i}" for b in spec.buses.values() if b.channels > 1 for i in range(1, b.channels + 1))


def _limits(spec: Spec, texts: Iterable[str]) -> dict[str, Fraction]:
    limits: dict[str, Fraction] = {}
    for element, share in (_limit(spec, text) for text in texts):
        if element in limits:
            raise UnknownElementError(f"'{element}' is limited twice; write one limit for it")
        limits[element] = share
    return limits


def _limit(spec: Spec, text: str) -> tuple[str, Fraction]:
    match = _LIMIT.fullmatch(text.strip())
    if match is None:
        raise UnknownElementError(f"'{text}' is not a limit; write for example bus:NAME=40% or pe:NAME=50%")
    element = checked_element(spec, match["element"])
    if not element.startswith(("bus:", "pe:")):
        raise UnknownElementError(f"'{element}' has no capacity to limit; only a bus or a PE has one")
    share = Fraction(match["percent"]) / 100
    if share > 1:
        raise UnknownElementError(f"'{text}' is more than the capacity there is; write at most 100%")
    return element, share


def _what_was_meant(spec: Spec, text: str) -> str:
    """Return a hint: the element that a text with a missing or misspelt kind may mean, or how an element is written."""
    known = elements(spec)
    alone = [element for element in known if element.partition(":")[2] == text]
    found = alone[0] if alone else close(text, known, _LIKENESS)
    return f"did you mean '{found}'?" if found else f"write KIND:NAME with KIND one of {', '.join(_KINDS)}"


def _unknown(kind: str, name: str, known: Iterable[str]) -> str:
    return f"no {kind_word(kind)} is named '{name}'; {meant(name, known, there_is='the spec has')}"


@dataclass(frozen=True, slots=True)
class Survivors:
    """What a situation leaves of a system, and which of its modules and places have failed.

    Left are the PEs that are up and can be commanded, the working devices on these PEs, the buses that are up,
    and the routes between these PEs.
    """

    pe_cpu_millis: Mapping[str, int]  # of each PE that is up, reduced where limited
    bus_mbit_per_s: Mapping[
        str, int
    ]  # what foreign frames leave to data, of each bus that is up; thousandths of a bit/s
    devices: frozenset[str]
    failed_modules: frozenset[str]
    failed_places: frozenset[tuple[str, str]]  # module, PE on which it cannot run
    routes: Mapping[tuple[str, str], tuple[str, ...]]  # (from PE, to PE) -> buses in order; () on the same PE
    spec: Spec

    def hosts(self, module: Module) -> tuple[str, ...]:
        """PEs on which a module may run now, in the spec's order (semantics rule 1)."""
        return self.hosts_among(module, hosts_when_all_is_up(self.spec, module))

    def hosts_among(self, module: Module, homes: tuple[str, ...]) -> tuple[str, ...]:
        """Return the PEs on which a module may run now, as `hosts` does, but without computing `homes` again.

        homes: the PEs on which the module may run when everything is up (`hosts_when_all_is_up`).
        """
        if module.name in self.failed_modules or (module.device is not None and module.device not in self.devices):
            return ()
        hosts = tuple(pe for pe in homes if pe in self.pe_cpu_millis)
        if not self.failed_places:
            return hosts
        return tuple(pe for pe in hosts if (module.name, pe) not in self.failed_places)

    def route(self, origin: str, destination: str) -> tuple[str, ...] | None:
        """Buses over which a datum goes from one PE to another, in order; None where there is no route."""
        return self.routes.get((origin, destination))

    def way(self, bus: str, pe: str) -> tuple[str, ...]:
        """Buses over which a frame goes from one bus to a PE, in order, with this bus; () where there is no way."""
        if bus in self.spec.pes[pe].buses:
            return (bus,)
        routes = (self.route(one.name, pe) for one in self.spec.pes.values() if bus in one.buses)
        beyond = [route for route in routes if route is not None and bus not in route]
        return (bus, *min(beyond, key=len)) if beyond else ()


def hosts_when_all_is_up(spec: Spec, module: Module) -> tuple[str, ...]:
    """PEs that a module's `device`, `runs_on` and `requires` allow, in the spec's order."""
    bolted_to = spec.devices[module.device].pe if module.device is not None else None
    return tuple(
        pe.name
        for pe in spec.pes.values()
        if (bolted_to is None or pe.name == bolted_to)
        and (module.runs_on is None or pe.name in module.runs_on)
        and module.requires <= pe.features
    )


def survivors(spec: Spec, now: Situation, intact: Survivors | None = None) -> Survivors:
    """Compute what the situation `now` leaves of the system.

    intact: what is left of this spec with everything up, if it is already computed: where no PE and no bus is down or
        limited, its PEs, buses and routes are taken.
    """
    if intact is not None and not now.limits and all(one.startswith(_OF_NO_ROUTE) for one in now.down):
        return replace(
            intact,
            devices=intact.devices - {one.removeprefix("device:") for one in now.down if one.startswith("device:")},
            failed_modules=frozenset(_module_names(now.down) & spec.modules.keys()),
            failed_places=frozenset(_place(element) for element in now.down if is_place(element)),
        )
    buses = [b for b in spec.buses.values() if not _bus_is_down(b.name, b.channels, now)]
    alive = [p for p in spec.pes if f"pe:{p}" not in now.down]
    reached = _reachable(spec, {b.name for b in buses}, set(alive))
    commanded = {p: None for p in alive if p in reached}
    return Survivors(
        pe_cpu_millis={p: int(spec.pes[p].cpu_millis * now.limits.get(f"pe:{p}", Fraction(1))) for p in commanded},
        bus_mbit_per_s={b.name: room_mbit_per_s(b, now.limits.get(f"bus:{b.name}", Fraction(1))) for b in buses},
        devices=frozenset(
            d.name for d in spec.devices.values() if d.pe in commanded and f"device:{d.name}" not in now.down
        ),
        failed_modules=frozenset(_module_names(now.down) & spec.modules.keys()),
        failed_places=frozenset(_place(element) for element in now.down if is_place(element)),
        routes={
            (origin, destination): route
            for origin in commanded
            for destination, route in _routes_from(spec, origin, {b.name for b in buses}, set(commanded)).items()
        },
        spec=spec,
    )


def room_mbit_per_s(bus: Bus, share: Fraction = Fraction(1)) -> int:
    """Return what a bus has for published data, in thousandths of a bit/s: at least 0, so that it may carry nothing.

    share: of its capacity, as a limit leaves it.
    """
    return max(0, int(bus.bitrate * 1000 * (bus.max_load - bus.reserve) * share - foreign_bits_per_s(bus) * 1000))


def foreign_bits_per_s(bus: Bus) -> Fraction:
    """Return what foreign frames take of a bus, in bit/s."""
    return sum((Fraction(one.bits * 10**9, one.period_ns) for one in bus.foreign), Fraction(0))


def _module_names(down: Collection[str]) -> set[str]:
    return {name for kind, _, name in (element.partition(":") for element in down) if kind == "module"}


def _place(element: str) -> tuple[str, str]:
    module, _, pe = element.removeprefix("module:").partition("@")
    return module, pe


def _bus_is_down(bus: str, channels: int, now: Situation) -> bool:
    if f"bus:{bus}" in now.down:
        return True
    return channels > 1 and all(f"channel:{bus}.{i}" in now.down for i in range(1, channels + 1))


def _reachable(spec: Spec, buses_up: set[str], pes_up: set[str]) -> set[str]:
    """PEs with a route to the manager's bus."""
    if spec.manager.bus not in buses_up:
        return set()
    seen_buses, found, frontier = {spec.manager.bus}, set[str](), [spec.manager.bus]
    while frontier:
        bus = frontier.pop()
        for pe in pes_up:
            if bus in spec.pes[pe].buses and pe not in found:
                found.add(pe)
                further = [b for b in spec.pes[pe].buses if b in buses_up and b not in seen_buses]
                seen_buses.update(further)
                frontier.extend(further)
    return found


def _routes_from(spec: Spec, origin: str, buses_up: set[str], pes_up: set[str]) -> dict[str, tuple[str, ...]]:
    routes: dict[str, tuple[str, ...]] = {origin: ()}
    frontier = [origin]
    while frontier:
        here = frontier.pop(0)
        for bus in spec.pes[here].buses:
            if bus not in buses_up or bus in routes[here]:
                continue
            for pe in spec.pes:
                if pe in pes_up and pe not in routes and bus in spec.pes[pe].buses:
                    routes[pe] = (*routes[here], bus)
                    frontier.append(pe)
    return routes
