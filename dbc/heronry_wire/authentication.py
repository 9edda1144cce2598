"""The key of a fleet, and the tags that only its holders can make (rule 11).

A tag is keyed BLAKE2s (RFC 7693), cut to the room there is: 48 bits for a command, 24 for a state. BLAKE2s takes a key
by design, in one pass where HMAC needs two: 0.6 us a tag against 2.8 us with HMAC-SHA-256 (`timeit`, on the machine of
docs/limits.md), and its `person` and its output length, which are part of what is hashed, keep the kinds of tags apart
from each other. It comes with Python; nothing has to be installed on a node.

One key serves the whole fleet, because a command is for everybody and has room for one tag: whoever takes over one node
holds the key. What a tag covers beside the bytes of the frame:

    command   manager, kind of the command, term, number of the command in that term; of a WELCOME the nonce it answers
    state     node, and the manager, term and number of the WELCOME that opened its session; how many pages 0 it has
              sent since; the digest of what it runs, whose place in the frame the tag takes

So nothing that was said once is true a second time, in another place, in the other direction, or of another node.

States: none. A key is never printed: its fingerprint tells two of them apart.
"""

from hashlib import blake2s
from struct import Struct
from typing import NamedTuple

from heronry_wire.frame import WireError

KEY_BYTES = 32
TAG_PLACE = 5  # in page 0 of a state: where its tag takes the place of a digest
COMMAND_TAG_BYTES, STATE_TAG_BYTES = 6, 3
NO_NONCE = 0
BEAT_SPAN = 256  # page 0 shows how many there were modulo this
MAX_NUMBER = 0xFFFF_FFFF  # commands in one term: more than a year at a hundred in a second

_COMMAND = Struct(">BBHIQ")
_STATE = Struct(">BBHII")
_FINGERPRINT_BYTES = 4


class Place(NamedTuple):
    """How far a manager has come: a term, and the number of a command in it."""

    term: int
    number: int


class Session(NamedTuple):
    """What a WELCOME opens: the states of one PE are tagged for this manager, in this term, from this number on."""

    manager: int
    term: int
    number: int


class Key:
    """The secret of a fleet: 32 bytes."""

    def __init__(self, secret: bytes) -> None:
        """Take the secret; raises WireError where it has another length."""
        if len(secret) != KEY_BYTES:
            raise WireError(f"a key has {KEY_BYTES} bytes, this one has {len(secret)}: make one with 'heronry key'")
        self._commands = blake2s(key=secret, digest_size=COMMAND_TAG_BYTES, person=b"hrn-cmd")
        self._states = blake2s(key=secret, digest_size=STATE_TAG_BYTES, person=b"hrn-stat")
        self.fingerprint = blake2s(key=secret, digest_size=_FINGERPRINT_BYTES, person=b"hrn-name").hexdigest()

    def __repr__(self) -> str:
        return f"Key({self.fingerprint})"

    def command_tag(self, manager: int, kind: int, place: Place, payload: bytes, nonce: int = NO_NONCE) -> int:
        """Tag of a command: 48 bits."""
        tag = self._commands.copy()
        tag.update(_COMMAND.pack(manager, kind, *place, nonce))
        tag.update(payload)
        return int.from_bytes(tag.digest(), "big")

    def state_tag(self, node: int, session: Session, beat: int, said: bytes, digest: int) -> int:
        """Tag of page 0 of a state: 24 bits. `said` are its bytes before the tag, `digest` is that of what runs."""
        tag = self._states.copy()
        tag.update(_STATE.pack(node, *session, beat))
        tag.update(said)
        tag.update(digest.to_bytes(3, "big"))
        return int.from_bytes(tag.digest(), "big")


def next_number(after: int, low: int, span: int) -> int:
    """First number above `after` that is `low` modulo `span`: what a few bits of a counter stand for."""
    return after + 1 + (low - after - 1) % span
