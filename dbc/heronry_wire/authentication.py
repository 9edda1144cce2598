"""The key of a fleet, and the tags that only its holders can make (protocol rule 11).

A tag is a keyed BLAKE2s hash (RFC 7693), cut to the room in the frame: 48 bits for a command, 24 for a state. The tag
covers the bytes of the frame and, in addition:

    command   - manager; kind of the command; term; number of the command in that term
              - in a WELCOME, by which a manager answers the nonce of a PE: the nonce that it answers
    state     - node; manager, term and number of the WELCOME that opened the node's session
              - digest of the configuration that the PE runs (page 0) or has staged (page 1). In the frame, the tag
                stands in place of this digest
              - in page 0: the number of this page in the session
              - in page 0 with the flag FAULT_PENDING: one EMCY that waits to be acknowledged, because an EMCY has no
                room for a tag of its own

So the tag of a copied command or state is not valid a second time, at another place in the sequence, in the other
direction, or from another node.

A nonce is *plausible* if its last 16 bits are the tag of its other bits and its node. A manager answers only plausible
nonces. So a nonce that an attacker invents costs the manager nothing, and delays no answer to a PE. A recorded nonce is
plausible, but of no use: a PE accepts only the answer to the nonce that it has sent last.

A table that goes to a PE over the bus is *sealed*: a tag of 32 bytes follows the table, compressed or not. This tag is
not cut, because a table is long and decides which code runs. It covers the table, whose text names the node and the
spec, and the *challenge* of the PE, a random number of 32 bits that the PE draws at each start and gives to everybody
who asks. So a table that was recorded before the PE's last start is refused; a forged challenge leads to a seal that
the PE refuses.

One key serves the whole fleet, because a command is for all nodes and has room for only one tag. So an attacker who
takes over one node has the key. A key is never printed. Messages show its fingerprint, by which two keys can be told
apart. This file keeps no state.

Why BLAKE2s: it takes a key by design, and hashes in one pass where HMAC needs two. A tag takes 0.6 us, and 2.8 us with
HMAC-SHA-256 (`timeit`, on the machine of docs/limits.md). BLAKE2s also hashes its parameter `person` and the length of
its output, so tags of different kinds differ. It comes with Python; nothing has to be installed on a node.
"""

from hashlib import blake2s
from hmac import compare_digest
from struct import Struct
from typing import NamedTuple

from heronry_wire.frame import WireError

KEY_BYTES = 32
SEAL_BYTES = 32
CHALLENGE_BYTES = 4
COMMAND_TAG_BYTES, STATE_TAG_BYTES = 6, 3
NO_NONCE = 0
DRAWN_BITS, _NONCE_TAG_BYTES = 40, 2  # of a nonce: the random number that the PE draws, and the tag after it
BEAT_SPAN = 256  # page 0 shows its number modulo this
PAGE_1_BEAT = 0  # pages 1 are not counted: what a page 1 reports of an epoch stays true for the whole session
NO_EMERGENCY = b""
MAX_NUMBER = 0xFFFF_FFFF  # commands in one term: enough for a year at a hundred per second

_COMMAND = Struct(">BBHIQ")
_STATE = Struct(">BBHII")
_FINGERPRINT_BYTES = 4


class Place(NamedTuple):
    """Position of a command among all commands of a manager: the term, and the number of the command in this term."""

    term: int
    number: int


class Session(NamedTuple):
    """A session of a PE: the manager, term and number of the WELCOME that opened it.

    WELCOME is the manager's answer to a nonce of the PE. The tags of the PE's states cover these three numbers.
    """

    manager: int
    term: int
    number: int


