"""The nonces of a PE with a key: numbers used once, which prove that an answer is not an old one (protocol rule 11).

A manager answers a nonce with the command WELCOME, whose tag covers the nonce. A nonce is valid for T_lease; then a new
one is drawn. The salt is different at every start of the agent, so nonces are never predictable or used twice. A nonce
contains a tag of its own, by which a manager recognizes that a PE with the key has sent the nonce.

The challenge of a sealed table comes from the same salt. It stays the same until the agent ends, and everybody may read
it.
"""

from hashlib import blake2s

from heronry_wire.authentication import CHALLENGE_BYTES, DRAWN_BITS, NO_NONCE, Key


def drawn_challenge(salt: bytes) -> int:
    """Draw the challenge of a PE, a number of 32 bits; `salt`: secret bytes, different at every start."""
    return int.from_bytes(blake2s(b"challenge", key=salt, digest_size=CHALLENGE_BYTES).digest())


class Nonces:
    """Draws the nonces of one PE."""

    def __init__(self, key: Key, node: int, salt: bytes, *, serves_ns: int, now_ns: int) -> None:
        """Begin without a nonce.

        salt: secret bytes, different at every start.
        serves_ns: time in ns for which a nonce is valid.
        """
        self._key, self._node, self._salt, self._serves_ns = key, node, salt, serves_ns
        self._nonce, self._drawn, self._drawn_ns = NO_NONCE, 0, now_ns

    def good(self, now_ns: int) -> int:
        """Return the nonce that is valid now; NO_NONCE if there is none."""
        return self._nonce if now_ns - self._drawn_ns <= self._serves_ns else NO_NONCE

    def to_say(self, now_ns: int) -> int:
        """Return the nonce to send now: the valid one, or else a new one."""
        if self.good(now_ns) == NO_NONCE:
            self._drawn, self._drawn_ns = self._drawn + 1, now_ns
            digest = blake2s(self._drawn.to_bytes(8), key=self._salt, digest_size=DRAWN_BITS // 8).digest()
            self._nonce = self._key.nonce(self._node, int.from_bytes(digest) or 1)
        return self._nonce
