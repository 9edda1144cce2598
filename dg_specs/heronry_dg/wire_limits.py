"""Finds the parts of a spec that exceed a limit of the wire (`heronry_wire.capacities`), before a PE refuses a slice.

All limits but one are limits of a count, for example of the number of devices. The exception is the length of a slice,
which depends on the configuration. For this length an upper bound is computed for each PE:

1. A module counts with the most bytes that it can add to the slice in any mode.
2. CPU and RAM limit which modules the PE can hold at once. Of all sets of modules within these limits, the bound takes
   the bytes of the set with the most bytes. One module may count as a fraction, so the bound is never too small.
3. If the PE is a gateway, about four bytes are added for each source that it may forward.

No legal configuration has a slice that is longer than this bound.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Literal, NamedTuple

from heronry_dg.model import Module, Pe, Spec
from heronry_dg.situation import Situation, hosts_when_all_is_up, survivors
from heronry_wire.capacities import (
    MOST_DEVICES,
    MOST_MODES,
    MOST_MODULES,
    MOST_MODULES_OF_A_PE,
    MOST_RADIOS,
    MOST_SLICE_BYTES,
)
from heronry_wire.checkpoint_frames import MOST_CHECKPOINTS
from heronry_wire.errors import HeronryError
from heronry_wire.packing import pack

_NODE_BYTES = 1  # a node-ID is below 128


class WireLimitError(HeronryError):
    """A spec exceeds a limit of the wire; the message names the first excess, with its number and the limit."""


@dataclass(frozen=True, slots=True)
class Excess:
    """One part of a spec that exceeds a limit of the wire.

    section, name: where the spec has this part.
    sentence: says how much there is, and how much the limit allows.
    remedy: what to do, or which element is the first beyond the limit.
    is_slice: the limit is that of the length of a slice.
    """

    section: Literal["pes", "modules", "devices", "buses"]
    name: str
    sentence: str
    remedy: str
    is_slice: bool = False


class _Size(NamedTuple):
    """What one module adds to a PE.

    slice_bytes: the most bytes that it adds to the slice.
    cpu_millis: the least CPU that it needs, in thousandths of a reference core.
    ram: the least RAM that it needs, in bytes.
    """

    slice_bytes: int
    cpu_millis: int
    ram: int


def require_wire_limits(spec: Spec) -> None:
    """Raise WireLimitError if a spec exceeds a limit of the wire; the message names the first excess."""
    for excess in exceeded(spec):
        where = "('heronry check' lists all such mistakes)"
        raise WireLimitError(f"{spec.name}: {excess.sentence}; {excess.remedy} {where}")


def exceeded(spec: Spec) -> Iterator[Excess]:
    """Find everything in a spec that exceeds a limit of the wire."""
    yield from _too_many("devices", spec.devices, MOST_DEVICES, "an actuator's echo numbers devices in one byte")
    yield from _too_many("modules", spec.modules, MOST_MODULES, "the error history numbers elements in 12 bits")
    kept = [module.name for module in spec.modules.values() if module.checkpoint is not None]
    yield from _too_many("modules", kept, MOST_CHECKPOINTS, "their frames number them in one byte", "checkpoints")
    radios = [bus.name for bus in spec.buses.values() if bus.kind == "wireless"]
    yield from _too_many("buses", radios, MOST_RADIOS, "each gateway reports under its own identifier", "radios")
    for module in spec.modules.values():
        if len(module.modes) > MOST_MODES:
            sentence = f"module '{module.name}' has {len(module.modes)} modes, but may have only {MOST_MODES}"
            yield Excess("modules", module.name, f"{sentence}: an output echo numbers modes in one byte", "merge modes")
    yield from _of_the_pes(spec)


def _too_many(
    section: Literal["modules", "devices", "buses"], names: Iterable[str], most: int, why: str, called: str = ""
) -> Iterator[Excess]:
    found = list(names)
    if len(found) > most:
        sentence = f"there are {len(found)} {called or section}, but there may be only {most}: {why}"
        yield Excess(section, found[most], sentence, f"'{found[most]}' is the first beyond the limit")


def _of_the_pes(spec: Spec) -> Iterator[Excess]:
    bounds = _SliceBounds(spec)
    for pe in spec.pes.values():
        modules = bounds.may_run_on(pe.name)
        if len(modules) > MOST_MODULES_OF_A_PE:
            sentence = f"{len(modules)} modules may run on pe '{pe.name}', but it can have only {MOST_MODULES_OF_A_PE}"
            why = "CANopen numbers them in one byte"
            yield Excess("pes", pe.name, f"{sentence}: {why}", "restrict modules to other PEs with 'runs_on'")
        most = bounds.most_bytes(pe)
        if most > MOST_SLICE_BYTES:
            sentence = f"the slice of pe '{pe.name}' may need {most} bytes, but SLICE carries only {MOST_SLICE_BYTES}"
            remedy = "let fewer modules, or modules with fewer inputs and outputs, run on it, or forward fewer data"
            yield Excess("pes", pe.name, sentence, remedy, is_slice=True)


class _SliceBounds:
    """Upper bounds of the length of a PE's slice, in bytes: no slice of a legal configuration is longer."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._hosts = {name: hosts_when_all_is_up(spec, module) for name, module in spec.modules.items()}
        self._sources = tuple(spec.sources())
        self._source_bytes = _bytes_of(len(self._sources))
        self._index_bytes = _bytes_of(len(spec.modules))
        self._stops = spec.manager.without_manager != "keep"

    def may_run_on(self, pe: str) -> list[Module]:
        """Return the modules that may run on a PE."""
        return self._by_pe.get(pe, [])

    def most_bytes(self, pe: Pe) -> int:
        """Return an upper bound of the length in bytes of one PE's slice."""
        sizes = [self._size(module, pe) for module in self.may_run_on(pe.name)]
        by_cpu = _filled([(one.slice_bytes, one.cpu_millis) for one in sizes], pe.cpu_millis)
        by_ram = _filled([(one.slice_bytes, one.ram) for one in sizes], pe.ram)
        forwarded = self._forwarded(pe)
        entry_bytes = self._source_bytes + _NODE_BYTES + _bytes_of(1 << len(pe.buses))
        counts_bytes = 3 * self._source_bytes + 2 * _bytes_of(len(sizes))
        return counts_bytes + min(by_cpu, by_ram) + forwarded * entry_bytes

    @cached_property
    def _by_pe(self) -> Mapping[str, list[Module]]:
        found: dict[str, list[Module]] = {}
        for name, hosts in self._hosts.items():
            for pe in hosts:
                found.setdefault(pe, []).append(self._spec.modules[name])
        return found

    def _size(self, module: Module, pe: Pe) -> _Size:
        per_leaf_bytes = 2 * self._source_bytes + _NODE_BYTES  # wired, and remote
        per_source_bytes = self._source_bytes + _bytes_of(1 << len(pe.buses))
        modes = module.modes.values()
        mode_bytes = (
            per_leaf_bytes * sum(1 for _ in mode.leaves()) + per_source_bytes * len(mode.gives) for mode in modes
        )
        entry_bytes = self._index_bytes * (2 if self._stops else 1) + _bytes_of(len(modes))
        least_cpu_millis, least_ram = min(mode.cpu_millis for mode in modes), min(mode.ram for mode in modes)
        return _Size(entry_bytes + max(mode_bytes), least_cpu_millis, least_ram)

    @cached_property
    def _ways(self) -> Mapping[tuple[str, str], str]:
        """For each gateway and each other PE that it reaches: the first bus on the route to that PE."""
        left = survivors(self._spec, Situation())
        gateways = [pe.name for pe in self._spec.pes.values() if len(pe.buses) > 1]
        routes = ((here, there, left.route(here, there)) for here in gateways for there in self._spec.pes)
        return {(here, there): route[0] for here, there, route in routes if route}

    @cached_property
    def _readers(self) -> Mapping[str, set[str]]:
        """For each variable, the PEs on which a module that reads the variable may run."""
        found: dict[str, set[str]] = {}
        for module in self._spec.modules.values():
            for variable in {leaf.variable for mode in module.modes.values() for _, leaf in mode.leaves()}:
                found.setdefault(variable, set()).update(self._hosts[module.name])
        return found

    def _forwarded(self, pe: Pe) -> int:
        """Count the sources that a PE may have to forward from one of its buses to another.

        A source counts if this PE reaches a possible PE of the producer by one bus, and a possible PE of a reader
        by another bus.
        """
        if len(pe.buses) < 2:
            return 0
        return sum(
            any(way != other for way in self._sides(pe, self._hosts[module]) for other in self._sides(pe, readers))
            for module, variable in self._sources
            if (readers := self._readers.get(variable))
        )

    def _sides(self, pe: Pe, others: Iterable[str]) -> set[str]:
        return {way for other in others if (way := self._ways.get((pe.name, other))) is not None}


def _bytes_of(number: int) -> int:
    return len(pack([number]))


def _filled(items: list[tuple[int, int]], capacity: int) -> int:
    """Return the most bytes that items (bytes, cost) can have if their costs together do not exceed `capacity`.

    The last item may count as a fraction.
    """
    free = sum(size for size, cost in items if cost == 0)
    left, filled = capacity, Fraction(free)
    for size, cost in sorted((item for item in items if item[1]), key=lambda item: Fraction(-item[0], item[1])):
        taken = min(cost, left)
        filled += Fraction(size * taken, cost)
        left -= taken
    return int(filled)
