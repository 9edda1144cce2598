"""python-can's own flags, as `can.cli.add_bus_arguments` defines them, turned into keyword arguments of `can.Bus`."""

import argparse
from typing import Any

_FLAGS = ("channel", "interface", "bitrate", "timing")


def bus_config(arguments: argparse.Namespace) -> dict[str, Any]:
    """Keyword arguments of `can.Bus`; what no flag says is left to can.conf and the environment."""
    named = {flag: getattr(arguments, flag) for flag in _FLAGS if hasattr(arguments, flag)}
    return {**named, **getattr(arguments, "bus_kwargs", {})}
