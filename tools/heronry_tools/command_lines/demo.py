"""The command line of `heronry demo`: arguments, their help, and examples."""

import argparse
from pathlib import Path
from typing import Any

from heronry_tools.console.contingencies_argument import add_contingencies_argument
from heronry_tools.console.flight_limits import DEMO_S, LONGEST_DEMO_S
from heronry_tools.console.spec_argument import add_spec_argument
from heronry_wire.bus_arguments import add_bus_arguments

_LONGEST_HEARTBEAT_MS = 10_000
_EPILOG = """\
examples:
  heronry demo                                        big_blue; the PE with most modules (wing) is killed, and back
  heronry demo --kill pe:nav@3 --kill pe:tail_a@3.01  two at once
  heronry demo elevator_and_chute --for 8 --record flight.log
  heronry demo --phase landing@3 --kill pe:flight@6   a phase with other priorities, from the third second on
  heronry demo --no-kill --for 60                     nothing fails; give orders beside it: heronry fail device:gps
  heronry demo --from 210 --for 40                    the landing
  heronry demo --key fleet.key                        every command and every state carries a proof
  heronry demo -i socketcan -c vcan0                  on a real SocketCAN interface
  heronry demo twin.dg.yaml -i socketcan -c vcan0,vcan1     the two channels of a bus with 'channels: 2'
  heronry demo --kill manager@5                       a standby manager runs, and takes over
  heronry demo --web                                  and watch it in a browser, until Ctrl-C
  heronry demo --json | jq 'select(.event=="reconfigured").times_ns'

Times are in seconds after the first configuration runs. Ctrl-C ends the demo; no process is left behind.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry demo`."""
    parser = subparsers.add_parser(
        "demo",
        description="Start the bus (if needed), the manager and every PE, each as a process; kill and restart PEs.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser, default="big_blue")
    parser.add_argument(
        "--kill",
        metavar="pe:NAME@SECONDS",
        action="append",
        default=[],
        help="kill a PE at this time, or the active manager (manager@SECONDS), by SIGKILL",
    )
    parser.add_argument("--no-kill", action="store_true", help="kill nothing during the flight")
    parser.add_argument(
        "--restore", metavar="pe:NAME@SECONDS", action="append", default=[], help="start a killed PE again at this time"
    )
    parser.add_argument(
        "--phase", metavar="NAME@SECONDS", action="append", default=[], help="order a mission phase at this time"
    )
    parser.add_argument(
        "--for",
        dest="seconds",
        metavar="SECONDS",
        type=_seconds,
        help=f"seconds to run; up to 15 s more while a reconfiguration is not complete (default: {DEMO_S:.0f})",
    )
    parser.add_argument(
        "--from",
        dest="aloft_s",
        metavar="SECONDS",
        type=_seconds,
        default=0.0,
        help="begin SECONDS after take-off: at 90 the aircraft will soon leave the balloon, from 240 on it has landed",
    )
    parser.add_argument(
        "--heartbeat",
        dest="heartbeat_ns",
        metavar="MS",
        type=_heartbeat_ns,
        help="fly with heartbeats of MS where the spec has shorter ones (default: what this computer keeps in a short "
        "rehearsal, with --web beside the load of a page)",
    )
    parser.add_argument("--record", metavar="FILE.log", type=Path, help="write a candump log of all buses")
    add_contingencies_argument(
        parser,
        "for the manager and for the tables of the PEs",
        "the plans for every single fault; a demo that finds none makes them in the background, for the next one",
    )
    parser.add_argument(
        "--key", metavar="FILE", type=Path, help="the key file from 'heronry key', for the manager and every PE"
    )
    parser.add_argument(
        "--web",
        action="store_true",
        help="also serve a page for a browser on this computer, and print its address; the demo goes on until Ctrl-C",
    )
    parser.add_argument(
        "--devices",
        metavar="FILE",
        type=Path,
        help="JSON file with the drivers of real devices; all other devices are simulated",
    )
    parser.add_argument("--json", action="store_true", help="print the event stream as JSON lines instead of sentences")
    parser.add_argument(
        "--bus",
        metavar="NAME=[INTERFACE:]CHANNEL",
        action="append",
        default=[],
        help="use this channel for a bus of the spec other than the manager's (default: a software bus)",
    )
    add_bus_arguments(parser, "the manager's bus (default: vcan0 where there is one, else a software bus)")


def _seconds(text: str) -> float:
    """Read a time in seconds, 0 to LONGEST_DEMO_S.

    Raises ArgumentTypeError for any other number, and ValueError for a text that is no number.
    """
    seconds = float(text)
    if not 0 <= seconds <= LONGEST_DEMO_S:
        raise argparse.ArgumentTypeError(
            f"{text} is not a time in the demo; write a number of seconds from 0 to {LONGEST_DEMO_S:.0f}"
        )
    return seconds


def _heartbeat_ns(text: str) -> int:
    """Read a heartbeat period in ms, 1 to 10 000; gives ns. Raises ArgumentTypeError for any other number."""
    period_ms = float(text)
    if not 1 <= period_ms <= _LONGEST_HEARTBEAT_MS:
        raise argparse.ArgumentTypeError(
            f"{text} is not a heartbeat period; write a number of milliseconds from 1 to {_LONGEST_HEARTBEAT_MS}"
        )
    return round(period_ms * 1_000_000)
