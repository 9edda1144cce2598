"""The command `pe-agent`: runs the agent of one PE on its buses, from the PE's table.

Exit codes; for 1 and 2 one sentence on standard error gives the reason:

    0   the agent was stopped in order
    1   another node has the PE's node-ID
    2   an option, the table or a bus cannot be used
"""

import argparse
import os
import signal
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.authority import Secret
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.vocabulary import Note
from heronry_agent.shell.device_choice import read_devices
from heronry_agent.shell.devices import PLANT
from heronry_agent.shell.driver import AgentDriver, is_abandoned
from heronry_agent.shell.image_catalogues import why_not_here
from heronry_agent.shell.incarnation import BootCount
from heronry_agent.shell.node_devices import NodeDevices
from heronry_agent.shell.offer import offer
from heronry_agent.shell.own_node_id import NodeId, OwnNodeId
from heronry_agent.shell.partition_groups import open_groups
from heronry_agent.shell.partition_host import PartitionHost
from heronry_agent.shell.ports import bus_configs
from heronry_agent.shell.table_preparing import TablePreparing
from heronry_agent.shell.table_waiting import Waiting, WaitingCore
from heronry_wire.authentication import Key
from heronry_wire.bus_arguments import add_bus_arguments, channel_configs, channels_named, flagged_bus
from heronry_wire.clock_of_day import time_of_day
from heronry_wire.command_parser import CommandParser, program_version
from heronry_wire.errors import HeronryError
from heronry_wire.identifiers import PE_NODES
from heronry_wire.key_file import read_key
from heronry_wire.node_cost import CostMeter
from heronry_wire.ordinary_file import read_ordinary, replace_ordinary
from heronry_wire.pe_table import ModuleEntry, PeTable, TableError
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS, USUAL_MISSES
from heronry_wire.replicated_link import AnyLink, ReplicatedLink, open_link
from heronry_wire.service_manager import ServiceManager

_LISTEN_NS = 1_200_000_000  # longer than the heartbeat period of a node that waits for its table
_SALT_BYTES = 16
_MOST_TABLE_BYTES = 16 * 1024 * 1024
_USUAL_BITRATE = 1_000_000  # bit/s without --bitrate; limits the rate of SDO

_EPILOG = """\
examples:
  pe-agent --table nav.table -i socketcan -c can0                  devices as the spec names their drivers
  pe-agent --table nav.table -i socketcan -c can0 --simulated      simulated devices
  pe-agent --table nav.table --bus can0=vcan0 -i socketcan         the same, by the name of the bus in the spec
  pe-agent --table link.table -i socketcan -c can0 --bus radio=slcan:/dev/ttyUSB0     a gateway: each bus by name
  pe-agent --table nav.table -i softbus -c /tmp/can0.sock --state-dir /var/lib/heronry
  pe-agent --table nav.table -i socketcan -c can0 --key fleet.key  executes only commands tagged with the key
  pe-agent --table nav.table -i socketcan -c can0,can1             a replicated bus: both its channels
  pe-agent --node 92 -i socketcan -c can0                          waits until the manager brings its table
  pe-agent --node 92 --table pe.table -i socketcan -c can0         the same, and keeps the table for the next start
  pe-agent --table nav.table -i socketcan -c can0 --code-dir /var/lib/heronry/code --code-key fleet.signing.pub
  pe-agent --node 92 -i socketcan -c can0 --key fleet.key          the same, and takes only a table sealed with the key

'heronry table SPEC PE' writes the table. The flags below are python-can's own and name the bus toward the manager;
can.conf and CAN_* variables are used too. Ctrl-C or SIGTERM stops the agent; the manager plans around a PE that stops.
"""


class _IdTakenError(HeronryError):
    """Another node on the bus has the node-ID of this PE."""

    def __init__(self, node: int, where: str = "") -> None:
        super().__init__(f"another node on the bus has node-ID {node}; change one of the two{where}")


