"""`heronry send-table`: send a waiting PE its table over the bus.

A PE with a key needs two things: an unlock, which the manager sends on the operator's order, and a table that is sealed
with the key. This command does both, on the manager's computer. UNLOCK may be lost, or may reach the PE before the PE
accepts the manager; then the PE answers that it is locked. So the command repeats the unlock and the table for a while.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from heronry_tools.analysis.made_ahead import CARRIED, add_contingencies_argument, contingencies_of
from heronry_tools.console.output import add_json
from heronry_tools.console.spec_argument import add_spec_argument, expect_pe, load_spec

_ANSWER_WITHIN_S = 5.0
_AGAIN_AFTER_S = 0.2
_REMEDY = "the PE must wait for its table (pe-agent --node), this bus must be its uplink, and --key must name its key"
_CHUNK = 7000  # bytes, a multiple of 7: an SDO segment has 7 bytes, and only the last one may be shorter
_EPILOG = """\
examples:
  pe-agent --node 92 -i socketcan -c can0                        on the PE: it waits
  heronry send-table big_blue flight -i socketcan -c can0        on any other node of that bus
  heronry send-table big_blue flight -i socketcan -c can0 --key fleet.key    where both have a key: beside the manager

The table goes by SDO block transfer into object 2020h. A PE that has its table takes no other: restart the PE first.
With a key the manager, which must run on this computer, unlocks the PE first, as with 'heronry unlock'.
"""


def add_parsers(subparsers: Any) -> None:
    """Add the parser of `heronry send-table`."""
    from heronry_wire.bus_arguments import add_bus_arguments  # noqa: PLC0415 - python-can is slow to import

    parser = subparsers.add_parser(
        "send-table",
        description="Compile the table of a PE and write it into the PE by SDO.",
        epilog=_EPILOG,
    )
    add_spec_argument(parser)
    parser.add_argument("pe", metavar="PE", help="name of the PE")
    add_contingencies_argument(parser, CARRIED)
    parser.add_argument(
        "--key", type=Path, metavar="FILE", help="the key file from 'heronry key', if the PE was started with a key"
    )
    parser.add_argument(
        "--socket",
        type=Path,
        metavar="PATH",
        help="with --key: the manager's socket, if the manager was started with --socket",
    )
    add_json(parser, "write what was sent as JSON")
    add_bus_arguments(parser, "the bus that is the uplink of the PE; either channel of a replicated one")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Send the table; returns the exit code."""
    import canopen  # noqa: F401, PLC0415 - imported first, so that a missing package is reported before planning

    from heronry_tools.runtime.table_files import table_texts  # noqa: PLC0415
    from heronry_wire.bus_arguments import flagged_bus  # noqa: PLC0415
    from heronry_wire.bus_opening import open_bus  # noqa: PLC0415
    from heronry_wire.key_file import read_key  # noqa: PLC0415

    spec, pe = load_spec(arguments.spec), arguments.pe
    expect_pe(spec, pe)
    key = None if arguments.key is None else read_key(arguments.key)
    flags = {name: value for name, value in flagged_bus(arguments).items() if value is not None}

    def look_at_bus() -> None:
        open_bus(flags).bus.shutdown()

    carried = contingencies_of(spec, arguments.contingencies, before_making=look_at_bus)
    text = table_texts(spec, [pe], carried)[pe].encode()
    node = spec.pes[pe].node_id
    if key is None:
        _send(flags, node, text)
    else:
        _send(flags, node, key.sealed(text), lambda: _unlock(arguments.socket, spec.name, pe))
    told = {"pe": pe, "node": node, "bytes": len(text)}
    print(json.dumps(told) if arguments.json else f"{pe}, node {node}, has its table: {len(text)} bytes")
    return 0


def _unlock(socket: Path | None, spec: str, pe: str) -> None:
    """Let the manager unlock a PE; raises UserError if the manager refuses."""
    from heronry_manager.core.vocabulary import UnlockPe  # noqa: PLC0415
    from heronry_manager.shell.control_client import call, find_socket  # noqa: PLC0415
    from heronry_tools.console.errors import UserError  # noqa: PLC0415

    answer = call(socket or find_socket(spec), UnlockPe(f"pe:{pe}"))
    if not answer.done:
        raise UserError(f"the manager does not unlock pe:{pe}: {answer.sentence}")


def _send(flags: dict[str, Any], node: int, content: bytes, unlock: Callable[[], None] | None = None) -> None:
    """Write a table, sealed or not, into a node; raises UserError if the node does not take the table.

    unlock: unlocks the PE, and is called before the table is written. If the PE answers that it is locked, both steps
    are repeated for a while.
    """
    import canopen  # noqa: PLC0415 - slow to import
    from canopen.sdo.exceptions import SdoAbortedError, SdoError  # noqa: PLC0415

    from heronry_tools.console.errors import UserError  # noqa: PLC0415
    from heronry_wire.bus_opening import open_bus  # noqa: PLC0415
    from heronry_wire.sdo import Abort  # noqa: PLC0415

    give_up_s = time.monotonic() + _ANSWER_WITHIN_S
    with canopen.Network(open_bus(flags).bus) as network:
        network.connect()
        sdo: Any = network.add_node(node, canopen.ObjectDictionary()).sdo  # type: ignore[no-untyped-call]
        sdo.RESPONSE_TIMEOUT = _ANSWER_WITHIN_S
        while True:
            if unlock is not None:
                unlock()
            try:
                return _write(sdo, content)
            except SdoError as error:
                is_locked = isinstance(error, SdoAbortedError) and error.code == Abort.DEVICE_STATE.value
                if unlock is None or not is_locked or time.monotonic() > give_up_s:
                    raise UserError(f"node {node} did not take the table ({error}); {_REMEDY}") from error
            time.sleep(_AGAIN_AFTER_S)


def _write(sdo: Any, content: bytes) -> None:
    from heronry_wire.canopen_objects import TABLE  # noqa: PLC0415

    with sdo.open(TABLE, 0, "wb", size=len(content), block_transfer=True, buffering=_CHUNK) as stream:
        stream.write(content)
