"""Finds out from the command line which CAN interface and channel each port of a PE uses.

The flags of python-can (or can.conf, or variables CAN_*) name the channel of the uplink. `--bus
NAME=[INTERFACE:]CHANNEL` names the channel of any bus in the table; without INTERFACE, the interface of the flags is
used. The bit rate comes from the table, unless a flag gives another one for the uplink. For a radio, the table has the
bit rate of the radio link. This rate is not passed to the adapter (an slcan modem takes only the rates of CAN
controllers). For a replicated bus both channels must be named.
"""

import argparse
from collections.abc import Sequence
from typing import Any

from heronry_wire.bus_arguments import BusArgumentError, channel_configs, flagged_bus, named_buses
from heronry_wire.pe_table import PeTable


def bus_configs(table: PeTable, arguments: argparse.Namespace, named: Sequence[str]) -> list[list[dict[str, Any]]]:
    """Return the keyword arguments of `can.Bus` for each channel of each port; raises BusArgumentError.

    named: the values of `--bus`.
    """
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
            raise BusArgumentError(f"no channel is given for bus {port.bus} of PE {table.name}; {remedy}")
        rate = {} if "timing" in config or port.wireless else {"bitrate": port.bitrate}
        config = {**rate, **{key: value for key, value in config.items() if value is not None}}
        configs.append(channel_configs(config, port.channels, f"bus {port.bus} of {table.name}"))
    return configs
