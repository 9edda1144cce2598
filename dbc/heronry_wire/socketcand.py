"""A bus behind a socketcand (github.com/linux-can/socketcand): TCP, spoken by python-can.

It is named by its channel, INTERFACE@HOST:PORT; where that names no server, can.conf has to. What python-can leaves to
its caller is done here. It would wait for its server without end, and try to reach it without a pause: a server that
is not there is told at once, and one that says nothing after `SERVER_S`. And it does not tell of its connection, which
is what to wait on, and all there is to see it end by: one that its server has closed is readable for ever.
"""

import logging
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import can

INTERFACE = "socketcand"  # python-can's name of it
SERVER_S = 2.0  # to answer


def open_at_server(config: Mapping[str, Any]) -> can.BusABC:
    """Open the bus that python-can's keyword arguments describe; raises whatever python-can does, or ValueError."""
    place = _at_its_server(config)
    if "host" in place:
        socket.create_connection((place["host"], place["port"]), SERVER_S).close()
    logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)  # it warns of every frame cut in two
    before_s = socket.getdefaulttimeout()
    socket.setdefaulttimeout(SERVER_S)
    try:
        return can.Bus(**place)
    finally:
        socket.setdefaulttimeout(before_s)


def connection_of(bus: can.BusABC) -> socket.socket | None:
    """Give the connection of a bus that is open, to be waited on without limit; None if it is of another kind."""
    if not bus.channel_info.startswith(f"{INTERFACE} "):
        return None
    connection = next((kept for kept in vars(bus).values() if isinstance(kept, socket.socket)), None)
    if connection is not None:
        connection.settimeout(None)
    return connection


def see_whether_it_ended(connection: socket.socket) -> None:
    """Raise ConnectionResetError where the server has closed it, or OSError; takes nothing that has come."""
    with suppress(BlockingIOError):
        if not connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT):
            raise ConnectionResetError("its server has closed the connection")


def _at_its_server(config: Mapping[str, Any]) -> dict[str, Any]:
    channel, at, server = str(config.get("channel") or "").rpartition("@")
    if not at:
        return dict(config)
    host, _, port = server.rpartition(":")
    if not channel or not host or not port.isdecimal():
        raise ValueError(f"a socketcand is named INTERFACE@HOST:PORT, such as can0@192.168.1.5:29536, not '{server}'")
    return {**config, "channel": channel, "host": host, "port": int(port)}
