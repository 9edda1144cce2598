"""The port of a node on a software bus: whole packets of frames, and no message of python-can (`frame_port`).

The client of `client.py` hands its two sockets over. From then on the hub sends batches, and an echo says that a
mailbox is empty. One thread uses this port.
"""

import errno
import select
import socket
import time

from heronry_tools.runtime.softbus.link import Link, hub_is_gone
from heronry_tools.runtime.softbus.protocol import (
    BATCH_BYTES,
    MAILBOXES,
    WANT_ECHO,
    BusFrame,
    Fate,
    encode_frame,
    encode_withdrawal,
    frames_of,
)
from heronry_wire.bare_can import can
from heronry_wire.frame import Frame
from heronry_wire.frame_port import Arrival, Haste
from heronry_wire.thinning import Thinned


class Batches:
    """A `heronry_wire.frame_port.FramePort` on the sockets of a client."""

    gathers = True
    mailboxes = MAILBOXES

    def __init__(self, link: Link, receive: socket.socket, path: str) -> None:
        """Tell the hub to send batches; raises CanOperationError where it does not answer."""
        self._link, self._receive, self._path = link, receive, path
        self._offered = 0  # frames in the mailboxes
        self._is_echo_wanted = False
        self._unsent: list[bytes] = []  # offers that go with the next `flush`
        link.ask({"do": "batches"})

    def read(self, now_ns: int, most: int) -> tuple[list[Arrival], bool]:
        """Read packets until `most` frames, or all, are read; raises CanOperationError if the hub is gone."""
        found: list[Arrival] = []
        while len(found) < most:
            try:
                packet = self._receive.recv(BATCH_BYTES)
            except BlockingIOError:
                return found, False
            except OSError as error:
                raise hub_is_gone(self._path) from error
            if not packet:
                raise hub_is_gone(self._path)
            try:
                for time_ns, fate, frame in frames_of(packet):
                    if fate is not None:
                        self._offered, self._is_echo_wanted = self._offered - 1, False
                    if fate is not Fate.WITHDRAWN:
                        found.append(Arrival(min(time_ns, now_ns), frame))
            except ValueError as error:
                raise can.CanOperationError(
                    f"{self._path}: what the bus sent is no packet of this version of heronry ({error}); start the bus "
                    "again with this version"
                ) from None
        return found, True

    def send(self, frame: Frame, haste: Haste) -> None:
        """Offer a frame with the next `flush`; raises CanOperationError if all mailboxes are full."""
        if self._offered >= MAILBOXES:
            raise can.CanOperationError(f"{self._path}: the last frames are still waiting for the bus", errno.ENOBUFS)
        self._unsent.append(encode_frame(BusFrame(frame, len(frame.data), time.monotonic_ns(), haste=haste)))
        self._offered += 1

    def flush(self) -> None:
        """Offer what `send` has taken; raises CanOperationError if the hub is gone."""
        if self._unsent:
            packet = self._unsent[0] if len(self._unsent) == 1 else b"".join(self._unsent)
            self._unsent.clear()
            self._link.put(packet)

    def withdraw(self, identifiers: frozenset[int]) -> None:
        """Let the hub drop the offers with these identifiers; it does so before it reads the next offer."""
        self.flush()
        self._link.put(encode_withdrawal(identifiers))

    def want_echo(self) -> None:
        """Ask the hub once for the next echo."""
        if self._offered and not self._is_echo_wanted:
            self._is_echo_wanted = True
            self._link.put(WANT_ECHO)

    def linger(self, timeout_s: float) -> None:
        """Wait up to `timeout_s` until the offered frames have been sent; what comes meanwhile is dropped."""
        deadline_s = time.monotonic() + timeout_s
        self.flush()
        while self._offered and (left_s := deadline_s - time.monotonic()) > 0:
            self.want_echo()
            select.select([self._receive], [], [], left_s)
            self.read(0, 1)

    def thin(self, group: Thinned) -> None:
        """Let the hub drop what `group` does not need."""
        lists = {"identifiers": sorted(group.identifiers), "signs": sorted(group.signs)}
        self._link.ask({"do": "thin", **lists, "mask": group.mask, "every_ns": group.every_ns})
