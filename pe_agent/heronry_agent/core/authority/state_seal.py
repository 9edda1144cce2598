"""How a PE with a key authenticates its states to its manager: sessions, and the tag of each page (protocol rule 11).

A session with a manager

- begins with WELCOME, the command by which the manager answers a nonce of this PE (`authenticity`). The number of the
  WELCOME identifies the session, since a manager uses no number twice in a term;
- goes on when the manager sends another WELCOME in the same term. Forged frames can make a PE ask for a WELCOME, and
  must not change the session;
- ends with the command RENEW, or with the term.

Only the session with the active manager is used. Without a session, pages carry the tag 0.

Every page 0 carries the lowest byte of a counter, which counts the pages 0 on the uplink since the PE started. The tag
covers a second counter, which counts the pages 0 of the session. Both counters must have the same lowest byte. So the
second counter does not begin at zero, but at the byte that the first page 0 of the session carries.

The tag of a page 0 also covers one EMCY that waits to be acknowledged. If several EMCYs wait, successive pages cover
them in turn.
"""

from collections.abc import Callable, Sequence

from heronry_agent.core.authority.followed_manager import FollowedManager
from heronry_wire.authentication import BEAT_SPAN, NO_EMERGENCY, PAGE_1_BEAT, Key, Session


class StateSeal:
    """Keeps the sessions of one PE, and computes the tags of its state pages."""

    def __init__(
        self, node: int, key: Key, followed_manager: FollowedManager, pending: Callable[[], Sequence[bytes]]
    ) -> None:
        """Begin without a session; `pending` returns every EMCY that the manager has not acknowledged yet."""
        self._node, self._key, self._followed_manager, self._pending = node, key, followed_manager, pending
        self._sessions: dict[int, Session] = {}  # by manager
        self._first_beat: int | None = None

    @property
    def session(self) -> Session | None:
        """The session with the active manager; None if this manager has begun no session in its present term."""
        session = self._sessions.get(self._followed_manager.manager)
        return session if session is not None and session.term == self._followed_manager.term else None

    def welcomed(self, manager: int, term: int, counter: int) -> None:
        """Begin a session with a manager, unless there is one with this manager in this term.

        counter: number of the WELCOME.
        """
        session = self._sessions.get(manager)
        if session is not None and session.term == term:
            return
        self._sessions[manager] = Session(manager, term, counter)
        self._first_beat = None

    def end_session(self) -> None:
        """End the session of the active manager."""
        self._sessions.pop(self._followed_manager.manager, None)

    def tag(self, beat: int | None, said: bytes, digest: int) -> int:
        """Return the tag of a page on the uplink; 0 without a session.

        beat: number of a page 0; None for a page 1. said: the bytes of the page before the digest.
        """
        session = self.session
        if session is None:
            return 0
        if beat is None:
            return self._key.state_tag(self._node, session, PAGE_1_BEAT, said, digest)
        if self._first_beat is None:
            self._first_beat = beat - beat % BEAT_SPAN
        pending = self._pending()
        emergency = pending[beat % len(pending)] if pending else NO_EMERGENCY
        return self._key.state_tag(self._node, session, beat - self._first_beat, said, digest, emergency=emergency)
