"""The python-can bus that stands for each bus of a spec in a demo.

    the manager's bus   the bus that the user names with python-can's flags or `--bus`; otherwise vcan0, if this machine
                        has vcan0; otherwise a software bus
    every other bus     the bus that `--bus NAME=[INTERFACE:]CHANNEL` names; otherwise a software bus

A replicated bus has two channels, with a comma between their names.
"""

import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from heronry_dg.model import Bus, Spec
from heronry_tools.console.bus_flags import what_it_models
from heronry_tools.console.errors import UserError
from heronry_wire.bus_arguments import channel_configs


@dataclass(frozen=True, slots=True)
class BusChoice:
    """The python-can bus that stands for one bus of the spec."""

    name: str
    interface: str
    channel: str  # of a replicated bus both, with a comma between them
    bitrate: int | None  # None: the interface is set up elsewhere
    is_ours: bool  # a software bus that this run has to start
    channels: int = 1

    def describe(self) -> str:
        """Describe the bus in one line for the user: which bus, and what it does not model."""
        return f"{self.name}: {what_it_models(self.interface, self.channel)}"

    def configs(self) -> list[dict[str, Any]]:
        """Return the keyword arguments of `can.Bus` for each channel; raises BusArgumentError."""
        config = {"interface": self.interface, "channel": self.channel}
        rate = {} if self.bitrate is None else {"bitrate": self.bitrate}
        return channel_configs({**config, **rate}, self.channels, f"bus {self.name}")

    def port_argument(self) -> str:
        """Return the value of `--bus` for this choice."""
        return f"{self.name}={self.interface}:{self.channel}"


def choose(
    spec: Spec,
    folder: Path,
    named: Mapping[str, tuple[str | None, str]],
    first: tuple[str, str, int | None] | None,
    *,
    prefer_vcan: bool = True,
) -> dict[str, BusChoice]:
    """Choose a python-can bus for each bus of the spec; the keys are the names of the buses in the spec.

    folder: the folder for the sockets of software buses.
    named: the values of `--bus`: for each bus that is named there, its interface and channel. The interface None stands
        for SocketCAN.
    first: interface, channel and bit rate of the manager's bus, from python-can's flags; None: without these flags.
    prefer_vcan: whether vcan0 is taken for the manager's bus where this machine has it.
    Raises UserError if the manager's bus is named both by `--bus` and by python-can's flags.
    """
    if spec.manager.bus in named and first is not None:
        remedy = "leave --bus out, or leave -i and -c out"
        raise UserError(f"--bus {spec.manager.bus}: this is the manager's bus, which -i and -c already give; {remedy}")
    choices = {}
    for name, bus in spec.buses.items():
        if name == spec.manager.bus and first is not None:
            choices[name] = BusChoice(name, *first, is_ours=False, channels=bus.channels)
        elif name in named:
            interface, channel = named[name]
            choices[name] = BusChoice(
                name, interface or "socketcan", channel, None, is_ours=False, channels=bus.channels
            )
        elif name == spec.manager.bus and prefer_vcan and all(map(has_interface, vcans := _vcans(bus))):
            choices[name] = BusChoice(name, "socketcan", ",".join(vcans), None, is_ours=False, channels=bus.channels)
        else:
            places = ",".join(str(folder / f"{channel}.sock") for channel in _channels(bus))
            choices[name] = BusChoice(name, "softbus", places, bus.bitrate, is_ours=True, channels=bus.channels)
    for choice in choices.values():
        choice.configs()  # so that an error is found before any process starts
    return choices


def hub_paths(choices: Mapping[str, BusChoice]) -> dict[str, str]:
    """Return the paths of the hubs that this run has to start, by bus or channel (`radio`, `can0.1`)."""
    return {
        name if choice.channels == 1 else f"{name}.{number}": config["channel"]
        for name, choice in choices.items()
        if choice.is_ours
        for number, config in enumerate(choice.configs(), start=1)
    }


def _channels(bus: Bus) -> list[str]:
    """Return the names of a bus's channels; a bus that is not replicated has one, with the bus's own name."""
    return [bus.name] if bus.channels == 1 else [f"{bus.name}.{number}" for number in range(1, bus.channels + 1)]


def _vcans(bus: Bus) -> list[str]:
    return [f"vcan{number}" for number in range(bus.channels)]


def has_interface(name: str) -> bool:
    """Tell whether this machine has a network interface of that name."""
    return any(found == name for _, found in socket.if_nameindex())
