"""Reads from a command line which buses of python-can a program is to use.

python-can's own flags (`can.cli.add_bus_arguments`) name one bus; a value that no flag gives comes from can.conf or an
environment variable CAN_*. An option `--bus NAME=[INTERFACE:]CHANNEL` tells which channel is the bus NAME of the spec.
A channel may itself contain colons (a path, an address): the text before a colon is an interface only if python-can
knows an interface of that name.

A replicated bus has two channels, named with a comma between them in every place that names a channel: `-c can0,can1`,
`--bus main=can0,can1`, `channel = can0,can1` in can.conf. The second channel may have another interface: `-c
can0,slcan:/dev/ttyUSB0`. Where a bus has one channel, a comma is part of the channel's name.
"""

import argparse
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from heronry_wire.bare_can import can
from heronry_wire.errors import HeronryError

_FLAGS = ("channel", "interface", "bitrate", "timing")


class BusArgumentError(HeronryError):
    """The command line names no bus, or names one wrongly; the message is one sentence with the remedy."""


def add_bus_arguments(parser: argparse.ArgumentParser, title: str) -> None:
    """Add python-can's flags for a bus to `parser`, as a group with this title."""
    can.cli.add_bus_arguments(parser, group_title=title)
    flag = next(action for action in parser._actions if action.dest == "interface")  # noqa: SLF001 - no public way
    flag.metavar, flag.help = "INTERFACE", "kind of the bus: socketcan, softbus, or any other interface of python-can"


def flagged_bus(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the keyword arguments of `can.Bus` for those of python-can's flags that the command line has."""
    named = {flag: getattr(arguments, flag) for flag in _FLAGS if hasattr(arguments, flag)}
    return {**named, **getattr(arguments, "bus_kwargs", {})}


def named_buses(texts: Sequence[str], owner: str, buses: Collection[str]) -> dict[str, tuple[str | None, str]]:
    """Read the values of `--bus`: give (interface, channel) by bus; the interface is None where the value names none.

    owner: name of the node that has these `buses`, for error messages. Raises BusArgumentError.
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
            raise BusArgumentError(f"--bus {name} is given twice; give it once")
        named[name] = _placed(place)
    return named


def channel_configs(config: Mapping[str, Any], channels: int, bus: str) -> list[dict[str, Any]]:
    """Split the configuration of a bus into one configuration for each channel.

    config, result: keyword arguments of `can.Bus`. channels: number of channels that the bus has. bus: name of the bus,
    for the error message. Raises BusArgumentError where the configuration names more or fewer channels.
    """
    if channels == 1:
        return [dict(config)]
    named = str(config.get("channel") or _default_channel(config))
    names = [name.strip() for name in named.split(",")]
    if len(set(names) - {""}) != channels:
        say = "name both with a comma between them, for example -c can0,can1"
        raise BusArgumentError(f"{bus} has {channels} channels, and '{named}' names {len(set(names) - {''})}; {say}")
    return [{**config, **_channel(name)} for name in names]


def channels_named(config: Mapping[str, Any]) -> int:
    """Count the channels that the configuration of a bus names, for a program that has no spec to tell their number."""
    return len(str(config.get("channel") or "").split(","))


def _placed(place: str) -> tuple[str | None, str]:
    interface, colon, channel = place.partition(":")
    return (interface, channel) if colon and interface in can.VALID_INTERFACES else (None, place)


def _channel(name: str) -> dict[str, str]:
    interface, channel = _placed(name)
    return {"channel": channel} if interface is None else {"interface": interface, "channel": channel}


def _default_channel(config: Mapping[str, Any]) -> str:
    try:
        return str(can.util.load_config(config=dict(config)).get("channel") or "")
    except (can.CanError, ValueError):
        return ""
