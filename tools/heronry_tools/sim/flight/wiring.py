"""The buses of one flight: one wire per channel, with callbacks that observe frames or tamper with them."""

from collections.abc import Callable, Mapping
from functools import partial
from random import Random

from heronry_dg.model import Spec
from heronry_tools.sim.world.bus import Clash, Faults, Sent, SimulatedBus, Tampering
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.first_copies import FirstCopies


class Wiring:
    """The wires of all buses of a spec."""

    def __init__(self, spec: Spec, clock: Clock, seed: int, faults: Faults) -> None:
        """Create the wires.

        faults: how often frames are lost, missed or doubled, on every wire and for the whole flight
        seed: seed of the random numbers that decide which frames these are
        """
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
        """Call `tap` for every frame of a bus, unnoticed by the nodes.

        On a replicated bus a frame comes twice, once on each channel: `tap` is called for the copy that comes first.
        """
        (self._both[bus].taps if bus in self._both else self.buses[bus].taps).append(tap)

    def watch(self, see: Callable[[Sent], None], channel: Callable[[int, Sent], None]) -> None:
        """Call `see` for every frame on every wire, and `channel` for every frame on a channel of a replicated bus.

        The callback `channel` also gets the number of the channel, 0 or 1.

        Call this method once, before the first `tap`. From this call on, the first of the two copies of each frame on a
        replicated bus is recognized; only this copy goes to the taps.
        """
        for name, wires in self.wires.items():
            for number, wire in enumerate(wires):
                wire.taps.append(see)
                if name in self._both:
                    wire.taps.append(partial(channel, number))
                    wire.taps.append(self._both[name].see)

    def every_wire(self) -> dict[str, SimulatedBus]:
        """Return every wire, by the name of its bus, or of its channel if the bus is replicated."""
        return {
            name if len(wires) == 1 else f"{name}.{number}": wire
            for name, wires in self.wires.items()
            for number, wire in enumerate(wires, start=1)
        }

    def channel(self, name: str) -> SimulatedBus:
        """Return the wire of a channel of a replicated bus, by the channel's name (`can0.1` or `can0.2`)."""
        bus, _, number = name.rpartition(".")
        return self.wires[bus][int(number) - 1]

    def clashes(self) -> list[Clash]:
        """Return, for all wires, the arbitrations so far in which two stations sent under one identifier."""
        return [clash for wires in self.wires.values() for wire in wires for clash in wire.clashes]

    def tamper(self, frame: Sent, tampering: Tampering) -> None:
        """Deliver one frame of the flight as `tampering` says: lose it, or double it.

        frame: an equal frame, with the same time and sender, from an earlier flight that was equal up to this frame
        """
        for wire in self.wires[frame.bus]:
            wire.tamper = lambda sent: tampering if sent == frame else None
