"""Recovers the digest of a page 1 that has a tag in the place of the digest, for oracles that know the key.

A tag depends on a digest and a session. WELCOME opens a session, and every node hears it. So the oracle tries the known
digests in the known sessions. It thus finds the staged epoch of a PE from frames alone, as it does without a key.

An attacker that forges nonces makes a manager send WELCOME repeatedly, but the PE stays in its session. So the session
whose tag was correct last is tried first and dropped last.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

from heronry_wire.authentication import PAGE_1_BEAT, Key, Session
from heronry_wire.management import Control, Operation
from heronry_wire.state_frames import StatePage1, split_state

_SESSIONS = 512  # kept per PE: a manager answers forged nonces every few milliseconds for a whole attack


class ProvenStates:
    """Remembers the sessions of every PE, and verifies the tags of pages 1 with them."""

    def __init__(self, key: Key) -> None:
        self._key = key
        self._sessions: dict[int, deque[Session]] = {}  # by node

    def commanded(self, manager: int, control: Control) -> None:
        """Read a CONTROL of a manager; a WELCOME opens a session."""
        if control.operation is Operation.WELCOME:
            opened = self._sessions.setdefault(control.node, deque(maxlen=_SESSIONS))
            opened.append(Session(manager, control.term, control.a << 16 | control.b))

    def read(self, node: int, page: StatePage1, digests: Iterable[int]) -> StatePage1:
        """Return `page` with the digest that its tag proves: one of `digests`, or 0 if the tag proves none of them."""
        said, tag = split_state(page.encode())
        sessions, meant = self._sessions.get(node, deque()), [*digests, 0]
        for session in reversed(sessions):
            for digest in meant:
                if self._key.state_tag(node, session, PAGE_1_BEAT, said, digest) == tag:
                    sessions.remove(session)
                    sessions.append(session)
                    return replace(page, staged_digest=digest)
        return replace(page, staged_digest=0)
