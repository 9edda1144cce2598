"""CANopen network management: its two messages (CiA 301, 7.2.8), and their bytes.

A command has two bytes: its code, and the node that is to execute it, 0 for all nodes. A heartbeat has one byte, the
state of its sender; the first heartbeat after a start says INITIALISING (boot-up).
`heronry_agent.core.canopen.network_management` decides what a PE does with a command.

This file keeps no state.
"""

from enum import Enum
from typing import NamedTuple

ALL_NODES = 0
START, STOP, ENTER_PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130

_COMMAND_BYTES = 2


class NmtState(Enum):
    """States of CiA 301; the value is the byte that a heartbeat carries."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class NmtCommand(NamedTuple):
    """A command of an NMT master: its code, and the node that it addresses."""

    code: int
    node: int


def decode_command(data: bytes) -> NmtCommand | None:
    """Decode an NMT command, whatever its code; None where `data` has a wrong length."""
    return NmtCommand(*data) if len(data) == _COMMAND_BYTES else None


def code_of(data: bytes) -> int:
    """Return the code of an NMT command; `data` must have at least one byte."""
    return data[0]


def encode_heartbeat(state: NmtState) -> bytes:
    """Encode the payload of a heartbeat."""
    return bytes((state.value,))


def decode_heartbeat(data: bytes) -> int:
    """Return the code of the sender's state from the payload of a heartbeat, which must have at least one byte."""
    return data[0]
