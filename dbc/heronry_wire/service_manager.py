"""What a node tells systemd, if systemd started it: that it is ready, that it lives, and what it is at (sd_notify(3)).

Words go as datagrams to the UNIX socket that NOTIFY_SOCKET names; without it all of this does nothing. `lives` is to be
called on the way by which heartbeats leave, and nowhere else: so a node whose heartbeats stop is killed and started
again (WatchdogSec=), whatever else in it still runs. A word that is lost is said again; systemd forgives until
WATCHDOG_USEC has passed, and four times in it are told.
"""

import os
import socket
from collections.abc import Mapping
from contextlib import suppress

_NS_PER_US = 1_000
_TOLD_IN_A_WATCHDOG_PERIOD = 4


class ServiceManager:
    """The line to systemd."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Read where to speak; NOTIFY_SOCKET may be a path, or an abstract name that begins with '@'."""
        place = environment.get("NOTIFY_SOCKET", "")
        self._address = f"\0{place[1:]}" if place.startswith("@") else place
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if place else None
        period = environment.get("WATCHDOG_USEC", "")
        self._period_ns = int(period) * _NS_PER_US // _TOLD_IN_A_WATCHDOG_PERIOD if period.isdecimal() else None
        self._next_ns = 0
        self._is_ready = False

    def lives(self, now_ns: int) -> None:
        """A heartbeat has left: the first makes this node ready, each later one feeds the watchdog."""
        if self._socket is None:
            return
        if not self._is_ready:
            self._is_ready = True
            self._say("READY=1")
        if self._period_ns is not None and now_ns >= self._next_ns:
            self._next_ns = now_ns + self._period_ns
            self._say("WATCHDOG=1")

    def status(self, sentence: str) -> None:
        """Tell what `systemctl status` shows."""
        self._say(f"STATUS={sentence}")

    def stopping(self) -> None:
        """An orderly end begins."""
        self._say("STOPPING=1")

    def close(self) -> None:
        """Close the line."""
        if self._socket is not None:
            self._socket.close()

    def _say(self, word: str) -> None:
        if self._socket is not None:
            with suppress(OSError):  # a full or missing socket is systemd's affair: the node flies on
                self._socket.sendto(word.encode(), socket.MSG_DONTWAIT, self._address)
