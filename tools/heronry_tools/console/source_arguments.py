"""The source that a view watches, as its command line names it: a manager on this computer, a bus, or a recording.

All views have the same arguments:

nothing              the manager of this computer, found as 'heronry status' finds it
--log FILE [SPEC]    a candump log, a folder of 'heronry record', a scenario, or events as JSON lines
SPEC with -i, -c     the frames on the buses of this spec; the view sends nothing
"""

import argparse
from pathlib import Path

from heronry_tools.console.manager_argument import add_manager_argument
from heronry_wire.bus_arguments import add_bus_arguments

EXAMPLES = """\
  heronry {command}                                   the manager on this computer, or of the demo beside this
  heronry {command} --of big_blue-demo                where several managers run
  heronry {command} big_blue -i socketcan -c can0     the bus alone, listening only; no causes
  heronry {command} --log flight.log big_blue         a recorded flight
"""


def add_source_arguments(parser: argparse.ArgumentParser, *, is_live: bool = False) -> None:
    """Add the arguments with which a user names a source: a manager, buses or a recording.

    is_live: leave out the arguments for a recording.
    """
    parser.add_argument(
        "spec",
        metavar="SPEC",
        nargs="?",
        help=f"the spec of the bus{'' if is_live else ' or the log'}: a *.dg.yaml file, or a shipped spec",
    )
    if not is_live:
        parser.add_argument(
            "--log",
            type=Path,
            metavar="FILE",
            help="a candump log, a folder of 'heronry record', a *.scenario, or events of a manager (*.jsonl)",
        )
    parser.add_argument(
        "--key",
        type=Path,
        metavar="FILE",
        help=f"key file that verifies the frames on a bus{'' if is_live else ' or in a log'}, if the flight has a key",
    )
    add_listened_bus(parser)
    add_manager_argument(parser)
    add_bus_arguments(parser, "the manager's bus, to listen to")


def add_listened_bus(parser: argparse.ArgumentParser) -> None:
    """Add the option --bus to a parser: buses of the spec to listen to."""
    parser.add_argument(
        "--bus",
        metavar="NAME=[INTERFACE:]CHANNEL",
        action="append",
        default=[],
        help="a bus of SPEC to listen to; may be repeated",
    )
