"""The command line of `heronry softbus`: arguments, their help, and examples."""

import argparse
from typing import Any

from heronry_tools.console.bus_flags import SOFTWARE_BUS

MIN_BITRATE, MAX_BITRATE = 1_000, 1_000_000  # ISO 11898-2 ends at 1 Mbit/s; below 1 kbit/s nothing is useful
_EPILOG = """\
examples:
  heronry softbus                                 the bus can0 of this user: all others find it by -i softbus -c can0
  heronry softbus radio -b 57600                  a second bus, and a slower one
  heronry softbus ./can0.sock                     at a path: a name with a slash is a path
  heronry manager elevator_and_chute -i softbus -c can0
  pe-agent --table tail.table -i softbus -c can0
  heronry demo -i softbus -c can0                 the demo, on this bus

A frame takes its exact time at the bit rate, and the frame with the lowest identifier goes first, as on a wire. There
are no bit errors and no bus-off. Ctrl-C ends the bus; nodes wait until it is back.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry softbus`."""
    parser = subparsers.add_parser(
        "softbus",
        description="Run a CAN bus in software, until Ctrl-C. Programs of this user reach it with -i softbus -c NAME.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "channel",
        metavar="NAME|PATH",
        nargs="?",
        default=SOFTWARE_BUS,
        help="name of the bus, or the path of its UNIX socket: a path has a slash (default: %(default)s)",
    )
    parser.add_argument("-b", "--bitrate", type=_bitrate, default=MAX_BITRATE, help="bit/s (default: %(default)s)")
    parser.add_argument("--until-eof", action="store_true", help="end when standard input ends")


def _bitrate(text: str) -> int:
    if not text.isdecimal() or not MIN_BITRATE <= int(text) <= MAX_BITRATE:
        raise argparse.ArgumentTypeError(f"{text!r} is not a bit rate from {MIN_BITRATE} to {MAX_BITRATE} bit/s")
    return int(text)
