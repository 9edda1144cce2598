"""`heronry send-table`: send a waiting PE its table over the bus.

A PE with a key needs two things: an unlock, which the manager sends on the operator's order, and a table that is sealed
with the key and the PE's challenge. This command does both, on the manager's computer. UNLOCK may be lost, or may reach
the PE before the PE accepts the manager; then the PE answers that it is locked. So the command repeats the unlock and
the table for a while.
"""

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import canopen
from canopen.sdo.exceptions import SdoAbortedError, SdoError

from heronry_tools.analysis.made_ahead import contingencies_of
from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_calls import unlock_pe
from heronry_tools.console.progress import Working
from heronry_tools.console.spec_files import expect_pe, load_spec
from heronry_tools.runtime.canopen_log import keep_off_the_terminal
from heronry_tools.runtime.table_files import table_texts
from heronry_wire.authentication import Key
from heronry_wire.bus_arguments import flagged_bus
from heronry_wire.bus_opening import open_bus
from heronry_wire.canopen_objects import CHALLENGE, TABLE
from heronry_wire.compressed_table import compressed
from heronry_wire.key_file import read_key
from heronry_wire.sdo import Abort, read_number

_ANSWER_WITHIN_S = 5.0
_AGAIN_AFTER_S = 0.2
_REMEDY = "the PE must wait for its table (pe-agent --node), this bus must be its uplink, and --key must name its key"
_CHUNK = 7000  # bytes, a multiple of 7: an SDO segment has 7 bytes, and only the last one may be shorter


def run(arguments: argparse.Namespace) -> int:
    """Send the table; returns the exit code."""
    spec, pe = load_spec(arguments.spec), arguments.pe
    expect_pe(spec, pe)
    key = None if arguments.key is None else read_key(arguments.key)
    flags = {name: value for name, value in flagged_bus(arguments).items() if value is not None}

    def look_at_bus() -> None:
        open_bus(flags).bus.shutdown()

    carried = contingencies_of(spec, arguments.contingencies, before_making=look_at_bus)
    content = compressed(table_texts(spec, [pe], carried)[pe])
    node = spec.pes[pe].node_id
    unlock = None if key is None else partial(unlock_pe, arguments.socket, spec.name, pe)
    with Working(f"sending {pe} its table"):
        _send(flags, node, content, key, unlock)
    told = {"pe": pe, "node": node, "bytes": len(content)}
    print(json.dumps(told) if arguments.json else f"{pe}, node {node}, has its table: {len(content)} bytes")
    return 0


def _send(
    flags: dict[str, Any], node: int, content: bytes, key: Key | None = None, unlock: Callable[[], None] | None = None
) -> None:
    """Write a table into a node; raises UserError if the node does not take the table.

    key: seals the table.
    unlock: unlocks the PE, and is called before the table is written. If the PE answers that it is locked, both steps
    are repeated for a while.
    """
    keep_off_the_terminal()
    give_up_s = time.monotonic() + _ANSWER_WITHIN_S
    with canopen.Network(open_bus(flags).bus) as network:
        network.connect()
        sdo: Any = network.add_node(node, canopen.ObjectDictionary()).sdo  # type: ignore[no-untyped-call]
        sdo.RESPONSE_TIMEOUT = _ANSWER_WITHIN_S
        while True:
            if unlock is not None:
                unlock()
            try:
                return _write(sdo, content if key is None else key.sealed(content, _challenge(sdo, node)))
            except SdoError as error:
                is_locked = isinstance(error, SdoAbortedError) and error.code == Abort.DEVICE_STATE.value
                if unlock is None or not is_locked or time.monotonic() > give_up_s:
                    raise UserError(f"node {node} did not take the table ({error}); {_REMEDY}") from error
            time.sleep(_AGAIN_AFTER_S)


def _challenge(sdo: Any, node: int) -> int:
    challenge = read_number(sdo.upload(CHALLENGE, 0))
    if challenge is None:
        raise UserError(f"node {node} did not take the table (its challenge is no number); {_REMEDY}")
    return challenge


def _write(sdo: Any, content: bytes) -> None:
    with sdo.open(TABLE, 0, "wb", size=len(content), block_transfer=True, buffering=_CHUNK) as stream:
        stream.write(content)
