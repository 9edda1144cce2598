"""Which bus each bus of a spec is, in this run.

The manager's bus is what the user named with python-can's flags; else vcan0 where this machine has one; else a software
bus. Every other bus of the spec is what `--bus NAME=[INTERFACE:]CHANNEL` says, else a software bus.
"""

import socket
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from heronry_dg.model import Spec
from heronry_tools.bus_flags import what_it_models
from heronry_tools.errors import UserError


@dataclass(frozen=True, slots=True)
class BusChoice:
    """One bus of the spec on one python-can bus."""

    name: str
    interface: str
    channel: str
    bitrate: int | None  # None: the interface is set up elsewhere
    is_ours: bool  # a software bus that this run has to start

    def describe(self) -> str:
        """One line for the user: which bus, and what it does not model."""
        return f"{self.name}: {what_it_models(self.interface, self.channel)}"

    def port_argument(self) -> str:
        """The value of `--bus` for this choice."""
        return f"{self.name}={self.interface}:{self.channel}"


def choose(
    spec: Spec,
    folder: Path,
    named: Mapping[str, tuple[str | None, str]],
    first: tuple[str, str, int | None] | None,
    *,
    prefer_vcan: bool = True,
) -> dict[str, BusChoice]:
    """Choose a bus for each bus of the spec; `first` is what python-can's flags said for the manager's bus.

    A bus named without an interface is SocketCAN's. Raises UserError for a bus that is named in both ways.
    """
    if spec.manager.bus in named and first is not None:
        raise UserError(f"--bus {spec.manager.bus}: -i and -c have named that bus already; give one of the two")
    choices = {}
    for name, bus in spec.buses.items():
        if name == spec.manager.bus and first is not None:
            choices[name] = BusChoice(name, *first, is_ours=False)
        elif name in named:
            interface, channel = named[name]
            choices[name] = BusChoice(name, interface or "socketcan", channel, bitrate=None, is_ours=False)
        elif name == spec.manager.bus and prefer_vcan and has_interface("vcan0"):
            choices[name] = BusChoice(name, "socketcan", "vcan0", None, is_ours=False)
        else:
            choices[name] = BusChoice(name, "softbus", str(folder / f"{name}.sock"), bus.bitrate, is_ours=True)
    return choices


def has_interface(name: str) -> bool:
    """Tell whether this machine has a network interface of that name."""
    return any(found == name for _, found in socket.if_nameindex())
