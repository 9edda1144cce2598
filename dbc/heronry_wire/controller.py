"""Reads the error frames in which Linux reports the state of a CAN controller (ISO 11898-1) and errors of the bus.

An error frame does not come from the bus. The CAN driver of Linux makes it from what this node's controller reports,
for each socket that requests error frames. So an error frame says nothing about other nodes. The classes of errors are
bits of the identifier; details are in the data bytes (Linux, include/uapi/linux/can/error.h). A driver may leave out
any class or detail. If the driver gives no state, the state is None here and is not guessed.
"""

from dataclasses import dataclass
from enum import IntEnum

from heronry_wire.frame import Frame


class ControllerState(IntEnum):
    """State of a controller, numbered as in Linux' enum can_state; a larger number is worse."""

    ERROR_ACTIVE = 0
    ERROR_WARNING = 1  # an error counter has reached 96
    ERROR_PASSIVE = 2  # an error counter has reached 128: its error flags no longer destroy the frames of other nodes
    BUS_OFF = 3  # the transmit counter has passed 255: it is off the bus until it is restarted
    STOPPED = 4
    SLEEPING = 5


_CONTROLLER, _BUS_OFF, _RESTARTED = 0x004, 0x040, 0x100
_KINDS = {
    0x001: "transmit time-out",
    0x008: "protocol violation",
    0x010: "transceiver",
    0x020: "no acknowledgement",
    0x080: "bus error",
}
_OVERFLOWS = {0x01: "controller receive overflow", 0x02: "controller transmit overflow"}
_STATES = (  # bits of byte 1 of a controller problem, the worst first
    (0x30, ControllerState.ERROR_PASSIVE),
    (0x0C, ControllerState.ERROR_WARNING),
    (0x40, ControllerState.ERROR_ACTIVE),
)


@dataclass(frozen=True, slots=True)
class ControllerReport:
    """Content of one error frame.

    state: the state of the controller; None: the frame names no state.
    kinds: the errors, as words for the log.
    """

    state: ControllerState | None
    kinds: tuple[str, ...]


def read_error_frame(frame: Frame) -> ControllerReport:
    """Read an error frame; ignores undefined bits, and never raises an exception."""
    classes, detail = frame.can_id, frame.data[1] if len(frame.data) > 1 else 0
    kinds = [name for bit, name in _KINDS.items() if classes & bit]
    if classes & _CONTROLLER:
        kinds += [name for bit, name in _OVERFLOWS.items() if detail & bit]
    return ControllerReport(_state(classes, detail), tuple(kinds))


def _state(classes: int, detail: int) -> ControllerState | None:
    if classes & _BUS_OFF:
        return ControllerState.BUS_OFF
    if classes & _RESTARTED:
        return ControllerState.ERROR_ACTIVE
    if classes & _CONTROLLER:
        return next((state for bits, state in _STATES if detail & bits), None)
    return None
