"""CANopen network management: its two messages (CiA 301, 7.2.8), and their bytes.

A command has two bytes: what to do, and the node that is to do it, 0 for all. A heartbeat has one: the state of who
sends it, and INITIALISING once, as the boot-up. What a PE does with a command is the affair of
`heronry_agent.core.network_management`.

States: none.
"""

from enum import Enum
from typing import NamedTuple

EVERYBODY = 0
START, STOP, ENTER_PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130

_COMMAND_BYTES = 2


class NmtState(Enum):
    """States of CiA 301; the value is what the heartbeat says, boot-up first."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class NmtCommand(NamedTuple):
    """What a master asks for, and of whom."""

    code: int
    node: int


def decode_command(data: bytes) -> NmtCommand | None:
    """Read an NMT command, whatever it asks for; None where it has another length."""
    return NmtCommand(*data) if len(data) == _COMMAND_BYTES else None


def code_of(data: bytes) -> int:
    """What an NMT command asks for; it must have a byte."""
    return data[0]


def encode_heartbeat(state: NmtState) -> bytes:
    """Payload of a heartbeat."""
    return bytes((state.value,))


def decode_heartbeat(data: bytes) -> int:
    """Code of the state that a heartbeat tells; it must have a byte."""
    return data[0]
