"""From names to indices: the tables of the PEs, and the slices of a configuration.

A table tells a PE once what the indices mean (`heronry_wire.pe_table`); a slice then needs a few bytes per module. The
digest of a slice covers the identity of the table, so the indices mean the same to the manager and to a PE that stages
the slice.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from heronry_dg.checkpoints import gap_ns, late_ns, numbers, period_ns, wait_ns
from heronry_dg.configuration import Configuration
from heronry_dg.echo_rates import EchoRates
from heronry_dg.expendable import expendable
from heronry_dg.field_types import CRITICALITIES
from heronry_dg.model import Device, Module, Phase, Spec, Variable
from heronry_dg.situation import Situation, hosts_when_all_is_up, survivors
from heronry_dg.traffic import criticality_ranks, identifiers
from heronry_dg.uplinks import radios
from heronry_dg.wire_limits import require_wire_limits
from heronry_manager.core.topology import command_period_ns, uplink_bus
from heronry_wire.configuration_slice import ModuleSlice, Slice, configuration_digest, slice_digest
from heronry_wire.management import MOST_FUNCTIONS
from heronry_wire.pe_table import (
    STALE_PERIODS,
    CheckpointEntry,
    DeviceEntry,
    DriverEntry,
    LeafEntry,
    ModeEntry,
    ModuleEntry,
    PeTable,
    PhaseEntry,
    Port,
    SourceEntry,
    VariableEntry,
)
from heronry_wire.protocol_version import PROTOCOL


@dataclass(frozen=True, slots=True)
class CompiledConfiguration:
    """A configuration as the manager sends it to the PEs.

    slices: bytes of each PE's slice, by node-ID.
    digest: digest of the whole configuration.
    slice_digests: digest of each slice, by node-ID.
    """

    slices: Mapping[int, bytes]
    digest: int
    slice_digests: Mapping[int, int]


class Compiler:
    """Makes slices of configurations, and the tables of the PEs, for one spec."""

    def __init__(self, spec: Spec) -> None:
        self._spec = spec
        self._module_index = {name: i for i, name in enumerate(spec.modules)}
        self._source_index = {source: i for i, source in enumerate(spec.sources())}
        self._exclusive = frozenset(spec.exclusive_things())
        self._all_up = survivors(spec, Situation())
        self._radios = radios(spec)
        self._tables: dict[str, PeTable] = {}

    @property
    def pes(self) -> tuple[str, ...]:
        """The names of all PEs, in the spec's order."""
        return tuple(self._spec.pes)

    @cached_property
    def identities(self) -> Mapping[int, bytes]:
        """The identity of the table of each PE, by node-ID; to compute them all once takes milliseconds.

        Raises WireLimitError if the spec exceeds a limit of the wire.
        """
        return {pe.node_id: self.table(pe.name).identity for pe in self._spec.pes.values()}

    @cached_property
    def _identifiers(self) -> Mapping[tuple[str, str], int]:
        return identifiers(self._spec)

    @cached_property
    def _echo_rates(self) -> EchoRates:
        return EchoRates(self._spec)

    @cached_property
    def _ranks(self) -> Mapping[str, int]:
        return criticality_ranks(self._spec)

    @cached_property
    def _fits_the_wire(self) -> bool:
        require_wire_limits(self._spec)
        return True

    def table(self, pe: str) -> PeTable:
        """Return the table of one PE; it is compiled once, and `identities` uses the same one.

        Raises WireLimitError if the spec exceeds a limit of the wire (`heronry_dg.wire_limits`).
        """
        if pe not in self._tables:
            self._tables[pe] = self._compiled(pe)
        return self._tables[pe]

    def _compiled(self, pe: str) -> PeTable:
        assert self._fits_the_wire
        spec, own = self._spec, self._spec.pes[pe]
        ports = tuple(self._port(pe, bus) for bus in own.buses)
        return PeTable(
            protocol=PROTOCOL,
            spec=spec.name,
            spec_digest=spec.digest,
            name=pe,
            node_id=own.node_id,
            cpu_millis=own.cpu_millis,
            without_manager=spec.manager.without_manager,
            uplink=own.buses.index(uplink_bus(spec, pe)),
            ports=ports,
            modules=tuple(
                self._module_entry(module)
                for module in spec.modules.values()
                if pe in hosts_when_all_is_up(spec, module)
            ),
            sources=tuple(
                SourceEntry(
                    module,
                    variable,
                    self._identifiers[module, variable],
                    self._period_ns(module, variable),
                    self._is_on_both_sides(pe, module),
                )
                for module, variable in self._source_index
            ),
            variables={name: _variable_entry(variable) for name, variable in spec.variables.items()},
            devices=tuple(DeviceEntry(d.name, d.kind, spec.pes[d.pe].node_id) for d in spec.devices.values()),
            module_names=tuple(spec.modules),
            pe_names=tuple(spec.pes),
            bus_names=tuple(spec.buses),
            phases=tuple(_phase_entry(phase, list(spec.phases)) for phase in spec.phases.values()),
            adjustable=_adjustable(spec),
            flight_critical=tuple(_flight_critical(spec)),
            echoes_per_s=self._echo_rates.of(pe),
            command_period_ns=command_period_ns(spec, pe),
            drivers=tuple(
                _driver_entry(device, _fastest_period_ns(spec, device))
                for device in spec.devices.values()
                if device.pe == pe and _says_of_its_driver(device)
            ),
            checkpoints=tuple(self._checkpoints(pe)),
        )

    def configuration(self, configuration: Configuration) -> CompiledConfiguration:
        """Compile a configuration into the slices of all PEs; the slice of a PE that has nothing to do is empty."""
        stops = self._without_manager(configuration)
        slices = {pe.node_id: self._slice(configuration, pe.name, stops).encode() for pe in self._spec.pes.values()}
        return CompiledConfiguration(
            slices=slices,
            digest=configuration_digest(self.identities, slices),
            slice_digests={node: slice_digest(self.identities[node], body) for node, body in slices.items()},
        )

    def _is_on_both_sides(self, pe: str, module: str) -> bool:
        """Tell whether a module may run on PEs on the manager's side of the gateway `pe`, and also on PEs beyond it."""
        uplink = uplink_bus(self._spec, pe)
        hosts = hosts_when_all_is_up(self._spec, self._spec.modules[module])
        ways = {(self._all_up.route(pe, host) or (uplink,))[0] for host in hosts if host != pe}
        return uplink in ways and len(ways) > 1

    def _period_ns(self, module: str, variable: str) -> int:
        """Return the longest period in ns with which a module sends a variable, over the modes that give it."""
        modes = self._spec.modules[module].modes.values()
        return 10**12 // min(mode.rate_mhz for mode in modes if variable in mode.gives)

    def _port(self, pe: str, bus: str) -> Port:
        entry = self._spec.buses[bus]
        radio = self._radios.get(bus)
        beyond = (self._spec.pes[p] for p in self._spec.pes if bus in (self._all_up.route(pe, p) or ())[:1])
        return Port(
            bus=bus,
            bitrate=entry.bitrate,
            heartbeat_ns=entry.heartbeat_ns,
            misses=entry.misses,
            wireless=entry.kind == "wireless",
            channels=entry.channels,
            nodes=tuple(p.node_id for p in beyond),
            data_per_mille=int(1000 * (entry.max_load - entry.reserve)) or 1,
            link_id=radio.link_id if radio is not None and radio.gateway == pe else None,
        )

    def _module_entry(self, module: Module) -> ModuleEntry:
        return ModuleEntry(
            index=self._module_index[module.name],
            name=module.name,
            image=module.image,
            device=module.device,
            demux=module.name in self._exclusive,
            movable=len(hosts_when_all_is_up(self._spec, module)) > 1,
            modes=tuple(
                ModeEntry(
                    name=mode.name,
                    rate_mhz=mode.rate_mhz,
                    cpu_millis=mode.cpu_millis,
                    leaves=tuple(LeafEntry(path, leaf.variable, leaf.best, leaf.worst) for path, leaf in mode.leaves()),
                    gives=dict(mode.gives),
                )
                for mode in module.modes.values()
            ),
            silent_output=self._is_silent_output(module),
            partition=module.partition or CRITICALITIES[self._ranks[module.name]],
            ram=max(mode.ram for mode in module.modes.values()),
            restarts=module.restarts,
        )

    def _checkpoints(self, pe: str) -> Iterator[CheckpointEntry]:
        """Yield the checkpoints that a PE sends and keeps, and those that it forwards."""
        own, spec = self._spec.pes[pe], self._spec
        for name, number in numbers(spec).items():
            module, homes = spec.modules[name], hosts_when_all_is_up(spec, spec.modules[name])
            checkpoint = module.checkpoint
            assert checkpoint is not None
            ways = {home: self._all_up.route(pe, home) or () for home in homes if home != pe}
            wired = {home: way for home, way in ways.items() if way and self._are_wired(way)}
            towards = tuple(
                tuple(spec.pes[home].node_id for home, way in wired.items() if way[0] == bus) for bus in own.buses
            )
            if pe not in homes and sum(map(bool, towards)) < 2:
                continue
            late = [late_ns(spec, checkpoint, way) for way in wired.values()]
            yield CheckpointEntry(
                module=self._module_index[name],
                number=number,
                data_bytes=checkpoint.data_bytes,
                period_ns=period_ns(checkpoint),
                gap_ns=gap_ns(checkpoint),
                max_age_ns=checkpoint.max_age_ns,
                late_ns=None if None in late else max((one for one in late if one is not None), default=0),
                towards=towards,
                waits_ns=tuple(wait_ns(spec, spec.buses[bus]) for bus in own.buses),
            )

    def _are_wired(self, way: tuple[str, ...]) -> bool:
        return all(self._spec.buses[bus].kind == "wired" for bus in way)

    def _is_silent_output(self, module: Module) -> bool:
        if module.device is not None and self._spec.devices[module.device].kind == "actuator":
            return False
        return any(module.name in function.outputs for function in self._spec.functions.values())

    def _without_manager(self, configuration: Configuration) -> frozenset[str]:
        """Return the modules that their PE stops while it hears no manager, by the policy that the spec states."""
        keeps = self._spec.manager.without_manager == "keep"
        return frozenset() if keeps else expendable(self._spec, configuration)

    def _slice(self, configuration: Configuration, pe: str, stops: frozenset[str]) -> Slice:
        running = {name: r for name, r in configuration.modules.items() if r.pe == pe}
        remote: dict[int, int] = {}
        modules = []
        for name, entry in running.items():
            sources: list[int | None] = []
            for path, _ in configuration.mode(self._spec, name).leaves():
                wire = entry.inputs.get(path)
                sources.append(None if wire is None else self._source_index[wire.producer, wire.variable])
                if wire is not None and configuration.modules[wire.producer].pe != pe:
                    producer_pe = configuration.modules[wire.producer].pe
                    remote[self._source_index[wire.producer, wire.variable]] = self._spec.pes[producer_pe].node_id
            mode_index = self._spec.modules[name].mode_index(entry.mode)
            modules.append(ModuleSlice(self._module_index[name], mode_index, tuple(sources)))
        publish, forward = self._traffic(configuration, pe)
        stops_here = frozenset(self._module_index[name] for name in running.keys() & stops)
        return Slice(tuple(modules), remote, publish, forward, stops_here)

    def _traffic(self, configuration: Configuration, pe: str) -> tuple[dict[int, int], dict[int, tuple[int, int]]]:
        """Return what a PE publishes and what it forwards, both by index of the source.

        Published: the ports on which the PE sends the source, as a mask. Forwarded: the node-ID of the producing PE,
        and the mask of the ports on which this PE sends the source on.
        """
        publish: dict[int, int] = {}
        forward: dict[int, tuple[int, int]] = {}
        ports = {bus: 1 << port for port, bus in enumerate(self._spec.pes[pe].buses)}
        for consumer, _, wire in configuration.wires():
            origin = configuration.modules[wire.producer].pe
            route = self._all_up.route(origin, configuration.modules[consumer].pe) or ()
            source = self._source_index[wire.producer, wire.variable]
            if origin == pe and route:
                publish[source] = publish.get(source, 0) | ports[route[0]]
            for inward, outward in pairwise(route):
                if inward in ports and outward in ports:
                    node, mask = forward.get(source, (self._spec.pes[origin].node_id, 0))
                    forward[source] = (node, mask | ports[outward])
        return publish, forward


