"""The source that a view watches, as its command line names it: a manager on this computer, a bus, or a recording.

All views have the same arguments:

nothing              the manager of this computer, found as 'heronry status' finds it
--log FILE [SPEC]    a candump log, a folder of 'heronry record', a scenario, or events as JSON lines
SPEC with -i, -c     the frames on the buses of this spec; the view sends nothing
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_argument import add_manager_argument, manager_socket

if TYPE_CHECKING:
    from heronry_dg.model import Spec
    from heronry_tools.runtime.demo.buses import BusChoice
    from heronry_tools.watch.live_feeds import Feed
    from heronry_tools.watch.recordings import Recording
    from heronry_wire.authentication import Key

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
    from heronry_wire.bus_arguments import add_bus_arguments  # noqa: PLC0415 - python-can is slow to import

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
    parser.add_argument(
        "--bus",
        metavar="NAME=[INTERFACE:]CHANNEL",
        action="append",
        default=[],
        help="a bus of SPEC to listen to; may be repeated",
    )
    add_manager_argument(parser)
    add_bus_arguments(parser, "the manager's bus, to listen to")


def opened_source(arguments: argparse.Namespace) -> "Feed | Recording":
    """Open the feed or recording that the command line names; raises UserError, ControlError or LinkError."""
    if arguments.log is None:
        return opened_feed(arguments)
    if _bus_flags(arguments) or arguments.bus or _names_manager(arguments):
        raise UserError(
            "a manager (--of, --socket), a bus (-i, -c, --bus) and a recording (--log): name only one of them"
        )
    from heronry_tools.watch.recordings import open_recording  # noqa: PLC0415 - loads the solver

    return open_recording(arguments.log, arguments.spec, _key(arguments))


def opened_feed(arguments: argparse.Namespace) -> "Feed":
    """Open the manager or the buses that the command line names; raises UserError, ControlError or LinkError."""
    names_bus = bool(_bus_flags(arguments) or arguments.bus)
    if names_bus and _names_manager(arguments):
        raise UserError("a manager (--of, --socket) and a bus (-i, -c, --bus): name only one of them")
    if names_bus:
        return _listened(arguments, _key(arguments))
    if arguments.spec is not None:
        or_log = ("", "") if not hasattr(arguments, "log") else (" or in a log", ", or --log FILE")
        raise UserError(
            f"a spec alone does not say what to watch: to watch {arguments.spec} on a bus{or_log[0]}, add -i and "
            f"-c{or_log[1]}; to follow the manager on this computer, leave the spec out"
        )
    from heronry_tools.watch.live_feeds import FollowedManager  # noqa: PLC0415

    return FollowedManager(manager_socket(arguments))


def _bus_flags(arguments: argparse.Namespace) -> dict[str, object]:
    from heronry_wire.bus_arguments import flagged_bus  # noqa: PLC0415

    return {name: value for name, value in flagged_bus(arguments).items() if value is not None}


def _names_manager(arguments: argparse.Namespace) -> bool:
    return bool(arguments.of or arguments.socket)


def _key(arguments: argparse.Namespace) -> "Key | None":
    from heronry_wire.key_file import read_key  # noqa: PLC0415

    return None if arguments.key is None else read_key(arguments.key)


def _listened(arguments: argparse.Namespace, key: "Key | None") -> "Feed":
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415
    from heronry_tools.watch.live_feeds import ListenedBuses  # noqa: PLC0415
    from heronry_tools.watch.recordings import tables_of  # noqa: PLC0415

    if arguments.spec is None:
        raise UserError("a bus does not name its spec: add the spec, as in 'heronry top big_blue -i socketcan -c can0'")
    spec = load_spec(arguments.spec)
    return ListenedBuses(spec, list(named_choices(spec, arguments)), key=key, tables=tables_of(spec))


def named_choices(spec: "Spec", arguments: argparse.Namespace) -> "Iterator[BusChoice]":
    """Give the buses of a spec that the command line names, by python-can's flags or by --bus."""
    from heronry_tools.runtime.demo.buses import BusChoice  # noqa: PLC0415
    from heronry_wire.bus_arguments import named_buses  # noqa: PLC0415

    flags = _bus_flags(arguments)
    if flags:
        bus = spec.buses[spec.manager.bus]
        interface, channel = str(flags.get("interface", "socketcan")), str(flags.get("channel", ""))
        yield BusChoice(bus.name, interface, channel, None, is_ours=False, channels=bus.channels)
    for name, (interface_, channel) in named_buses(arguments.bus, f"spec {spec.name}", spec.buses).items():
        kind = interface_ or "socketcan"
        yield BusChoice(name, kind, channel, None, is_ours=False, channels=spec.buses[name].channels)
