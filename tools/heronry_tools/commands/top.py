"""`heronry top`: a system in a terminal, live or recorded; `--json` gives its snapshots to programs."""

import argparse
import json
import select
import sys
import time

from heronry_tools.console.errors import UserError
from heronry_tools.sources.opened import opened_source
from heronry_tools.watch.schema import schema_text
from heronry_tools.watch.snapshot import document
from heronry_tools.watch.top.sources import RecordedSource, TopSource, source_of

_PERIOD_S = 0.5


def run(arguments: argparse.Namespace) -> int:
    """Show the system in the terminal until the user quits, or print what --json or --schema request; returns 0.

    Raises UserError if there is no terminal to show the system in, or if the options do not fit together.
    """
    if arguments.schema:
        sys.stdout.write(schema_text())
        return 0
    if arguments.once and not arguments.json:
        raise UserError("--once prints one snapshot as JSON: add --json")
    if not arguments.json and not (sys.stdout.isatty() and sys.stderr.isatty()):  # Textual writes to both
        raise UserError("there is no terminal to show the system in: add --json, for snapshots as JSON lines")
    source = source_of(opened_source(arguments))
    if arguments.at is not None:
        if not isinstance(source, RecordedSource):
            source.close()
            raise UserError("--at is a time in a recording: add --log FILE, or leave --at out")
        source.move_to(source.timeline.begins_ns + round(arguments.at * 1e9))
    if arguments.json:
        return _print(source, once=arguments.once)
    from heronry_tools.watch.top.app import run_top  # noqa: PLC0415 - textual, which --json does not need

    run_top(source)
    return 0


def _print(source: TopSource, *, once: bool) -> int:
    """Print snapshots as JSON; returns 0.

    Of a recording, print the one snapshot at its cursor. Of a live system, print one every half second until
    the command is interrupted.

    once: of a live system, print only the first snapshot.
    """
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
