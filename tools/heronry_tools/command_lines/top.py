"""The command line of `heronry top`: arguments, their help, and examples."""

from typing import Any

from heronry_tools.console.source_arguments import EXAMPLES, add_source_arguments

_EPILOG = f"""\
examples:
{EXAMPLES.format(command="top")}\
  heronry top --log FOLDER                      a folder of 'heronry record'
  heronry top --log story.scenario              a scenario, flown in the simulator now
  heronry top --json | jq -c '.functions | map_values(.served)'
  heronry top --once --json --log flight.log big_blue --at 3.5
  heronry top --schema                          the JSON schema of a snapshot

Shown are phase, epoch and term, the load of the buses, PEs, functions with the reason why one is lost, the modules of
the selected PE, the last reconfigurations with their four times, and events. Press ? for the keys. Nothing is ever
sent on a bus, and a manager is not held up. Needs: pip install "heronry[watch]"
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry top`."""
    parser = subparsers.add_parser(
        "top",
        description="Watch a system in a terminal: live from its manager, live from a bus, or from a recording.",
        epilog=_EPILOG,
    )
    add_source_arguments(parser)
    parser.add_argument(
        "--at",
        type=float,
        metavar="SECONDS",
        help="show a recording as it stood SECONDS after its start (default: at its end)",
    )
    parser.add_argument("--json", action="store_true", help="print a snapshot twice a second, one JSON object a line")
    parser.add_argument("--once", action="store_true", help="with --json: print one snapshot, and end")
    parser.add_argument("--schema", action="store_true", help="print the JSON schema of a snapshot, and end")
