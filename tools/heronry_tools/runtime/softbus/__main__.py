"""Run a hub: `python -m heronry_tools.runtime.softbus PATH -b 1000000`, until Ctrl-C or SIGTERM."""

import argparse
import signal
import socket
import sys
from pathlib import Path

from heronry_tools.console.errors import exit_code
from heronry_tools.runtime.softbus.address import HubError
from heronry_tools.runtime.softbus.hub import Hub

DEFAULT_BITRATE = 1_000_000
MIN_BITRATE, MAX_BITRATE = 1_000, 1_000_000  # ISO 11898-2 ends at 1 Mbit/s; below 1 kbit/s nothing is useful


def main(arguments: list[str] | None = None) -> int:
    """Run a hub and return the exit status."""
    options = _parser().parse_args(arguments)
    stop, wake = socket.socketpair()
    stop.setblocking(False)
    wake.setblocking(False)
    signal.set_wakeup_fd(wake.fileno())
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)  # the wake-up itself ends the loop
    try:
        hub = Hub(options.path, options.bitrate)
    except HubError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"softbus {options.path}: {options.bitrate} bit/s", flush=True)
    stop_fds = [stop.fileno()]
    if options.until_eof:
        stop_fds.append(sys.stdin.fileno())
    try:
        hub.run(stop_fds)
    finally:
        hub.close()
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m heronry_tools.runtime.softbus",
        description="Run a software CAN bus. Clients reach it with python-can: -i softbus -c PATH.",
    )
    parser.add_argument("path", type=Path, help="where to make the bus's UNIX socket")
    parser.add_argument("-b", "--bitrate", type=_bitrate, default=DEFAULT_BITRATE, help="bit/s (default: %(default)s)")
    parser.add_argument(
        "--until-eof", action="store_true", help="end when standard input ends, which the starting process holds open"
    )
    return parser


def _bitrate(text: str) -> int:
    if not text.isdecimal() or not MIN_BITRATE <= int(text) <= MAX_BITRATE:
        raise argparse.ArgumentTypeError(f"{text!r} is not a bit rate from {MIN_BITRATE} to {MAX_BITRATE} bit/s")
    return int(text)


if __name__ == "__main__":
    sys.exit(exit_code(main, "softbus"))
