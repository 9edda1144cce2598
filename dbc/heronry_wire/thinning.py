"""Which of the repeated frames of a group of nodes a receiver needs.

Every node sends its state in each heartbeat period, and most states repeat what the last one said. A receiver that
needs to know only whether it hears any other node, and what is new, needs few of them. A *group* of identifiers is
thinned: of its frames these pass

    news    the content was not passed on within REFRESH_NS (with bytes that count up or authenticate masked out)
    a sign  the last sign that any node lives is older than `every_ns`: a frame of the group that has passed, or one of
            the identifiers `signs`, which pass anyway

So a receiver hears of a change at once, of any node at least once in `every_ns` plus the time until the next frame, and
of each node's content at least once in REFRESH_NS, even if it has missed a frame meanwhile. Lost, late and doubled
frames do no harm beyond that. A forger whose frames all have new content gets all of them passed on: then this is no
worse than without thinning.
"""

from typing import NamedTuple

REFRESH_NS = 1_000_000_000
_MOST_KEPT = 512  # contents; a forger may send any number of them


class Thinned(NamedTuple):
    """A group of 11-bit identifiers that a receiver wants thinned.

    signs: other identifiers whose frames show that a node lives; the receiver gets all of them.
    mask: of the data, as a big-endian number of 64 bits; a bit that is not set does not make a frame new.
    every_ns: how often the group gives a sign of life, where nothing is new and no other sign comes.
    """

    identifiers: frozenset[int]
    signs: frozenset[int]
    mask: int
    every_ns: int


class Thinning:
    """Decides for one receiver which frames of a group pass; it has no clock."""

    def __init__(self, group: Thinned) -> None:
        self._group = group
        self._passed_ns: dict[tuple[int, int, int], int] = {}  # by identifier, length and content
        self._sign_ns: int | None = None  # when a frame of the group passed last

    def concerns(self, can_id: int) -> bool:
        """Tell whether frames with this 11-bit identifier make a difference to the group."""
        return can_id in self._group.identifiers or can_id in self._group.signs

    def drops(self, can_id: int, data: bytes, now_ns: int) -> bool:
        """Tell whether the receiver does not need a frame, with an 11-bit identifier, that has come at `now_ns`."""
        group = self._group
        if can_id not in group.identifiers:
            if can_id in group.signs:
                self._sign_ns = now_ns
            return False
        length = len(data)
        content = can_id, length, int.from_bytes(data, "big") << (8 * (8 - length)) & group.mask
        before_ns, sign_ns = self._passed_ns.get(content), self._sign_ns
        if (
            before_ns is not None
            and now_ns - before_ns < REFRESH_NS
            and sign_ns is not None
            and now_ns - sign_ns < group.every_ns
        ):
            return True
        if before_ns is None and len(self._passed_ns) >= _MOST_KEPT:
            self._passed_ns.clear()
        self._passed_ns[content] = self._sign_ns = now_ns
        return False
