"""How often outputs are echoed on the buses, and what management sends there all the time (protocol rule 14).

A PE echoes what its outputs do: the value to which an actuator was commanded, or that an output module ran. The echoes
go over every bus from this PE to the manager's bus. On a bus that carries the echoes of n outputs, an output is echoed

    min(10, max(1, floor((reserve x bitrate - the rest) / 135 n)))

times a second. The *rest* are the frames that management sends all the time: state frames, LEASE and ALIVE, CANopen
heartbeats, and the reports of gateways on their radios, each with those that gateways forward from beyond. Over several
buses the smallest of their rates counts. All these frames, and the echoes, must fit into the reserve of a bus (DG307).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from heronry_dg.model import Bus, Module, Spec
from heronry_dg.situation import hosts_when_all_is_up
from heronry_dg.uplinks import radios, uplinks
from heronry_wire.protocol_times import CANOPEN_HEARTBEAT_NS
from heronry_wire.timing import WORST_BLOCKING_BITS, worst_bits

MOST_ECHOES_PER_S: Final = 10
_NS_PER_S: Final = 1_000_000_000
_MANAGER_FRAMES: Final = 2  # LEASE and ALIVE, in each heartbeat period
_HEARTBEAT_BYTES: Final = 1


@dataclass(frozen=True, slots=True)
class ReserveUse:
    """What management sends on one bus all the time, in bit/s.

    periodic: LEASE, ALIVE and the states of the PEs on this bus, once in each heartbeat period.
    passing: states of PEs beyond gateways, in the heartbeat periods of their own buses.
    heartbeats: CANopen heartbeats.
    reports: reports of gateways on their radios, once in each heartbeat period of the radio.
    outputs: number of outputs of which the bus carries the echoes.
    echoes_per_s: how often each of them is echoed.
    """

    periodic: Fraction
    passing: Fraction
    heartbeats: Fraction
    reports: Fraction
    outputs: int
    echoes_per_s: int

    @property
    def rest(self) -> Fraction:
        """All but the echoes."""
        return self.periodic + self.passing + self.heartbeats + self.reports

    @property
    def echoes(self) -> int:
        """The echoes."""
        return self.outputs * self.echoes_per_s * WORST_BLOCKING_BITS

    @property
    def total(self) -> Fraction:
        """All together."""
        return self.rest + self.echoes


def outputs_of(spec: Spec) -> dict[str, tuple[str, ...]]:
    """Return the possible PEs of each module that is echoed: it drives an actuator, or serves a function."""
    serving = {output for function in spec.functions.values() for output in function.outputs}
    return {
        module.name: hosts_when_all_is_up(spec, module)
        for module in spec.modules.values()
        if module.name in serving or _drives(spec, module)
    }


def _drives(spec: Spec, module: Module) -> bool:
    return module.device is not None and spec.devices[module.device].kind == "actuator"


class EchoRates:
    """The echo rates of one spec, and the use of the reserve of each bus."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec
        self._ways = uplinks(spec)
        self._radios = radios(spec).values()
        carried: dict[str, int] = dict.fromkeys(spec.buses, 0)
        for hosts in outputs_of(spec).values():
            for bus in {bus for pe in hosts for bus in self._ways.get(pe, ())}:
                carried[bus] += 1
        self.by_bus: Mapping[str, ReserveUse] = {
            bus.name: self._use(bus, carried[bus.name]) for bus in spec.buses.values()
        }

    def of(self, pe: str) -> int:
        """Return how often, per second, an output on a PE is echoed."""
        rates = (self.by_bus[bus].echoes_per_s for bus in self._ways.get(pe, ()))
        return min(rates, default=MOST_ECHOES_PER_S)

    def longest_gap_ns(self, modules: Iterable[str]) -> int:
        """Return the longest time in ns from one echo of some modules to the next, in any mode, on any of their PEs.

        That is a period of the slowest mode; or of the echoes of a PE which has not room for the most of them. (With
        this room a plant may ask for an echo of every command.)
        """
        these = [self.spec.modules[name] for name in modules]
        slowest = min(mode.rate_mhz for module in these for mode in module.modes.values())
        rates = [self.of(pe) for module in these for pe in hosts_when_all_is_up(self.spec, module)]
        scarce = [_NS_PER_S // rate for rate in rates if rate < MOST_ECHOES_PER_S]
        return max([1000 * _NS_PER_S // slowest, *scarce])

    def way(self, pe: str) -> tuple[str, ...]:
        """Return the buses over which the frames of a PE go to the manager, in order; () for a PE that none reaches."""
        return self._ways.get(pe, ())

    def carries(self, bus: str, pe: str) -> bool:
        """Tell whether states and heartbeats of a PE are on a bus: it is on the bus, or its way leads over it."""
        return bus in self.spec.pes[pe].buses or bus in self.way(pe)

    def _use(self, bus: Bus, outputs: int) -> ReserveUse:
        frame, heartbeat = WORST_BLOCKING_BITS, worst_bits(_HEARTBEAT_BYTES)
        periodic = Fraction(_MANAGER_FRAMES, bus.heartbeat_ns)
        passing, heartbeats = Fraction(0), Fraction(int(bus.name == self.spec.manager.bus))
        for pe in self.spec.pes.values():
            if bus.name in pe.buses:
                periodic += Fraction(1, bus.heartbeat_ns)
                heartbeats += 1
            elif bus.name in self._ways.get(pe.name, ()):
                passing += Fraction(1, self.spec.buses[self._ways[pe.name][0]].heartbeat_ns)
                heartbeats += 1
        periodic, passing = periodic * frame * _NS_PER_S, passing * frame * _NS_PER_S
        heartbeats *= Fraction(heartbeat * _NS_PER_S, CANOPEN_HEARTBEAT_NS)
        reports, rate = self._reports(bus.name), MOST_ECHOES_PER_S
        if outputs:
            left = bus.reserve * bus.bitrate - periodic - passing - heartbeats - reports
            rate = min(rate, max(1, int(left // (frame * outputs))))
        return ReserveUse(periodic, passing, heartbeats, reports, outputs, rate)

    def _reports(self, bus: str) -> Fraction:
        periods = (self.spec.buses[radio.bus].heartbeat_ns for radio in self._radios if bus in radio.report_way)
        return sum((Fraction(WORST_BLOCKING_BITS * _NS_PER_S, period) for period in periods), Fraction(0))
