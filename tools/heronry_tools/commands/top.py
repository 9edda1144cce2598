"""`heronry top`: a system in a terminal, live or recorded; `--json` gives its snapshots to programs."""

import argparse
import json
import select
import sys
import time
from typing import TYPE_CHECKING, Any

from heronry_tools.sources.arguments import EXAMPLES, add_source_arguments

if TYPE_CHECKING:
    from heronry_tools.watch.top.sources import TopSource

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
_PERIOD_S = 0.5


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
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Show the system in the terminal until the user quits, or print what --json or --schema request; returns 0.

    Raises UserError if there is no terminal to show the system in, or if the options do not fit together.
    """
    from heronry_tools.console.errors import UserError  # noqa: PLC0415 - with all below slow to import

    if arguments.schema:
        from heronry_tools.watch.schema import schema_text  # noqa: PLC0415

        sys.stdout.write(schema_text())
        return 0
    if arguments.once and not arguments.json:
        raise UserError("--once prints one snapshot as JSON: add --json")
    if not arguments.json and not (sys.stdout.isatty() and sys.stderr.isatty()):  # Textual writes to both
        raise UserError("there is no terminal to show the system in: add --json, for snapshots as JSON lines")
    from heronry_tools.sources.opened import opened_source  # noqa: PLC0415
    from heronry_tools.watch.top.sources import RecordedSource, source_of  # noqa: PLC0415

    source = source_of(opened_source(arguments))
    if arguments.at is not None:
        if not isinstance(source, RecordedSource):
            source.close()
            raise UserError("--at is a time in a recording: add --log FILE, or leave --at out")
        source.move_to(source.timeline.begins_ns + round(arguments.at * 1e9))
    if arguments.json:
        return _print(source, once=arguments.once)
    from heronry_tools.watch.top.app import run_top  # noqa: PLC0415

    run_top(source)
    return 0


def _print(source: "TopSource", *, once: bool) -> int:
    """Print snapshots as JSON; returns 0.

    Of a recording, print the one snapshot at its cursor. Of a live system, print one every half second until
    the command is interrupted.

    once: of a live system, print only the first snapshot.
    """
    from heronry_tools.watch.snapshot import document  # noqa: PLC0415

    try:
        while True:
            until_s = time.monotonic() + _PERIOD_S
            source.look()
            while not source.is_recorded and (left_s := until_s - time.monotonic()) > 0:
                select.select(source.readers(), [], [], min(left_s, 0.1))
                source.look()
            print(json.dumps(document(source.snapshot()), separators=(",", ":")), flush=True)
            if once or source.is_recorded:
                return 0
    finally:
        source.close()
