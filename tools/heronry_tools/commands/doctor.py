"""`heronry doctor`: whether this computer is fit to fly as a node, and for each problem a command that helps.

Exit codes: 0 everything is right, 1 something is not, 2 the command line cannot be used.
"""

import argparse
import select
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from heronry_tools.console.errors import UserError
from heronry_tools.console.progress import Working
from heronry_tools.reports.findings import Finding, all_right, as_json, as_text
from heronry_tools.runtime.doctor.asking import ask_tables, assess_tables
from heronry_tools.runtime.doctor.computer import assess_computer, assess_wake_ups, knows_can
from heronry_tools.runtime.doctor.expected import Expected, expected_by_table
from heronry_tools.runtime.doctor.interface import assess_interface
from heronry_tools.runtime.doctor.listening import BusNamed, Hearing, assess_channels, assess_hearing
from heronry_tools.runtime.wake_ups import latest_wake_up_ns
from heronry_wire.arrival_times import ArrivalTimes
from heronry_wire.bus_arguments import channel_configs, channels_named, flagged_bus
from heronry_wire.bus_opening import LinkError, Opened, open_bus
from heronry_wire.can_interface import read_interface
from heronry_wire.channel_merge import ChannelMerge
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS
from heronry_wire.python_can import frame_of

_PAUSE_S = 0.5
_REHEARSAL_S = 1.0  # length of the rehearsal of one node, which measures how late the node wakes


def run(arguments: argparse.Namespace) -> int:
    """Check everything and report; returns 0, or 1 where a finding is not right."""
    if not 0 < arguments.seconds <= 600:
        raise UserError(f"--seconds {arguments.seconds:g}: listen for more than 0 and up to 600 s")
    until_s = time.monotonic() + arguments.wait
    findings = list(_findings(arguments))
    while not all_right(findings) and time.monotonic() < until_s:
        time.sleep(_PAUSE_S)
        findings = list(_findings(arguments))
    print(as_json(findings) if arguments.json else "\n".join(as_text(findings, "this node is fit")))
    return 0 if all_right(findings) else 1


def _findings(arguments: argparse.Namespace) -> Iterator[Finding]:
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
        with Working(f"listening to {', '.join(buses)}"):
            heard = _listen(buses, arguments.seconds, None if expected is None else expected.heartbeat_ns)
            asked = set(heard.incarnations)
            if expected is not None and expected.asked is not None:
                asked &= expected.asked
            answers = ask_tables(next(iter(buses.values())).bus, asked)
    yield from assess_hearing(heard, expected, arguments.seconds, bus)
    if len(buses) > 1:
        yield assess_channels(heard, expected)
    yield from assess_tables(answers, expected)


def _expected(text: str) -> Expected:
    if text.endswith(".table"):
        return expected_by_table(Path(text))
    from heronry_tools.runtime.doctor.expected_by_spec import expected_in  # noqa: PLC0415 - a node lacks pydantic

    return expected_in(text)


def _listen(buses: dict[str, Opened], seconds: float, heartbeat_ns: int | None) -> Hearing:
    """Listen to the channels of one bus; counts each frame once, and notes on which channels each node is heard."""
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
