"""A bus that a socketcand server offers over TCP (github.com/linux-can/socketcand), read through python-can.

The channel names the bus, as INTERFACE@HOST:PORT; without HOST:PORT in the channel, can.conf must name the server. This
file adds two things to python-can:

- *Limits of time.* python-can tries to reach a missing server again and again without a pause, and waits for an answer
  for ever. Here a missing server is an error immediately, and a silent server after `SERVER_S` seconds.
- *The TCP connection*, which python-can hides. A node waits for frames on this connection. The node also has to test
  whether the server has closed the connection, because a closed connection stays readable.
"""

import logging
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from heronry_wire.bare_can import can

INTERFACE = "socketcand"  # its name in python-can
SERVER_S = 2.0  # limit for an answer of the server


def open_at_server(config: Mapping[str, Any]) -> can.BusABC:
    """Open the bus that these keyword arguments of `can.Bus` describe.

    Raises ValueError for a wrong channel, OSError if the server cannot be reached, or any exception of python-can.
    """
    place = _at_its_server(config)
    if "host" in place:
        socket.create_connection((place["host"], place["port"]), SERVER_S).close()
    logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)  # it warns of frames that arrive in parts
    before_s = socket.getdefaulttimeout()
    socket.setdefaulttimeout(SERVER_S)
    try:
        return can.Bus(**place)
    finally:
        socket.setdefaulttimeout(before_s)


def connection_of(bus: can.BusABC) -> socket.socket | None:
    """Return the TCP connection of an open bus, set to blocking; None for a bus of another back-end."""
    if not bus.channel_info.startswith(f"{INTERFACE} "):
        return None
    connection = next((kept for kept in vars(bus).values() if isinstance(kept, socket.socket)), None)
    if connection is not None:
        connection.settimeout(None)
    return connection


def see_whether_it_ended(connection: socket.socket) -> None:
    """Raise ConnectionResetError if the server has closed the connection; reads no data.

    Raises OSError for other failures.
    """
    with suppress(BlockingIOError):
        if not connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT):
            raise ConnectionResetError("the socketcand server has closed the connection")


def _at_its_server(config: Mapping[str, Any]) -> dict[str, Any]:
    channel, at, server = str(config.get("channel") or "").rpartition("@")
    if not at:
        return dict(config)
    host, _, port = server.rpartition(":")
    if not channel or not host or not port.isdecimal():
        raise ValueError(
            f"a socketcand bus is named INTERFACE@HOST:PORT, such as can0@192.168.1.5:29536, not '{channel}@{server}'"
        )
    return {**config, "channel": channel, "host": host, "port": int(port)}
