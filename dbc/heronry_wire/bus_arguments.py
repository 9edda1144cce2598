"""Which python-can bus is meant, from a command line.

python-can's own flags (`can.cli.add_bus_arguments`) name one bus; what no flag says is left to can.conf and CAN_*.
`--bus NAME=[INTERFACE:]CHANNEL` names the bus of a spec. A channel may hold colons itself (a path, an address): only
the name of an interface that python-can knows counts as one.
"""

import argparse
from collections.abc import Collection, Sequence
from typing import Any

import can

from heronry_wire.errors import HeronryError

_FLAGS = ("channel", "interface", "bitrate", "timing")


class BusArgumentError(HeronryError):
    """The command line does not say which bus is meant; the message is one sentence with the remedy."""


def flagged_bus(arguments: argparse.Namespace) -> dict[str, Any]:
    """Keyword arguments of `can.Bus` that python-can's flags stand for; only those that were given."""
    named = {flag: getattr(arguments, flag) for flag in _FLAGS if hasattr(arguments, flag)}
    return {**named, **getattr(arguments, "bus_kwargs", {})}


def named_buses(texts: Sequence[str], owner: str, buses: Collection[str]) -> dict[str, tuple[str | None, str]]:
    """Read the values of `--bus`: bus -> (interface, channel); the interface is None where none is given.

    `owner` has the `buses`, for the message. Raises BusArgumentError.
    """
    named: dict[str, tuple[str | None, str]] = {}
    for text in texts:
        name, equals, place = text.partition("=")
        if not (equals and place):
            example = f"{next(iter(buses))}=socketcan:can0"
            raise BusArgumentError(f"--bus {text}: write it as NAME=[INTERFACE:]CHANNEL, such as {example}")
        if name not in buses:
            raise BusArgumentError(f"--bus {name}: {owner} has no such bus; it has {', '.join(buses)}")
        if name in named:
            raise BusArgumentError(f"--bus {name} is given twice; name one channel")
        interface, colon, channel = place.partition(":")
        named[name] = (interface, channel) if colon and interface in can.VALID_INTERFACES else (None, place)
    return named
