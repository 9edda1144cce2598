"""The command line of `heronry manager`: arguments, their help, and examples."""

import argparse
from pathlib import Path
from typing import Any

from heronry_tools.console.contingencies_argument import add_contingencies_argument
from heronry_tools.console.spec_argument import add_spec_argument
from heronry_wire.bus_arguments import add_bus_arguments

_EPILOG = """\
examples:
  heronry manager big_blue -i socketcan -c can0
  heronry manager my.dg.yaml -i softbus -c /tmp/can0.sock -b 1000000 --json | tee events.jsonl
  heronry manager my.dg.yaml -c vcan0 --state-dir /var/lib/heronry
  heronry manager big_blue -i socketcan -c can0 --advise
  heronry manager twin.dg.yaml -i socketcan -c can0,can1           the manager's bus has 'channels: 2'
  heronry manager big_blue -i socketcan -c can0 --key fleet.key
  heronry manager big_blue -i socketcan -c can0 --standby          the standby manager, node 127, on another computer
  heronry manager big_blue -i socketcan -c can0 --standby --node 126     follows, as node 126, an active manager 127
  heronry manager big_blue --contingencies big_blue.contingencies -i socketcan -c can0

The manager listens first. If it hears another manager on the bus, it ends, or with --standby follows that manager.
Where the spec has several buses, -c is the bus that the spec's 'manager: {bus: ...}' names. python-can's can.conf and
CAN_* variables are read, too. 'heronry status', 'phase', 'fail' and 'clear' on the same computer give it orders.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry manager`."""
    parser = subparsers.add_parser(
        "manager",
        description="Run the system manager of one spec: follow the PEs, make plans, and deploy them.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("--node", type=int, choices=(126, 127), help="node-ID (default: 126; with --standby: 127)")
    parser.add_argument(
        "--state-dir",
        type=Path,
        metavar="DIR",
        help="folder of the manager's journal (default: in the user's state folder)",
    )
    parser.add_argument(
        "--changed-spec",
        action="store_true",
        help="accept a journal written for an older SPEC: continue its terms and epochs, forget its faults and phase",
    )
    parser.add_argument(
        "--key",
        type=Path,
        metavar="FILE",
        help="the key file from 'heronry key': frames without a proof of this key are refused",
    )
    parser.add_argument(
        "--standby",
        action="store_true",
        help="follow the active manager, and take over when the PEs hear it no more",
    )
    add_contingencies_argument(parser, "for this manager")
    parser.add_argument(
        "--advise",
        action="store_true",
        help="report what this manager would do, and send nothing: allowed on a bus with an active manager",
    )
    parser.add_argument(
        "--socket",
        type=Path,
        metavar="PATH",
        help="the socket on which 'heronry status' and other commands reach this manager (default: named after SPEC)",
    )
    parser.add_argument(
        "--bundles",
        type=Path,
        metavar="DIR",
        help="bring code that a PE lacks over the bus: the folder of the bundles ('heronry bundle')",
    )
    parser.add_argument("--json", action="store_true", help="print events as JSON lines instead of sentences")
    parser.add_argument("--slower-heartbeat-ns", type=int, default=0, help=argparse.SUPPRESS)  # as the PEs of a demo
    parser.add_argument("--until-eof", action="store_true", help="end when standard input ends")
    add_bus_arguments(parser, "the manager's bus")
