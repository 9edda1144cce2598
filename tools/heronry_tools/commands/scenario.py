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
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.output import JSON, add_output
from heronry_tools.console.progress import show_line

if TYPE_CHECKING:
    from heronry_tools.sim.scenario.flown import Flown
    from heronry_tools.sim.scenario.script import Script

_LONGEST_PATIENCE = 100
_EPILOG = """\
A scenario file:

  # A processor dies; another one takes its work.    why it exists
  spec elevator_and_chute                            a shipped spec, or a file (path from this folder)
  seed 7
  at 2.0s kill pe:control_pe                         also restore, phase, fail, clear, and every fault of the simulator
  expect function:elevator served within 200ms       evaluated from frames: what is heard on the bus
  at 4.0s restore pe:control_pe
  expect pe:control_pe active within 2s
  end 8s

In the simulator the decisions of the manager are compared with FILE.golden, where there is one.

examples:
  heronry scenario tests/scenarios/*.scenario           in the simulator
  heronry scenario new.scenario --rewrite               keep its decisions as the golden trace
  heronry scenario kill.scenario -i softbus             real processes on software buses of its own
  heronry scenario kill.scenario -i socketcan -c vcan0  real processes, the manager's bus is vcan0
  heronry scenario kill.scenario -i softbus --patience 5  on a busy computer
  heronry scenario *.scenario -o results.xml                  as JUnit XML, for CI
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry scenario`."""
    from heronry_wire.bus_arguments import add_bus_arguments  # noqa: PLC0415 - python-can is slow to import

    parser = subparsers.add_parser(
        "scenario",
        description="Fly scenario files, in the simulator or with real processes, and check what they expect.",
        epilog=_EPILOG,
    )
    parser.add_argument("files", metavar="FILE", nargs="+", type=Path, help="scenario files")
    add_output(parser, "write one JSON object per file", {"text": (), "json": JSON, "junit": (".xml",)})
    parser.add_argument(
        "--rewrite", action="store_true", help="write FILE.golden anew, if every expectation holds (simulator only)"
    )
    parser.add_argument(
        "--patience",
        metavar="N",
        type=_patience,
        help="for real processes on a busy computer: 'within 80ms' then means N times 80 ms (N: 1 to 100; default 1)",
    )
    add_bus_arguments(parser, "real processes, with this bus for the manager (default: the simulator)")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Fly every file; returns the exit code."""
    from heronry_tools.sim.scenario.report import document, junit, text_report  # noqa: PLC0415 - loads the solver
    from heronry_tools.sim.scenario.script import read_script  # noqa: PLC0415

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


def _flown(arguments: argparse.Namespace, scripts: list["Script"]) -> Iterator["Flown"]:
    from dataclasses import replace  # noqa: PLC0415

    from heronry_tools.sim.flight.flyable import check_images  # noqa: PLC0415
    from heronry_tools.sim.scenario import in_simulator, live  # noqa: PLC0415
    from heronry_tools.sim.scenario.trace import golden_file, keep, kept  # noqa: PLC0415

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


def _patience(text: str) -> float:
    """Read the factor, 1 to 100, by which the times after `within` are multiplied; raises ArgumentTypeError."""
    try:
        times = float(text)
    except ValueError:
        times = 0.0
    if not 1 <= times <= _LONGEST_PATIENCE:
        raise argparse.ArgumentTypeError(
            f"the times after 'within' cannot be multiplied by {text}; write a number from 1 to 100"
        )
    return times
