"""Which python-can bus each port of a PE is, from the command line.

python-can's own flags (and can.conf, and CAN_*) name the uplink, the bus toward the manager. `--bus
NAME=[INTERFACE:]CHANNEL` names any bus of the table; without an interface it is that of the flags. The bit rate is the
table's, unless the flags give another for the uplink.
"""

import argparse
from collections.abc import Sequence
from typing import Any

import can

from heronry_wire.errors import HeronryError
from heronry_wire.pe_table import PeTable

_FLAGS = ("channel", "interface", "bitrate", "timing")


class PortError(HeronryError):
    """The command line does not say which bus is meant; the message is one sentence with the remedy."""


def bus_configs(table: PeTable, arguments: argparse.Namespace, named: Sequence[str]) -> list[dict[str, Any]]:
    """Keyword arguments of `can.Bus` for each port; `named` are the values of `--bus`. Raises PortError."""
    flags = {flag: getattr(arguments, flag) for flag in _FLAGS if hasattr(arguments, flag)}
    flags |= getattr(arguments, "bus_kwargs", {})
    by_name = _by_name(table, named, flags.get("interface"))
    configs = []
    for number, port in enumerate(table.ports):
        if port.bus in by_name:
            config = by_name[port.bus]
        elif number == table.uplink:
            config = flags
        else:
            raise PortError(f"bus {port.bus} of {table.name} has no channel; add --bus {port.bus}=INTERFACE:CHANNEL")
        rate = {} if "timing" in config else {"bitrate": port.bitrate}
        configs.append({**rate, **config})
    return configs


def _by_name(table: PeTable, named: Sequence[str], interface: str | None) -> dict[str, dict[str, Any]]:
    buses = [port.bus for port in table.ports]
    by_name: dict[str, dict[str, Any]] = {}
    for text in named:
        name, equals, place = text.partition("=")
        if not (equals and place):
            raise PortError(f"--bus {text}: write it as NAME=[INTERFACE:]CHANNEL, such as {buses[0]}=socketcan:can0")
        if name not in buses:
            raise PortError(f"--bus {name}: {table.name} has no such bus; it has {', '.join(buses)}")
        if name in by_name:
            raise PortError(f"--bus {name} is given twice; name one channel")
        by_name[name] = _config(place, interface)
    return by_name


def _config(place: str, interface: str | None) -> dict[str, Any]:
    first, colon, rest = place.partition(":")
    if colon and first in can.VALID_INTERFACES:
        return {"interface": first, "channel": rest}
    return {"channel": place} if interface is None else {"interface": interface, "channel": place}
