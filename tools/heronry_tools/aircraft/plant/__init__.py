"""The plant: the physical world that the simulated devices of the shipped aircraft read and move."""

from heronry_tools.aircraft.plant.interface import Failure, PlantDevice, PlantOfDevices
from heronry_tools.aircraft.plant.world import Plant

__all__ = ["Failure", "Plant", "PlantDevice", "PlantOfDevices"]