def _adjustable(spec: Spec) -> dict[str, int]:
    functions = list(spec.functions.values())[:MOST_FUNCTIONS]
    return {function.name: i for i, function in enumerate(functions) if function.priority_range is not None}


def _phase_entry(phase: Phase, order: list[str]) -> PhaseEntry:
    when = phase.when
    if when is None:
        return PhaseEntry(phase.name)
    thresholds = {name: float(limit) for name, limit in when.thresholds().items()}
    origins = tuple(order.index(origin) for origin in when.origins)
    return PhaseEntry(phase.name, when.variable, hold_ns=when.hold_ns, origins=origins, **thresholds)


def _flight_critical(spec: Spec) -> Iterator[str]:
    """Yield the modules that may serve a function of class A in some phase, and the devices that they use."""
    critical = [name for name, rank in criticality_ranks(spec).items() if CRITICALITIES[rank] == "A"]
    yield from (f"module:{name}" for name in critical)
    bolted = {spec.modules[name].device for name in critical}
    yield from (f"device:{name}" for name in spec.devices if name in bolted)


def _says_of_its_driver(device: Device) -> bool:
    said = (device.driver, device.stale_ns, device.span, device.limits, device.rate_limit, device.safe)
    return bool(device.options) or any(one is not None for one in said)


def _fastest_period_ns(spec: Spec, device: Device) -> int:
    """Return the shortest period in ns of the modules on a device, in any mode; a second if there is none."""
    rates = (
        mode.rate_mhz
        for module in spec.modules.values()
        if module.device == device.name
        for mode in module.modes.values()
    )
    return 10**12 // max(rates, default=1000)


def _driver_entry(device: Device, period_ns: int) -> DriverEntry:
    least, most = device.span or device.limits or (None, None)
    safe = "release" if device.safe is None else device.safe
    return DriverEntry(
        device=device.name,
        driver=device.driver,
        options=json.dumps(device.options, sort_keys=True),
        stale_ns=device.stale_ns or STALE_PERIODS * period_ns,
        least=None if least is None else float(least),
        most=None if most is None else float(most),
        per_s=None if device.rate_limit is None else float(device.rate_limit),
        safe=safe if isinstance(safe, str) else float(safe),
    )


def _variable_entry(variable: Variable) -> VariableEntry:
    return VariableEntry(type=variable.type, initial=variable.initial)
