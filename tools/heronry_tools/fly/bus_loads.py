"""The load of each bus in a simulated flight: the share of its bit rate that frames used in the last second."""

from heronry_tools.sim.flight.simulation import Simulation

NS_PER_S = 1_000_000_000


class BusLoads:
    """Makes the columns `load_BUS` of a record; a replicated bus has the load of its more loaded channel."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._since_ns = simulation.now_ns
        self._bits = dict.fromkeys(simulation.wiring.wires, 0)
        self._row: dict[str, float | None] = {f"load_{bus}": None for bus in self._bits}

    def columns(self) -> dict[str, float | None]:
        """Return the load of each bus by name of the column, as a share of the bit rate.

        A load is the average over the last second, and is renewed once a second; None in the first second.
        """
        passed_ns = self._simulation.now_ns - self._since_ns
        if passed_ns >= NS_PER_S:
            for bus, wires in self._simulation.wiring.wires.items():
                bits = max(wire.busy_bits for wire in wires)
                self._row[f"load_{bus}"] = (bits - self._bits[bus]) * NS_PER_S / (wires[0].bitrate * passed_ns)
                self._bits[bus] = bits
            self._since_ns = self._simulation.now_ns
        return self._row
