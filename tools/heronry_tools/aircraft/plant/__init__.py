"""The plant: the physical world that the simulated devices of the shipped aircraft read and move."""

from heronry_tools.aircraft.plant.world import Failure, Plant

__all__ = ["Failure", "Plant"]
