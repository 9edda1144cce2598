"""Opens a bus with python-can: gives the bus with its file descriptor, or an error of one sentence.

Any exception of a back-end becomes LinkError. A node waits on the file descriptors of all its buses at once, so a
back-end without a descriptor is refused. For a bus of a socketcand server (CAN over TCP, `socketcand`) the descriptor
is that of the TCP connection.
"""

import socket
from collections.abc import Mapping
from typing import Any, NamedTuple

from heronry_wire import socketcand
from heronry_wire.bare_can import can
from heronry_wire.can_interface import obstacle
from heronry_wire.errors import HeronryError
from heronry_wire.python_can import sentence_of


class LinkError(HeronryError):
    """A bus cannot be used; the message is one sentence, with a remedy where one is known."""


class Opened(NamedTuple):
    """An open bus, with the file descriptor on which its frames arrive."""

    bus: can.BusABC
    fileno: int  # readable when a frame has come
    connection: socket.socket | None = None  # TCP, to a socketcand server, which may close it without an exception


def bus_name(config: Mapping[str, Any]) -> str:
    """Return the name that messages use for the bus with these keyword arguments of `can.Bus`."""
    return f"{config.get('interface') or 'the configured interface'} {config.get('channel') or ''}".strip()


def look_at_interface(config: Mapping[str, Any]) -> None:
    """Raise LinkError if the bus is on a SocketCAN interface that is up, but must not be used now.

    - The controller is bus-off, and Linux will restart it (`restart-ms`): LinkError.
    - The controller is bus-off, and Linux will not restart it: this function restarts the interface. LinkError if the
      restart fails.
    - The interface has another bit rate than `config` requests: LinkError.

    No error for another back-end, or for an interface that does not exist or is down.
    """
    interface = config.get("channel") if config.get("interface") == "socketcan" else None
    reason = None if interface is None else obstacle(interface, config.get("bitrate"))
    if reason is not None:
        raise LinkError(f"{bus_name(config)} cannot be opened: {reason}")


def open_bus(config: Mapping[str, Any]) -> Opened:
    """Open the bus that these keyword arguments of `can.Bus` describe; raises LinkError.

    With the interface socketcand, the channel is INTERFACE@HOST:PORT.
    """
    name = bus_name(config)
    at_server = config.get("interface") == socketcand.INTERFACE
    try:
        bus = socketcand.open_at_server(config) if at_server else can.Bus(**config)
    except can.CanInterfaceNotImplementedError as error:
        if "interface" in config:
            raise LinkError(f"{name} cannot be opened: {sentence_of(error)}") from error
        raise LinkError("no bus is named: give -i INTERFACE and -c CHANNEL, or set them in can.conf") from error
    except Exception as error:  # a back-end without its library may raise anything, even NameError
        raise LinkError(f"{name} cannot be opened: {sentence_of(error)}") from error
    connection = socketcand.connection_of(bus)
    if connection is not None:
        return Opened(bus, connection.fileno(), connection)
    try:
        return Opened(bus, bus.fileno())
    except NotImplementedError:
        bus.shutdown()
        remedy = "use socketcan, softbus, or another interface that has one"
        raise LinkError(f"{name} has no file descriptor to wait on; {remedy}") from None
