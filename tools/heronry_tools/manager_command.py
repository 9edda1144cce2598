"""`heronry manager`: the system manager of one spec, on one bus."""

import argparse
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

_EPILOG = """\
examples:
  heronry manager big_blue -i socketcan -c can0
  heronry manager my.dg.yaml -i softbus -c /tmp/can0.sock -b 1000000 --json | tee events.jsonl
  heronry manager my.dg.yaml -c vcan0 --state-dir /var/lib/heronry

It listens first: a bus with another manager on it is left alone. Where the spec has several buses, -c is the one that
the spec's 'manager: {bus: ...}' names. python-can's can.conf and CAN_* variables are honoured.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry manager`."""
    from can.cli import add_bus_arguments  # noqa: PLC0415 - keeps `heronry plan` quick

    from heronry_tools.spec_argument import add_spec_argument  # noqa: PLC0415

    parser = subparsers.add_parser(
        "manager",
        help="run the system manager on a bus",
        description="Follow the PEs, plan, and deploy: the system manager of one spec.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_spec_argument(parser)
    parser.add_argument("--node", type=int, choices=(126, 127), default=126, help="node-ID (default 126)")
    parser.add_argument(
        "--state-dir", type=Path, metavar="DIR", help="where the term is kept over restarts (default: the user's state)"
    )
    parser.add_argument("--json", action="store_true", help="print events as JSON lines instead of sentences")
    parser.add_argument("--until-eof", action="store_true", help="end when standard input ends")
    add_bus_arguments(parser, group_title="the manager's bus")
    parser.set_defaults(run=run)


def default_state_dir(spec_name: str) -> Path:
    """Folder for what must outlive a restart: below XDG_STATE_HOME, one per spec."""
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return Path(home) / "heronry" / spec_name


def run(arguments: argparse.Namespace) -> int:
    """Reign until stopped; returns 0, or 1 where the manager had to end by itself."""
    from heronry_manager.driver import FILTERS, ManagerDriver  # noqa: PLC0415 - loads the planner's client and python-can
    from heronry_manager.planner.client import PlannerClient  # noqa: PLC0415
    from heronry_manager.term_file import next_term  # noqa: PLC0415
    from heronry_tools.bus_flags import bus_config  # noqa: PLC0415
    from heronry_tools.event_printer import print_event  # noqa: PLC0415
    from heronry_tools.screen import screen  # noqa: PLC0415
    from heronry_tools.spec_argument import load_spec, spec_path  # noqa: PLC0415
    from heronry_wire.link import Link  # noqa: PLC0415

    spec = load_spec(arguments.spec)
    tell = print_event if arguments.json else screen(spec)
    link = Link({**bus_config(arguments), "can_filters": FILTERS})
    try:
        with PlannerClient(spec, spec_path(arguments.spec)) as planner:
            planner.wait_until_ready()
            tell(_bus_event(spec.manager.bus, arguments))
            driver = ManagerDriver(spec, link, planner, tell)
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, lambda *_: driver.stop())
            term = next_term(arguments.state_dir or default_state_dir(spec.name))
            reason = driver.run(arguments.node, term, until_eof=arguments.until_eof)
    finally:
        link.close()
    if reason is not None:
        print(f"heronry: {reason}", file=sys.stderr)
    return 0 if reason is None else 1


def _bus_event(name: str, arguments: argparse.Namespace) -> dict[str, Any]:
    from heronry_manager.events import event  # noqa: PLC0415
    from heronry_tools.bus_flags import what_it_models  # noqa: PLC0415

    interface = getattr(arguments, "interface", None) or "can.conf's interface"
    channel = str(getattr(arguments, "channel", None) or "")
    models = f"{name}: {what_it_models(interface, channel)}"
    return event("bus", time.monotonic_ns(), name=name, interface=interface, channel=channel, models=models)
