"""The nonces of a PE with a key: an answer whose tag covers a nonce is proven to be fresh (protocol rule 11).

A nonce is valid for T_lease; then a new one is drawn. The salt is different at every start of the agent, so no nonce
can be predicted, and none is used twice. A nonce carries a tag of its own: a manager answers no nonce without it.
"""

from hashlib import blake2s

from heronry_wire.authentication import DRAWN_BITS, NO_NONCE, Key


class Nonces:
    """Draws the nonces of one PE."""

    def __init__(self, key: Key, node: int, salt: bytes, *, serves_ns: int, now_ns: int) -> None:
        """salt: secret, different at every start. serves_ns: how long an answer to a nonce is accepted."""
        self._key, self._node, self._salt, self._serves_ns = key, node, salt, serves_ns
        self._nonce, self._drawn, self._drawn_ns = NO_NONCE, 0, now_ns

    def good(self, now_ns: int) -> int:
        """Nonce to which an answer is still accepted; NO_NONCE if there is none."""
        return self._nonce if now_ns - self._drawn_ns <= self._serves_ns else NO_NONCE

    def to_say(self, now_ns: int) -> int:
        """Give the nonce to send now: the present one while it is valid, else a new one."""
        if self.good(now_ns) == NO_NONCE:
            self._drawn, self._drawn_ns = self._drawn + 1, now_ns
            digest = blake2s(self._drawn.to_bytes(8), key=self._salt, digest_size=DRAWN_BITS // 8).digest()
            self._nonce = self._key.nonce(self._node, int.from_bytes(digest) or 1)
        return self._nonce
