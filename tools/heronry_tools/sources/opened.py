"""Opens the source that a command line names (`arguments`)."""

import argparse
from collections.abc import Iterator

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_calls import manager_socket
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.demo.buses import BusChoice
from heronry_tools.sources.recordings import open_recording, tables_of
from heronry_tools.watch.live_feeds import Feed, FollowedManager, ListenedBuses
from heronry_tools.watch.recording import Recording
from heronry_wire.authentication import Key
from heronry_wire.bus_arguments import flagged_bus, named_buses
from heronry_wire.key_file import read_key


def opened_source(arguments: argparse.Namespace) -> Feed | Recording:
    """Open the feed or recording that the command line names; raises UserError, ControlError or LinkError."""
    if arguments.log is None:
        return opened_feed(arguments)
    if _bus_flags(arguments) or arguments.bus or _names_manager(arguments):
        raise UserError(
            "a manager (--of, --socket), a bus (-i, -c, --bus) and a recording (--log): name only one of them"
        )

    with Working(f"opening {arguments.log}"):
        return open_recording(arguments.log, arguments.spec, _key(arguments))


def opened_feed(arguments: argparse.Namespace) -> Feed:
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

    return FollowedManager(manager_socket(arguments))


def _bus_flags(arguments: argparse.Namespace) -> dict[str, object]:
    return {name: value for name, value in flagged_bus(arguments).items() if value is not None}


def _names_manager(arguments: argparse.Namespace) -> bool:
    return bool(arguments.of or arguments.socket)


def _key(arguments: argparse.Namespace) -> Key | None:
    return None if arguments.key is None else read_key(arguments.key)


def _listened(arguments: argparse.Namespace, key: Key | None) -> Feed:
    if arguments.spec is None:
        raise UserError("a bus does not name its spec: add the spec, as in 'heronry top big_blue -i socketcan -c can0'")
    spec = load_spec(arguments.spec)
    return ListenedBuses(spec, list(named_choices(spec, arguments)), key=key, tables=tables_of(spec))


def named_choices(spec: Spec, arguments: argparse.Namespace) -> Iterator[BusChoice]:
    """Yield the buses of a spec that the command line names, by python-can's flags or by --bus."""
    flags = _bus_flags(arguments)
    if flags:
        bus = spec.buses[spec.manager.bus]
        interface, channel = str(flags.get("interface", "socketcan")), str(flags.get("channel", ""))
        yield BusChoice(bus.name, interface, channel, None, is_ours=False, channels=bus.channels)
    for name, (interface_, channel) in named_buses(arguments.bus, f"spec {spec.name}", spec.buses).items():
        kind = interface_ or "socketcan"
        yield BusChoice(name, kind, channel, None, is_ours=False, channels=spec.buses[name].channels)
