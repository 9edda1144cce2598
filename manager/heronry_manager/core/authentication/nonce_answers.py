"""Which nonces of a PE a manager answers: those that a holder of the key has made, and each for a short time.

A nonce has a tag of its own (`Key.is_plausible`). A nonce with a wrong tag is not answered, so a forged page 2 does not
use up the answers. But an attacker may send a nonce again that was recorded on the bus, and its tag is right. Therefore
these rules hold for each nonce with a right tag:

- It is not answered twice within half a heartbeat period.
- It is not answered when twice T_lease have passed since it was first heard, since no PE uses a nonce for so long.
- It is not answered if four nonces of this PE (`_AT_ONCE`) were answered in the last heartbeat period. The limit is
  more than one, so that a few recorded nonces do not prevent the answer to the nonce that the PE uses.

The PE repeats a page 2 that was lost. A late or doubled page 2 costs one answer at most.
"""

from collections import deque

from heronry_wire.protocol_times import t_lease_ns

_AT_ONCE = 4
_REMEMBERED = 256  # nonces of one PE


class NonceAnswers:
    """Decides which nonces of one PE the manager answers."""

    def __init__(self, period_ns: int) -> None:
        """Begin with no nonce heard; `period_ns` is the heartbeat period of the PE's uplink."""
        self._period_ns = period_ns
        self._first_ns: dict[int, int] = {}  # when each nonce was first heard, oldest first
        self._answered_ns: dict[int, int] = {}
        self._last_ns: deque[int] = deque(maxlen=_AT_ONCE)  # times of the last answers

    def is_due(self, nonce: int, now_ns: int) -> bool:
        """Tell whether the manager must answer this nonce now; if so, the nonce counts as answered.

        The caller has already verified the tag of the nonce.
        """
        first_ns = self._first_ns.setdefault(nonce, now_ns)
        if len(self._first_ns) > _REMEMBERED:
            oldest = next(iter(self._first_ns))
            del self._first_ns[oldest]
            self._answered_ns.pop(oldest, None)
        before_ns = self._answered_ns.get(nonce)
        is_early = before_ns is not None and now_ns - before_ns < self._period_ns // 2
        is_old = now_ns - first_ns > 2 * t_lease_ns(self._period_ns)
        are_many = len(self._last_ns) == _AT_ONCE and now_ns - self._last_ns[0] < self._period_ns
        if is_early or is_old or are_many:
            return False
        self._answered_ns[nonce] = now_ns
        self._last_ns.append(now_ns)
        return True
