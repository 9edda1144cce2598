"""`heronry softbus`: runs a CAN bus in software, for computers without vcan (the virtual CAN of Linux)."""

import argparse

from heronry_tools.runtime.softbus.serving import serve


def run(arguments: argparse.Namespace) -> int:
    """Serve the bus until it is stopped; returns the exit code."""
    return serve(arguments.channel, arguments.bitrate, until_eof=arguments.until_eof)