class Key:
    """The secret of a fleet: 32 bytes."""

    def __init__(self, secret: bytes) -> None:
        """Take the secret, of KEY_BYTES bytes; raises WireError for any other length."""
        if len(secret) != KEY_BYTES:
            raise WireError(f"a key has {KEY_BYTES} bytes, not {len(secret)}: make a key with 'heronry key'")
        self._commands = blake2s(key=secret, digest_size=COMMAND_TAG_BYTES, person=b"hrn-cmd")
        self._states = blake2s(key=secret, digest_size=STATE_TAG_BYTES, person=b"hrn-stat")
        self._nonces = blake2s(key=secret, digest_size=_NONCE_TAG_BYTES, person=b"hrn-nonc")
        self._tables = blake2s(key=secret, digest_size=SEAL_BYTES, person=b"hrn-tabl")
        self.fingerprint = blake2s(key=secret, digest_size=_FINGERPRINT_BYTES, person=b"hrn-name").hexdigest()

    def __repr__(self) -> str:
        return f"Key({self.fingerprint})"

    def command_tag(self, manager: int, kind: int, place: Place, payload: bytes, nonce: int = NO_NONCE) -> int:
        """Compute the 48-bit tag of a command.

        kind: position of the command among the identifiers of its manager, or `management.WELCOME_KIND`.
        place: term and number of the command.
        payload: all bytes of the command.
        nonce: for a WELCOME, the nonce that it answers.
        """
        tag = self._commands.copy()
        tag.update(_COMMAND.pack(manager, kind, *place, nonce))
        tag.update(payload)
        return int.from_bytes(tag.digest(), "big")

    def state_tag(
        self, node: int, session: Session, beat: int, said: bytes, digest: int, *, emergency: bytes = NO_EMERGENCY
    ) -> int:
        """Compute the 24-bit tag of a state frame (page 0 or 1).

        beat: number of this page 0 in its session; for page 1 the constant PAGE_1_BEAT.
        said: bytes of the page without its digest, as `state_frames.split_state` gives them.
        digest: of the configuration that runs (page 0) or is staged (page 1).
        emergency: all bytes of an EMCY that waits to be acknowledged; NO_EMERGENCY if none waits.
        """
        tag = self._states.copy()
        tag.update(_STATE.pack(node, *session, beat))
        tag.update(said)
        tag.update(digest.to_bytes(STATE_TAG_BYTES, "big"))
        tag.update(emergency)
        return int.from_bytes(tag.digest(), "big")

    def nonce(self, node: int, drawn: int) -> int:
        """Make a nonce for a node: `drawn`, a random number of DRAWN_BITS bits, followed by 16 bits of tag."""
        tag = self._nonces.copy()
        tag.update(node.to_bytes(1) + drawn.to_bytes(DRAWN_BITS // 8))
        return drawn << 8 * _NONCE_TAG_BYTES | int.from_bytes(tag.digest())

    def is_plausible(self, node: int, nonce: int) -> bool:
        """Tell whether the last 16 bits of a nonce prove that a holder of the key made it for this node."""
        drawn = nonce >> 8 * _NONCE_TAG_BYTES
        return nonce != NO_NONCE and self.nonce(node, drawn) == nonce

    def sealed(self, table: bytes, challenge: int) -> bytes:
        """Append to the bytes of a table the seal by which a PE with this key accepts the table over the bus.

        challenge: the number of 32 bits that the PE has drawn at its start.
        """
        return table + self._seal(table, challenge)

    def opened(self, sealed: bytes, challenge: int) -> bytes | None:
        """Return a sealed table without the seal; None where the seal was not made with this key and challenge."""
        table, seal = sealed[:-SEAL_BYTES], sealed[-SEAL_BYTES:]
        return table if compare_digest(seal, self._seal(table, challenge)) else None

    def _seal(self, table: bytes, challenge: int) -> bytes:
        seal = self._tables.copy()
        seal.update(challenge.to_bytes(CHALLENGE_BYTES))
        seal.update(table)
        return seal.digest()


def next_number(after: int, low: int, span: int) -> int:
    """Rebuild a counter from its lowest bits: give the first number above `after` that equals `low` modulo `span`."""
    return after + 1 + (low - after - 1) % span
