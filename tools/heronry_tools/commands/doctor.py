"""`heronry doctor`: whether this computer is fit to fly as a node, and for each problem a command that helps.

Exit codes: 0 everything is right, 1 something is not, 2 the command line cannot be used.
"""

import argparse
import select
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heronry_tools.console.output import add_output
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS

if TYPE_CHECKING:
    from heronry_tools.reports.findings import Finding
    from heronry_tools.runtime.doctor.expected import Expected
    from heronry_tools.runtime.doctor.listening import Hearing
    from heronry_wire.bus_opening import Opened

_PAUSE_S = 0.5
_REHEARSAL_S = 1.0  # length of the rehearsal of one node, which measures how late the node wakes
_EPILOG = """\
examples:
  heronry doctor -i socketcan -c can0                      the interface, and what is heard on it
  heronry doctor my.dg.yaml -i socketcan -c can0           ... and whether the PEs are those of this spec
  heronry doctor /etc/heronry/nav.table -i socketcan -c can0     on a node, which has only its table
  heronry doctor my.dg.yaml -i socketcan -c can0 --wait 60       after everything was started
  heronry doctor twin.dg.yaml -i socketcan -c can0,can1          a bus with 'channels: 2': which PEs are on only one
  heronry doctor -i socketcan -c can0 --json | jq .findings

The command listens on the bus, and reads from each PE that it hears, by SDO, the digest of the spec of its table. It
sends no commands. Do not use it in flight: there the manager is the only SDO client.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry doctor`."""
    from heronry_wire.bus_arguments import add_bus_arguments  # noqa: PLC0415 - python-can is slow to import

    parser = subparsers.add_parser(
        "doctor",
        description="Check this computer, its CAN interface, and what is heard on the bus.",
        epilog=_EPILOG,
    )
    parser.add_argument(
        "spec", metavar="SPEC", nargs="?", help="what should be on the bus: a spec, or the *.table of a PE"
    )
    parser.add_argument("--seconds", type=float, default=3.0, metavar="S", help="seconds to listen (default 3)")
    parser.add_argument(
        "--wait", type=float, default=0.0, metavar="S", help="repeat until everything is right, for up to S seconds"
    )
    add_output(parser, "write the findings as JSON")
    add_bus_arguments(parser, "the bus")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Check everything and report; returns 0, or 1 where a finding is not right."""
    from heronry_tools.console.errors import UserError  # noqa: PLC0415
    from heronry_tools.reports.findings import all_right, as_json, as_text  # noqa: PLC0415

    if not 0 < arguments.seconds <= 600:
        raise UserError(f"--seconds {arguments.seconds:g}: listen for more than 0 and up to 600 s")
    until_s = time.monotonic() + arguments.wait
    findings = list(_findings(arguments))
    while not all_right(findings) and time.monotonic() < until_s:
        time.sleep(_PAUSE_S)
        findings = list(_findings(arguments))
    print(as_json(findings) if arguments.json else "\n".join(as_text(findings, "this node is fit")))
    return 0 if all_right(findings) else 1


def _findings(arguments: argparse.Namespace) -> Iterator["Finding"]:
    from heronry_tools.reports.findings import Finding  # noqa: PLC0415
    from heronry_tools.runtime.doctor.asking import ask_tables, assess_tables  # noqa: PLC0415
    from heronry_tools.runtime.doctor.computer import assess_computer, assess_wake_ups, knows_can  # noqa: PLC0415
    from heronry_tools.runtime.doctor.interface import assess_interface  # noqa: PLC0415
    from heronry_tools.runtime.doctor.listening import (  # noqa: PLC0415
        BusNamed,
        assess_channels,
        assess_hearing,
    )
    from heronry_tools.runtime.wake_ups import latest_wake_up_ns  # noqa: PLC0415
    from heronry_wire.bus_arguments import channel_configs, channels_named, flagged_bus  # noqa: PLC0415
    from heronry_wire.bus_opening import LinkError, open_bus  # noqa: PLC0415
    from heronry_wire.can_interface import read_interface  # noqa: PLC0415

    expected = None if arguments.spec is None else _expected(arguments.spec)
    flags = {key: value for key, value in flagged_bus(arguments).items() if value is not None}
    bus = BusNamed(str(flags.get("interface")), str(flags.get("channel")))
    is_socketcan = bus.interface == "socketcan"
    yield from assess_computer(needs_can=is_socketcan)
    late_ns = latest_wake_up_ns(1, min(_REHEARSAL_S, arguments.seconds))
    yield assess_wake_ups(late_ns, USUAL_HEARTBEAT_NS if expected is None else expected.heartbeat_ns)
    channels = channels_named(flags) if expected is None else expected.channels
    buses: dict[str, Opened] = {}
    with ExitStack() as stack:
        for config in channel_configs(flags, channels, "the bus"):
            name = str(config.get("channel", "can0"))
            if config.get("interface") == "socketcan" and knows_can():
                bitrate = None if expected is None else expected.bitrate
                found = list(assess_interface(name, read_interface(name), bitrate))
                yield from found
                if not found[0].is_right:
                    continue
            rate = {}  # the nodes ask a software bus for the bit rate of their spec
            if bus.interface == "softbus" and expected is not None and not expected.is_radio:
                rate = {"bitrate": expected.bitrate}
            try:
                buses[name] = open_bus({**rate, **config})
            except LinkError as error:
                if not (is_socketcan and not knows_can()):
                    yield Finding("bus", str(error), "heronry doctor --help   (shows how to name a bus)")
            else:
                stack.enter_context(buses[name].bus)
        if not buses:
            return
        heard = _listen(buses, arguments.seconds, None if expected is None else expected.heartbeat_ns)
        asked = set(heard.incarnations)
        if expected is not None and expected.asked is not None:
            asked &= expected.asked
        answers = ask_tables(next(iter(buses.values())).bus, asked)
    yield from assess_hearing(heard, expected, arguments.seconds, bus)
    if len(buses) > 1:
        yield assess_channels(heard, expected)
    yield from assess_tables(answers, expected)


def _expected(text: str) -> "Expected":
    from heronry_tools.console.spec_argument import load_spec  # noqa: PLC0415
    from heronry_tools.runtime.doctor.expected import expected_by_spec, expected_by_table  # noqa: PLC0415

    if text.endswith(".table"):
        return expected_by_table(Path(text))
    spec = load_spec(text)
    return expected_by_spec(spec, spec.manager.bus)


def _listen(buses: dict[str, "Opened"], seconds: float, heartbeat_ns: int | None) -> "Hearing":
    """Listen to the channels of one bus; counts each frame once, and notes on which channels each node is heard."""
    from heronry_tools.runtime.doctor.listening import Hearing  # noqa: PLC0415
    from heronry_wire.arrival_times import ArrivalTimes  # noqa: PLC0415
    from heronry_wire.channel_merge import ChannelMerge  # noqa: PLC0415
    from heronry_wire.python_can import frame_of  # noqa: PLC0415

    heard, end_s = Hearing(on_channel={name: set() for name in buses}), time.monotonic() + seconds
    merge, times = ChannelMerge(heartbeat_ns or USUAL_HEARTBEAT_NS), {name: ArrivalTimes() for name in buses}
    is_quiet = (
        False  # several frames may have come together; python-can buffers them, and the descriptor shows only the first
    )
    while (left_s := end_s - time.monotonic()) > 0:
        if is_quiet:
            select.select([opened.fileno for opened in buses.values()], [], [], min(left_s, 0.1))
        heard.clocks(time.time_ns(), time.monotonic_ns())
        is_quiet = True
        for number, (name, opened) in enumerate(buses.items()):
            times[name].look()
            message = opened.bus.recv(0)
            if message is None:
                times[name].found_empty()
                continue
            is_quiet = False
            frame = frame_of(message)
            heard.take_copy(name, frame)
            arrived_ns = times[name].arrived_ns(message)
            if len(buses) == 1 or frame.error or merge.take(number, frame, arrived_ns):
                heard.take(frame, arrived_ns)
    return heard
