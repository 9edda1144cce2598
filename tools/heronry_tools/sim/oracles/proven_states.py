"""The digest of a page 1 that has a tag in its place: found out with the key, by the oracles of a run.

A tag fits a digest in a session, and sessions are opened by WELCOME, which every node hears. Nothing is asked of the
cores: what a PE has staged is known here from the frames alone, as it is without a key.

An attacker that forges nonces makes a manager send WELCOME again and again, for nothing: the PE goes on in the session
that it has. So the session that has fitted last is tried first and forgotten last.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import replace

from heronry_wire.authentication import PAGE_1_BEAT, Key, Session
from heronry_wire.management import Control, Operation
from heronry_wire.state_frames import StatePage1, split_state

_SESSIONS = 512  # of one PE: a forged nonce is answered every few milliseconds, for as long as an attack may last


class ProvenStates:
    """Follows the sessions of every PE."""

    def __init__(self, key: Key) -> None:
        self._key = key
        self._sessions: dict[int, deque[Session]] = {}  # by node

    def commanded(self, manager: int, control: Control) -> None:
        """Follow a CONTROL of a manager: it may be a WELCOME."""
        if control.operation is Operation.WELCOME:
            opened = self._sessions.setdefault(control.node, deque(maxlen=_SESSIONS))
            opened.append(Session(manager, control.term, control.a << 16 | control.b))

    def read(self, node: int, page: StatePage1, digests: Iterable[int]) -> StatePage1:
        """Put the digest in its place, if it is one of these; 0 where none of them fits."""
        said, tag = split_state(page.encode())
        sessions, meant = self._sessions.get(node, deque()), [*digests, 0]
        for session in reversed(sessions):
            for digest in meant:
                if self._key.state_tag(node, session, PAGE_1_BEAT, said, digest) == tag:
                    sessions.remove(session)
                    sessions.append(session)
                    return replace(page, staged_digest=digest)
        return replace(page, staged_digest=0)
