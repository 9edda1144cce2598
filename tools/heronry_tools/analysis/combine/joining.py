"""What becomes of each name, number and rule of two vehicles' specs where they become one: decided here, written later.

The first spec is that of the vehicle that flies on: its names stay, and so do its modules. The second one joins it.

- *The link.* Both specs have the bus over which the vehicles talk, with the same properties. It becomes one bus.
- *Data.* A variable that both specs declare is one and the same if at most one of both vehicles gives it, and then both
  must declare it alike: it crosses the link. If both give it, each measures its own, and the names clash.
- *Names.* Every other name that both specs have is that of two things: the second's gets a prefix. A module that is
  renamed keeps its image.
- *Identifiers.* A standard identifier that the first spec gives away is taken from a variable of the second, which then
  gets one like any other.
- *Node-IDs* must differ. Those of the second spec are changed only if the user says so, since a node-ID is also a
  setting of a real PE.
- *Places.* A module that names no PE may run on any. It stays on its own vehicle all the same, by a feature of the
  vehicle's PEs, unless the user lets it roam.
- *Phases.* There is one phase for both. If both have phases, those of one must be among those of the other.
- *The manager.* One manager remains, that of the first spec. If the second says something else of its manager, the user
  must choose.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from heronry_dg.findings import listed
from heronry_dg.model import Bus, Manager, Phase, Spec, Variable
from heronry_wire.errors import HeronryError
from heronry_wire.identifiers import FIRST_PE, LAST_PE
from heronry_wire.spelling import meant

BUS, PE, DEVICE, DATUM, MODULE, FUNCTION, PLANT = "bus", "pe", "device", "datum", "module", "function", "plant"
_LONGEST_NAME: Final = 64


class CombineError(HeronryError):
    """Two specs cannot become one; the message is one sentence that says why, and what to do."""


@dataclass(frozen=True, slots=True)
class Choices:
    """What the user says about a combination.

    over: name of the link in the first and in the second spec. prefix: of names of the second spec that clash, without
        the `_`; its name if None. manager: name of the spec whose manager remains; None: nothing is said.
    renumber: PEs of the second spec whose node-IDs are taken get free ones. roams: modules that may run on both
        vehicles, by the names that they have in the combined spec. name: of the combined spec; None: of both.
    """

    over: tuple[str, str]
    prefix: str | None = None
    name: str | None = None
    manager: str | None = None
    renumber: bool = False
    roams: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Joint:
    """What becomes of two specs.

    renames: by kind, the names of the second spec that change. shared: variables that are one and the same.
    node_ids: new node-IDs of PEs of the second spec, by their names there. freed: its variables that lose their
    standard identifier. labels: the feature of each vehicle's PEs, where it needs one. pinned: by spec, the modules
    that then require it. phases: those of the combined spec, and `phases_of` the number of the spec that has them.
    gateways: the PEs on the link, by spec, with the names that they have in the combined spec.
    """

    name: str
    link: str
    renames: Mapping[str, Mapping[str, str]]
    shared: tuple[str, ...]
    node_ids: Mapping[str, int]
    freed: tuple[str, ...]
    labels: tuple[str, str]
    pinned: tuple[tuple[str, ...], tuple[str, ...]]
    phases_of: int
    manager: Manager
    gateways: tuple[tuple[str, ...], tuple[str, ...]]

    def renamed(self, kind: str, name: str) -> str:
        """Name in the combined spec of an element of the second one."""
        return self.renames.get(kind, {}).get(name, name)


def join(first: Spec, second: Spec, choices: Choices, *, both_name_a_bus: bool) -> Joint:
    """Decide what becomes of two specs; raises CombineError.

    both_name_a_bus: each file says which bus its manager is on, instead of leaving that to the first wired bus.
    """
    return _Joining(first, second, choices, both_name_a_bus).joint()


@dataclass(slots=True)
class _Joining:
    first: Spec
    second: Spec
    choices: Choices
    both_name_a_bus: bool
    prefix: str = field(init=False)

    def __post_init__(self) -> None:
        self.prefix = self.choices.prefix or self.second.name
        if self.prefix == self.first.name:
            raise CombineError(f"both specs are named '{self.prefix}'; say --prefix NAME, for names of the second one")

    def joint(self) -> Joint:
        first, second = self.first, self.second
        self._expect_one_link()
        shared = tuple(self._shared())
        renames = self._renames(shared)
        labels = self.first.name, self.prefix
        pinned = self._pinned(first, second, {}), self._pinned(second, first, renames[MODULE])
        self._expect_roaming(renames[MODULE])
        self._expect_labels(labels)
        near, far = self.choices.over
        return Joint(
            name=self.choices.name or f"{first.name}_{self.prefix}",
            link=near,
            renames=renames,
            shared=shared,
            node_ids=self._node_ids(),
            freed=tuple(self._freed(shared)),
            labels=labels,
            pinned=pinned,
            phases_of=self._phases_of(renames[DATUM]),
            manager=self._manager(renames[BUS]),
            gateways=(
                tuple(pe.name for pe in first.pes.values() if near in pe.buses),
                tuple(renames[PE].get(pe.name, pe.name) for pe in second.pes.values() if far in pe.buses),
            ),
        )

    # The link

    def _expect_one_link(self) -> None:
        names = self.choices.over
        for spec, name in zip((self.first, self.second), names, strict=True):
            if name not in spec.buses:
                remedy = meant(name, spec.buses, there_is="it has")
                raise CombineError(
                    f"{spec.name} has no bus '{name}' over which to reach the other vehicle; {remedy}, or write "
                    "--over BUS=BUS if the specs name it differently"
                )
            if not any(name in pe.buses for pe in spec.pes.values()):
                raise CombineError(f"no PE of {spec.name} is on bus '{name}'; add '{name}' to the buses of its gateway")
        near, far = (_link(spec.buses[name]) for spec, name in zip((self.first, self.second), names, strict=True))
        differs = [
            name
            for name in ("bitrate", "max_load", "reserve", "kind", "channels", "misses")
            if getattr(near, name) != getattr(far, name)
        ]
        differs += ["heartbeat_ms"] if near.heartbeat_ns != far.heartbeat_ns else []
        differs += ["foreign"] if near.foreign != far.foreign else []
        if differs:
            raise CombineError(
                f"bus '{names[0]}' of {self.first.name} and bus '{names[1]}' of {self.second.name} are one, but differ "
                f"in {listed(differs)}; write the same in both specs"
            )

    # Names

    def _shared(self) -> Iterator[str]:
        """Yield the variables that are one and the same in both specs."""
        for name in self.second.variables:
            if name not in self.first.variables or (_gives(self.first, name) and _gives(self.second, name)):
                continue
            differs = list(_differing(self.first.variables[name], self.second.variables[name]))
            if differs:
                raise CombineError(
                    f"variable '{name}' crosses the link, but {self.first.name} and {self.second.name} differ in its "
                    f"{listed(differs)}; write the same in both, or rename it in one if it is another datum"
                )
            yield name

    def _renames(self, shared: tuple[str, ...]) -> dict[str, dict[str, str]]:
        first, second = self.first, self.second
        data = {*first.variables, *first.shorthands, *first.demuxes}
        own_data = [*second.variables, *second.shorthands, *second.demuxes]
        gates = {*second.shorthands, *second.demuxes}
        near, far = self.choices.over
        taken = {
            BUS: ({*first.buses}, [*second.buses]),
            PE: ({*first.pes}, [*second.pes]),
            DEVICE: ({*first.devices}, [*second.devices]),
            DATUM: (data, own_data),
            MODULE: ({*first.modules, *first.demuxes}, [*second.modules]),
            FUNCTION: ({*first.functions}, [*second.functions]),
            PLANT: ({*first.plants}, [*second.plants]),
        }
        stays = {BUS: {far}, DATUM: {*shared} - gates}
        renames = {}
        for kind, (others, own) in taken.items():
            clash = [name for name in own if name in others and name not in stays.get(kind, ())]
            if kind == DATUM:
                clash += [name for name in second.demuxes if name in first.modules and name not in clash]
            renames[kind] = dict(self._prefixed(kind, clash, others | {*own}))
        if near != far:
            renames[BUS][far] = near
        return renames

    def _prefixed(self, kind: str, clash: list[str], taken: set[str]) -> Iterator[tuple[str, str]]:
        for name in clash:
            new = f"{self.prefix}_{name}"
            if new in taken or len(new) > _LONGEST_NAME:
                why = "is taken, too" if new in taken else f"has more than {_LONGEST_NAME} characters"
                raise CombineError(
                    f"both specs have a {kind} '{name}', and '{new}' {why}; say --prefix NAME, or rename it in "
                    f"{self.second.name}"
                )
            yield name, new

    def _freed(self, shared: tuple[str, ...]) -> Iterator[str]:
        """Yield the variables of the second spec whose standard identifiers the first one has for other data."""
        taken = {one.identifier for one in self.first.variables.values() if one.identifier is not None}
        for variable in self.second.variables.values():
            if variable.name not in shared and variable.identifier in taken:
                yield variable.name

    # Numbers and places

    def _node_ids(self) -> dict[str, int]:
        taken = {pe.node_id: pe.name for pe in self.first.pes.values()}
        clash = [pe for pe in self.second.pes.values() if pe.node_id in taken]
        if clash and not self.choices.renumber:
            one = clash[0]
            more = f" (and {len(clash) - 1} more)" if len(clash) > 1 else ""
            raise CombineError(
                f"pe '{one.name}' of {self.second.name} has the node-ID of pe '{taken[one.node_id]}' of "
                f"{self.first.name}, {one.node_id}{more}; give it another one, on the PE too, or say --renumber"
            )
        used = {*taken, *(pe.node_id for pe in self.second.pes.values())}
        free = iter([node for node in range(FIRST_PE, LAST_PE + 1) if node not in used])
        given = dict(zip([pe.name for pe in clash], free, strict=False))
        if len(given) < len(clash):
            raise CombineError(
                f"both specs have {len(self.first.pes) + len(self.second.pes)} PEs, more than there are node-IDs "
                f"({FIRST_PE} to {LAST_PE}); leave out some PEs"
            )
        return given

    def _pinned(self, own: Spec, other: Spec, renames: Mapping[str, str]) -> tuple[str, ...]:
        """Return the modules of a spec that would be allowed on the other vehicle, and do not roam."""
        return tuple(
            module.name
            for module in own.modules.values()
            if module.device is None
            and module.runs_on is None
            and renames.get(module.name, module.name) not in self.choices.roams
            and any(module.requires <= pe.features for pe in other.pes.values())
        )

    def _expect_roaming(self, renames: Mapping[str, str]) -> None:
        """Expect that each module that shall roam exists, and is not bound to PEs or to a device."""
        modules = {**self.first.modules, **{renames.get(name, name): one for name, one in self.second.modules.items()}}
        for name in self.choices.roams:
            if name not in modules:
                raise CombineError(f"--roams {name}: no module is named '{name}'; {meant(name, modules)}")
            module = modules[name]
            bound = "'runs_on'" if module.runs_on is not None else "its device" if module.device is not None else ""
            if bound:
                raise CombineError(f"--roams {name}: {bound} binds module '{name}' to its PE; leave out --roams")

    def _expect_labels(self, labels: tuple[str, str]) -> None:
        """Expect that no PE of one vehicle has a feature that is named like the other vehicle."""
        for spec, other, label in ((self.second, self.first, labels[0]), (self.first, self.second, labels[1])):
            for pe in spec.pes.values():
                if label in pe.features:
                    raise CombineError(
                        f"pe '{pe.name}' of {spec.name} has the feature '{label}', which marks the PEs of {other.name};"
                        " give the feature another name"
                    )

    # Phases and the manager

    def _phases_of(self, renames: Mapping[str, str]) -> int:
        """Return the number of the spec whose phases are those of both, 0 or 1."""
        first, second = self.first.phases, {name: _told(one, renames) for name, one in self.second.phases.items()}
        for name in first.keys() & second.keys():
            if first[name].when != second[name].when:
                raise CombineError(
                    f"phase '{name}' is entered by different rules in {self.first.name} and {self.second.name}; write "
                    "the same 'when' in both, or name the phases differently"
                )
        for number, (more, fewer) in enumerate(((first, second), (second, first))):
            if [name for name in more if name in fewer] == list(fewer) and (number == 0 or _begin_alike(first, second)):
                return number
        raise CombineError(
            f"the phases of {self.first.name} ({', '.join(first)}) and of {self.second.name} ({', '.join(second)}) "
            "contradict each other, and both vehicles are in one phase; let one spec list the phases of the other, in "
            "the same order, or none"
        )

    def _manager(self, renames: Mapping[str, str]) -> Manager:
        first, second, chosen = self.first.manager, self.second.manager, self.choices.manager
        names = self.first.name, self.prefix
        theirs = replace(second, bus=renames.get(second.bus, second.bus))
        if chosen is not None and chosen not in names:
            raise CombineError(f"--manager {chosen}: write --manager {names[0]}, or --manager {names[1]}")
        if chosen is None and (
            first.without_manager != second.without_manager or (self.both_name_a_bus and first.bus != theirs.bus)
        ):
            told = [f"{one.bus} ({one.without_manager})" for one in (first, theirs)]
            raise CombineError(
                f"one manager remains, but {names[0]} has its manager on bus {told[0]} and {names[1]} on {told[1]}; "
                f"say which one flies on, with --manager {names[0]} or --manager {names[1]}"
            )
        return theirs if chosen == names[1] else first


def _link(bus: Bus) -> Bus:
    return replace(bus, name="", rate_per_h=None, probability=None)


def _gives(spec: Spec, variable: str) -> bool:
    return any(True for _ in spec.producers(variable))


def _differing(one: Variable, other: Variable) -> Iterator[str]:
    named = {"deadline_ns": "deadline_ms"}
    for name in ("type", "unit", "versions", "identifier", "initial", "deadline_ns"):
        if getattr(one, name) != getattr(other, name):
            yield named.get(name, name)


def _told(phase: Phase, renames: Mapping[str, str]) -> Phase:
    """Return a phase of the second spec with the name that its rule's variable has in the combined spec."""
    if phase.when is None:
        return phase
    return replace(phase, when=replace(phase.when, variable=renames.get(phase.when.variable, phase.when.variable)))


def _begin_alike(first: Mapping[str, Phase], second: Mapping[str, Phase]) -> bool:
    return not first or next(iter(first)) == next(iter(second))
