"""Finds out from the command line which python-can bus each port of a PE uses.

python-can's own flags (and can.conf, and CAN_*) name the uplink, the bus toward the manager. `--bus
NAME=[INTERFACE:]CHANNEL` names any bus of the table; without INTERFACE the interface is that of the flags. The table
gives the bit rate, unless a flag gives another one for the uplink. The bit rate of a radio is that of its air link, and
is not passed to the adapter (an slcan modem takes only the rates of CAN controllers). For a replicated bus both
channels must be named.
"""

import argparse
from collections.abc import Sequence
from typing import Any

from heronry_wire.bus_arguments import BusArgumentError, channel_configs, flagged_bus, named_buses
from heronry_wire.pe_table import PeTable


def bus_configs(table: PeTable, arguments: argparse.Namespace, named: Sequence[str]) -> list[list[dict[str, Any]]]:
    """Keyword arguments of `can.Bus` by port and channel; `named`: the values of `--bus`. Raises BusArgumentError."""
    flags = flagged_bus(arguments)
    places = named_buses(named, table.name, [port.bus for port in table.ports])
    configs = []
    for number, port in enumerate(table.ports):
        if port.bus in places:
            interface, channel = places[port.bus]
            config = {"interface": interface or flags.get("interface"), "channel": channel}
        elif number == table.uplink:
            config = flags
        else:
            remedy = f"add --bus {port.bus}=INTERFACE:CHANNEL"
            raise BusArgumentError(f"bus {port.bus} of {table.name} has no channel; {remedy}")
        rate = {} if "timing" in config or port.wireless else {"bitrate": port.bitrate}
        config = {**rate, **{key: value for key, value in config.items() if value is not None}}
        configs.append(channel_configs(config, port.channels, f"bus {port.bus} of {table.name}"))
    return configs
