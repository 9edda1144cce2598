"""The command line of `heronry web`: arguments, their help, and examples."""

import argparse
from typing import Any

from heronry_tools.console.source_arguments import EXAMPLES, add_source_arguments

_EPILOG = f"""\
The page shows the dependency graph as it runs, the PEs, every reconfiguration with its times, the load of the buses and
the events. It asks the planner what would follow from a fault, and why a function is not served. It only reads, unless
--operate is given. Then the printed address has a token, and every order needs this token.

Only browsers on this computer are answered. With --listen ADDRESS, browsers on other computers are answered, too, and
need the token even to read. The connection is not encrypted, so rather let ssh carry it, without --listen:
ssh -L 8321:127.0.0.1:8321 COMPUTER

examples:
  heronry demo --web                            a demo, with its page
{EXAMPLES.format(command="web")}\
  heronry web --of big_blue --operate           orders from the page, each after its cost
  heronry web --log story.scenario              a scenario, flown in the simulator now
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry web`."""
    parser = subparsers.add_parser(
        "web",
        description="Serve a page that shows a running or recorded system in a browser.",
        epilog=_EPILOG,
    )
    add_source_arguments(parser)
    parser.add_argument(
        "--listen", metavar="ADDRESS", default="127.0.0.1", help="the address to listen on (default 127.0.0.1)"
    )
    parser.add_argument(
        "--port",
        type=_port,
        metavar="N",
        help="the port (default: 8321, or any free port if 8321 is in use; 0: any free port)",
    )
    parser.add_argument(
        "--operate", action="store_true", help="let the page give orders; it shows first what each order would change"
    )
    parser.add_argument("--json", action="store_true", help="print the address of the page as one JSON object")
    parser.add_argument("--until-eof", action="store_true", help="end when standard input ends")
    parser.add_argument("--starts-later", action="store_true", help=argparse.SUPPRESS)  # the manager, of a demo


def _port(text: str) -> int:
    if not text.isascii() or not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is no port; write a number from 0 to 65535")
    return int(text)
