"""Finds out from the command line which CAN interface and channel each port of a PE uses.

    --bus NAME=[INTERFACE:]CHANNEL    names the channel of any bus in the table. Without INTERFACE, the interface comes
                                      from the flags of python-can
    flags of python-can               name interface and channel of the uplink, if no `--bus` names the uplink. Instead
                                      of the flags there may be a file can.conf, or variables CAN_*

For a replicated bus both channels must be named.

The bit rate of a wired bus comes from the table, unless a flag gives another one for the uplink. For a radio, no bit
rate is passed to the adapter: the table has the bit rate of the radio link, and an adapter such as an slcan modem
accepts only the rates of CAN controllers.
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
