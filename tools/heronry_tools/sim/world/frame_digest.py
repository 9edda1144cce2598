"""The digest of a flight, over each frame with its time, bus and sender; flights with equal digests are equal."""

import hashlib
import struct

from heronry_tools.sim.world.bus import Sent

_HEAD = struct.Struct("<qBBH")


class FrameDigest:
    """Computes the digest of one flight, frame by frame."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._unhashed = bytearray()
        self._numbers: dict[str, int] = {}  # a number for each bus and sender

    def see(self, sent: Sent) -> None:
        """Add a frame to the digest."""
        numbers, frame = self._numbers, sent.frame
        bus = numbers.setdefault(sent.bus, len(numbers))
        self._unhashed += _HEAD.pack(sent.end_ns, bus, numbers.setdefault(sent.sender, len(numbers)), frame.can_id)
        self._unhashed += frame.data

    def so_far(self) -> str:
        """Return the digest of all frames so far: 16 hexadecimal digits."""
        self._hash.update(self._unhashed)
        self._unhashed.clear()
        return self._hash.hexdigest()[:16]
