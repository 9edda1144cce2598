"""What comes in parts, until it is whole: a bundle (2030h) or a table (2026h).

    empty      nothing has come, or what had come was whole, wrong or forgotten
    growing    some bytes of one transfer (its SHA-256 and length) have come in order

A part that does not begin where the one before ended is refused, the first one too, so a doubled, lost or late part
changes nothing; a part of another transfer begins anew. When the last part has come, the SHA-256 of the whole decides
whether anything has come at all. At most MOST_BYTES are kept. A restart forgets them, unless somebody keeps `as_one`.
"""

from hashlib import sha256

from heronry_agent.core.canopen.object_dictionary import MOST_BYTES
from heronry_wire.part_transfer import Part, Received, Transfer
from heronry_wire.sdo import Abort


class ReceivedParts:
    """The bytes of one unfinished transfer."""

    def __init__(self, kept: bytes = b"") -> None:
        """Begin with what was kept as `as_one`; with nothing where `kept` is no beginning of a transfer."""
        self._transfer = Transfer(bytes(32), 0)
        self._bytes = bytearray()
        part = Part.decode(kept)
        if part is not None and part.at == 0 and len(part.data) < part.transfer.length <= MOST_BYTES:
            self._transfer, self._bytes = part.transfer, bytearray(part.data)

    @property
    def received(self) -> Received:
        """Return how far the transfer has come."""
        return Received(self._transfer.digest, len(self._bytes))

    @property
    def encoded(self) -> bytes:
        """Return the same as the value that a client reads."""
        return self.received.encode()

    @property
    def as_one(self) -> bytes:
        """Return what has come as one part from the beginning, encoded."""
        return Part(self._transfer, 0, bytes(self._bytes)).encode()

    def take(self, content: bytes) -> bytes | Abort | None:
        """Take one part; returns the whole, the reason why the part is refused, or None: more has to come."""
        part = Part.decode(content)
        if part is None:
            return Abort.LENGTH
        transfer = part.transfer
        if transfer.length > MOST_BYTES:
            return Abort.OUT_OF_MEMORY
        if transfer != self._transfer:
            self._transfer, self._bytes = transfer, bytearray()
        if part.at != len(self._bytes) or part.at + len(part.data) > transfer.length:
            return Abort.VALUE
        self._bytes += part.data
        if len(self._bytes) < transfer.length:
            return None
        whole = bytes(self._bytes)
        self.forget()
        return whole if sha256(whole).digest() == transfer.digest else Abort.CRC

    def forget(self) -> None:
        """Forget the bytes that have come."""
        self._bytes = bytearray()