def main(argv: Sequence[str] | None = None) -> int:
    """Run `pe-agent`, with `argv` or the arguments of this process; returns the exit code."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if arguments.table is None and arguments.node is None:
        parser.error("a node needs its table or its node-ID: give --table FILE, --node ID, or both")
    try:
        return _run(arguments)
    except HeronryError as error:
        print(f"pe-agent: {error}", file=sys.stderr)
        return 1 if isinstance(error, _IdTakenError) else 2
    except KeyboardInterrupt:
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(
        prog="pe-agent",
        description="Run the modules that the manager assigns to this processing element, and report to the manager.",
        epilog=_EPILOG,
    )
    parser.add_argument("--version", action="version", version=f"pe-agent {program_version()}")
    parser.add_argument("--table", type=Path, metavar="FILE", help="the table of this PE, written by 'heronry table'")
    parser.add_argument(
        "--node",
        type=_node,
        metavar="ID",
        help="node-ID (92 to 125) with which to wait until the manager brings the table; with --table: only if the "
        "file holds no table that can be used, or one of another spec. The table that comes is kept in the file",
    )
    parser.add_argument(
        "--bus",
        action="append",
        default=[],
        metavar="NAME=[INTERFACE:]CHANNEL",
        help="the channel of a bus that the table names; repeat the option for each bus of a gateway",
    )
    parser.add_argument(
        "--state-dir",
        type=Path,
        metavar="DIR",
        help="folder that keeps the boot count (without a folder the count is drawn at random)",
    )
    parser.add_argument(
        "--key", type=Path, metavar="FILE", help="key file of 'heronry key': refuse commands made without this key"
    )
    parser.add_argument(
        "--bench-origin",
        type=int,
        metavar="NS",
        help="take-off time of the simulated flight, in ns of this computer's monotonic clock (default: now)",
    )
    parser.add_argument(
        "--devices",
        type=Path,
        metavar="FILE",
        help="JSON file with the drivers of devices on this node; it counts before the spec",
    )
    parser.add_argument(
        "--simulated",
        nargs="?",
        const=PLANT,
        metavar="SIMULATOR",
        help=f"simulate every device that --devices does not name (by default with '{PLANT}')",
    )
    parser.add_argument(
        "--code-dir",
        type=Path,
        metavar="DIR",
        help="take code over the bus, and keep it in this folder, which nothing else uses",
    )
    trust = parser.add_mutually_exclusive_group()
    trust.add_argument(
        "--code-key", type=Path, metavar="FILE", help="the public key (.pub) with which this code must be signed"
    )
    trust.add_argument(
        "--unsigned-code", action="store_true", help="take code of anybody who can send on the bus: for a desk only"
    )
    parser.add_argument("--until-eof", action="store_true", help="stop when standard input ends")
    talk = parser.add_mutually_exclusive_group()
    talk.add_argument("-q", "--quiet", action="store_true", help="print only the reason why the agent ends")
    talk.add_argument("-v", "--verbose", action="store_true", help="print counts of refused and late frames at the end")
    add_bus_arguments(parser, "the bus toward the manager")
    return parser


def _node(text: str) -> int:
    if text.isascii() and text.isdecimal() and int(text) in PE_NODES:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text} is not the node-ID of a PE; use {PE_NODES[0]} to {PE_NODES[-1]}")


def _run(arguments: argparse.Namespace) -> int:
    """Run the agent with its table, and with each table that the manager brings in its place; returns the exit code."""
    tell = _silent if arguments.quiet else _print_note
    key = None if arguments.key is None else read_key(arguments.key)
    table = _first_table(arguments, tell, key)
    if table is None:
        return 0
    with closing(BootCount(arguments.state_dir, table.node_id, lambda sentence: tell(Note("disk", sentence)))) as boots:
        while table is not None:
            table = _run_with(table, boots, arguments, tell, key)
            _keep(table, arguments.table, tell)
    return 0


def _run_with(
    table: PeTable, boots: BootCount, arguments: argparse.Namespace, tell: Callable[[Note], None], key: Key | None
) -> PeTable | None:
    """Run the agent until it is stopped, or is given another table over the bus: returns that table, else None."""
    until_eof = arguments.until_eof
    configs = bus_configs(table, arguments, arguments.bus)
    origin_ns = arguments.bench_origin if arguments.bench_origin is not None else time.monotonic_ns()
    named = {} if arguments.devices is None else read_devices(arguments.devices)
    buses = {port.bus: dict(channels[0]) for port, channels in zip(table.ports, configs, strict=True)}
    here = NodeDevices(
        table, named, arguments.simulated, origin_ns, buses, lambda sentence: tell(Note("device", sentence))
    )
    devices = here.devices
    followed, every_echo = devices.followed(), devices.every_echo()
    reasons = {module.image: why_not_here(module.image) for module in table.modules}
    missing = {image: reason for image, reason in reasons.items() if reason is not None}
    code = _code_of(arguments, table, missing, tell)
    if code is not None:
        table = code.table
    with ExitStack() as undo:
        links: list[AnyLink] = []
        for port, config in zip(table.ports, configs, strict=True):
            links.append(open_link(config, port.heartbeat_ns, port.misses))
            undo.callback(links[-1].close)
        if not _has_own_node_id(OwnNodeId.of(links, table, key), tell, until_eof=until_eof, where=" in the spec"):
            return None
        if every_echo:
            tell(Note("echo", "every command is echoed: the simulated plants of other PEs follow it"))

        groups = open_groups(tell)
        host = PartitionHost(table, devices, groups) if code is None else code.host(devices, groups)
        undo.callback(host.close)
        meter = CostMeter(time.monotonic_ns(), time.process_time_ns, host.used_ns)

        def open_added(beside: PeTable, added: Collection[ModuleEntry]) -> frozenset[int]:
            if code is not None:
                raise TableError("this node takes code over the bus (--code-dir), and then no table while it flies")
            slow = here.add(beside, added)
            host.add(added, time.monotonic_ns())
            return slow

        preparing = TablePreparing(
            table,
            arguments.table,
            open_added=open_added,
            keep_only=host.keep_only,
            why_not_here=why_not_here,
            tell=lambda sentence: tell(Note("disk", sentence)),
        )

        def new_core(flying: PeTable) -> AgentCore:
            now_ns, secret = time.monotonic_ns(), _secret(key)
            brought = frozenset[str]() if code is None else code.loader.images
            lacking = {module.image: why_not_here(module.image) for module in flying.modules}
            return AgentCore(
                flying,
                boots.next(),
                now_ns,
                missing_images={
                    image: why for image, why in lacking.items() if why is not None and image not in brought
                },
                secret=secret,
                followed=followed,
                every_echo=every_echo,
                cost=lambda: meter.last,
                takes_tables=arguments.node is not None,
                program=None if code is None else code.loader.program,
                kept_parts=b"" if code is None else code.loader.kept_parts,
                slow_to_rest=preparing.numbers.indices(devices.slow_to_rest),
            )

        service = ServiceManager()
        undo.callback(service.close)
        driver = AgentDriver(
            table, new_core, host, links, key=key, tell=tell, service=service, meter=meter, preparing=preparing
        )
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: driver.stop())
        new_table = driver.run(until_eof=until_eof)
        if new_table is None:
            service.stopping()
        if arguments.verbose:
            _print_counts(driver.core, links, table)
    return new_table


def _first_table(arguments: argparse.Namespace, tell: Callable[[Note], None], key: Key | None) -> PeTable | None:
    """Return the table of the file, or wait for one if there is none that can be used; None: the program is stopped.

    Raises TableError if the table of the file cannot be used, and no node-ID is given with which to wait.
    """
    if arguments.table is not None:
        try:
            table = _read_table(arguments.table)
            if arguments.node in (None, table.node_id):
                return table
            problem = f"{arguments.table}: it is the table of node {table.node_id}"
        except TableError as error:
            if arguments.node is None:
                raise
            problem = str(error)
        tell(Note("table", f"{problem}. This node waits until the manager brings its table"))
    came = _wait_for_table(arguments, tell, key)
    _keep(came, arguments.table, tell)
    return came


def _keep(table: PeTable | None, file: Path | None, tell: Callable[[Note], None]) -> None:
    """Write a table that came over the bus into its file, if there is one, so that the next start has it."""
    if table is None or file is None:
        return
    try:
        replace_ordinary(file, table.to_json().encode())
    except OSError as error:
        tell(Note("disk", f"{file} cannot be written ({error.strerror}): after a restart this node waits again"))


def _code_of(
    arguments: argparse.Namespace, table: PeTable, missing: Mapping[str, str], tell: Callable[[Note], None]
) -> Any:
    """Return the loader of this PE, and what follows from it (`loading_host.Code`); None without --code-dir."""
    if arguments.code_dir is None:
        if arguments.code_key is not None or arguments.unsigned_code:
            raise TableError(
                "--code-key and --unsigned-code say whose code is kept in --code-dir: name that folder, too"
            )
        return None
    if arguments.code_key is None and not arguments.unsigned_code:
        raise TableError("--code-dir needs --code-key FILE, or --unsigned-code where anybody on the bus is trusted")
    from heronry_agent.shell import loading_host  # noqa: PLC0415 - an agent without a loader is smaller

    return loading_host.open_code(
        arguments.code_dir, arguments.code_key, table, missing, lambda sentence: tell(Note("code", sentence))
    )


def _has_own_node_id(own: OwnNodeId, tell: Callable[[Note], None], *, until_eof: bool, where: str = "") -> bool:
    """Wait until it is known whether another node has this node's node-ID, and tell that it has none.

    False: the program that started this one has ended meanwhile. Raises _IdTakenError.
    """
    is_told = False
    while (found := own.look()) is NodeId.UNPROVEN:
        if not is_told:
            is_told = True
            sent = f"something sends with node-ID {own.node}"
            tell(Note("clash", f"{sent}; this node waits until the manager tells whether it knows that other node"))
        if until_eof and is_abandoned():
            return False
    if found is NodeId.TAKEN:
        raise _IdTakenError(own.node, where)
    if found is NodeId.FORGED:
        tell(Note("clash", f"frames with node-ID {own.node} come from no node that the manager knows: they are forged"))
    return True


def _secret(key: Key | None) -> Secret | None:
    return None if key is None else Secret(key, os.urandom(_SALT_BYTES))


def _wait_for_table(arguments: argparse.Namespace, tell: Callable[[Note], None], key: Key | None) -> PeTable | None:
    """Wait until this node receives its table, and return the table; None if the program is stopped before."""
    flags = {key: value for key, value in flagged_bus(arguments).items() if value is not None}
    bitrate = flags.get("bitrate", _USUAL_BITRATE)
    core = WaitingCore(arguments.node, bitrate, time.monotonic_ns(), _secret(key), offer=offer())
    channels = channel_configs(flags, channels_named(flags), "the bus")
    with closing(open_link(channels, USUAL_HEARTBEAT_NS, USUAL_MISSES)) as link:
        own = OwnNodeId([link], arguments.node, key, listen_ns=_LISTEN_NS, lost_after_ns=_LISTEN_NS)
        if not _has_own_node_id(own, tell, until_eof=arguments.until_eof):
            return None
        waiting = Waiting(core, link, tell)
        numbers = (signal.SIGTERM, signal.SIGINT)
        before = {number: signal.signal(number, lambda *_: waiting.stop()) for number in numbers}
        try:
            return waiting.run(until_eof=arguments.until_eof)
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _read_table(file: Path) -> PeTable:
    try:
        data = read_ordinary(file, _MOST_TABLE_BYTES + 1)
        if len(data) > _MOST_TABLE_BYTES:
            raise TableError(f"{file} is longer than any table; write the table with 'heronry table'")
        text = data.decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "the file is not text"
        raise TableError(f"{file}: {reason}; write the table with 'heronry table'") from error
    try:
        table = PeTable.from_json(text)
        TableIndex(table)
    except TableError as error:
        raise TableError(f"{file}: {error}") from error
    return table


def _print_counts(core: AgentCore, links: Sequence[AnyLink], table: PeTable) -> None:
    for (what, where), times in sorted(core.counts.items()):
        _print_note(Note("count", f"{what} ({where}): {times}"))
    for module, times in sorted(core.modules.schedule.overruns.items()):
        _print_note(Note("count", f"steps of {table.module_names[module]} skipped: {times}"))
    for bus in links:
        if isinstance(bus, ReplicatedLink):
            _print_note(
                Note(
                    "count",
                    f"{bus.name}: frames dropped as copies of the other channel's {bus.merge.copies}, "
                    f"late frames withheld {bus.merge.stale}",
                )
            )
    for link in (link for bus in links for link in (bus.links if isinstance(bus, ReplicatedLink) else (bus,))):
        lost = f"frames without an echo {link.echoes_lost}, dropped {link.queue.dropped}, too late {link.queue.expired}"
        _print_note(Note("count", f"{link.name}: {lost}"))
        for what, times in sorted(link.health.counts.items()):
            _print_note(Note("count", f"{link.name}: {what} {times}"))


def _silent(note: Note) -> None:
    """Print no note (--quiet)."""


def _print_note(note: Note) -> None:
    with suppress(OSError):  # a full disk, or a reader that has ended, must not stop the agent
        print(f"{time_of_day()} {note.kind}: {note.text}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
