"""`heronry scenario`: fly scenario files, and tell whether their expectations hold on the bus.

Exit codes:

    0   every expectation holds
    1   an expectation does not hold; it is printed with its time, and with what was seen instead
    2   a file cannot be read, or one of its actions is not possible in the simulator or on these buses
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace

from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import show_line
from heronry_tools.sim.flight.flyable import check_images
from heronry_tools.sim.scenario import in_simulator, live
from heronry_tools.sim.scenario.flown import Flown
from heronry_tools.sim.scenario.report import document, junit, text_report
from heronry_tools.sim.scenario.script import Script, read_script
from heronry_tools.sim.scenario.trace import golden_file, keep, kept


def run(arguments: argparse.Namespace) -> int:
    """Fly every file; returns the exit code."""
    if arguments.rewrite and _is_live(arguments):
        raise UserError(
            "--rewrite: only in the simulator are decisions the same each time; to fly in the simulator, "
            "leave -i and -c out"
        )
    if arguments.patience is not None and not _is_live(arguments):
        raise UserError("--patience is only for real processes; add -i and -c, or leave --patience out")
    scripts = [read_script(file) for file in arguments.files]
    flights = []
    for flown in _flown(arguments, scripts):
        show_line("")
        flights.append(flown)
        if arguments.format != "junit":
            print(json.dumps(document(flown)) if arguments.json else "\n".join(text_report(flown)), flush=True)
    failed = sum(not flown.holds for flown in flights)
    if arguments.format == "junit":
        sys.stdout.write(junit(flights))
    elif len(flights) > 1 and not arguments.json:
        print(f"{len(flights)} scenarios, {failed} failed")
    return 1 if failed else 0


def _flown(arguments: argparse.Namespace, scripts: list[Script]) -> Iterator[Flown]:

    for script in scripts:  # before the first scenario flies
        if _is_live(arguments):
            live.check(script)
            continue
        check_images(script.spec)
        if not arguments.rewrite:
            kept(script.file)
    for script in scripts:
        show_line(f"flying {script.file}")
        if _is_live(arguments):
            yield live.fly(script, arguments)
            continue
        flown = in_simulator.fly(script, is_compared=not arguments.rewrite)
        if arguments.rewrite and flown.holds:
            keep(script.file, flown.trace)
            flown = replace(flown, differences=())
        elif arguments.rewrite:
            show_line("")
            print(f"heronry: {golden_file(script.file)} is left as it was, since the flight fails", file=sys.stderr)
        yield flown


def _is_live(arguments: argparse.Namespace) -> bool:
    return getattr(arguments, "interface", None) is not None or getattr(arguments, "channel", None) is not None
