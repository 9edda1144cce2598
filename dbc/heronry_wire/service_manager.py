"""Reports of a node to systemd, if systemd started it: ready, alive, and a status (sd_notify(3)).

Reports are datagrams to the UNIX socket that NOTIFY_SOCKET names; without NOTIFY_SOCKET no method has an effect. Only
the code that sends a heartbeat calls `lives`, so systemd kills and restarts a node whose heartbeats stop
(WatchdogSec=), even if other parts of the node still run. A lost report does no harm: the node sends four in the time
that systemd waits (WATCHDOG_USEC).
"""

import os
import socket
from collections.abc import Mapping
from contextlib import suppress

_NS_PER_US = 1_000
_TOLD_IN_A_WATCHDOG_PERIOD = 4


class ServiceManager:
    """Sends the reports of one node to systemd."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Take the address of systemd's socket from NOTIFY_SOCKET: a path, or an abstract name that begins with '@'."""
        place = environment.get("NOTIFY_SOCKET", "")
        self._address = f"\0{place[1:]}" if place.startswith("@") else place
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if place else None
        period = environment.get("WATCHDOG_USEC", "")
        self._period_ns = int(period) * _NS_PER_US // _TOLD_IN_A_WATCHDOG_PERIOD if period.isdecimal() else None
        self._next_ns = 0
        self._is_ready = False

    def lives(self, now_ns: int) -> None:
        """Report that a heartbeat was sent.

        The first call tells systemd that the node is ready. This and later calls reset systemd's watchdog, but at most
        four times in the time that systemd waits.
        """
        if self._socket is None:
            return
        if not self._is_ready:
            self._is_ready = True
            self._say("READY=1")
        if self._period_ns is not None and now_ns >= self._next_ns:
            self._next_ns = now_ns + self._period_ns
            self._say("WATCHDOG=1")

    def status(self, sentence: str) -> None:
        """Report a sentence, which `systemctl status` then shows."""
        self._say(f"STATUS={sentence}")

    def stopping(self) -> None:
        """Report that the node has begun to stop because it was asked to."""
        self._say("STOPPING=1")

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()

    def _say(self, word: str) -> None:
        if self._socket is not None:
            with suppress(OSError):  # a full or missing socket must not stop the node
                self._socket.sendto(word.encode(), socket.MSG_DONTWAIT, self._address)
