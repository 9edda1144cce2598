"""The buses of one flight: their wires, one for each channel, and the observers and tamperers of their frames."""

from collections.abc import Callable, Mapping
from functools import partial
from random import Random

from heronry_dg.model import Spec
from heronry_tools.sim.world.bus import Clash, Faults, Sent, SimulatedBus, Tampering
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.first_copies import FirstCopies


class Wiring:
    """Every wire of a spec."""

    def __init__(self, spec: Spec, clock: Clock, seed: int, faults: Faults) -> None:
        """`faults` are what all wires suffer from all the time, drawn by `seed`."""
        self.faults = faults
        self.wires: Mapping[str, tuple[SimulatedBus, ...]] = {
            bus.name: tuple(
                SimulatedBus(bus.name, bus.bitrate, clock, Random(f"{seed}/{channel}"), faults)
                for channel in (bus.name, f"{bus.name}.2")[: bus.channels]
            )
            for bus in spec.buses.values()
        }
        self.buses = {name: wires[0] for name, wires in self.wires.items()}
        self._both = {name: FirstCopies() for name, wires in self.wires.items() if len(wires) > 1}

    def tap(self, bus: str, tap: Callable[[Sent], None]) -> None:
        """Call `tap` for every frame of a bus, of a replicated one for the first copies; the nodes do not notice."""
        (self._both[bus].taps if bus in self._both else self.buses[bus].taps).append(tap)

    def watch(self, see: Callable[[Sent], None], channel: Callable[[int, Sent], None]) -> None:
        """Call `see` for every frame on every wire, and `channel` with the channel (0 or 1) of a replicated bus.

        Called once, before the first `tap`: the first copies are passed on after that.
        """
        for name, wires in self.wires.items():
            for number, wire in enumerate(wires):
                wire.taps.append(see)
                if name in self._both:
                    wire.taps.append(partial(channel, number))
                    wire.taps.append(self._both[name].see)

    def every_wire(self) -> dict[str, SimulatedBus]:
        """Every wire by the name of its bus, or of its channel where the bus is replicated."""
        return {
            name if len(wires) == 1 else f"{name}.{number}": wire
            for name, wires in self.wires.items()
            for number, wire in enumerate(wires, start=1)
        }

    def channel(self, name: str) -> SimulatedBus:
        """Give the wire of a channel of a replicated bus, by its name (`can0.1`)."""
        bus, _, number = name.rpartition(".")
        return self.wires[bus][int(number) - 1]

    def clashes(self) -> list[Clash]:
        """Give the clashes on all wires so far."""
        return [clash for wires in self.wires.values() for wire in wires for clash in wire.clashes]

    def tamper(self, frame: Sent, tampering: Tampering) -> None:
        """Let one frame of a run that is replayed be lost or doubled."""
        for wire in self.wires[frame.bus]:
            wire.tamper = lambda sent: tampering if sent == frame else None
