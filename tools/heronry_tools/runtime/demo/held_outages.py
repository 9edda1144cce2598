"""Gathers outages, so that a demo on a busy computer does not report each outage in a line of its own.

An outage that comes when nothing was reported for a second is reported at once. Outages that come within a second after
a report are held, and are reported together at the end of that second.
"""

from collections.abc import Sequence

from heronry_tools.runtime.witness import Outage

TELL_AGAIN_NS = 1_000_000_000


class HeldOutages:
    """Holds outages of one kind until they are to be reported.

    The constructor's `are_over` chooses the kind: True: outages that are over; False: outages that still last.
    The caller passes in all times, in ns.
    """

    def __init__(self, *, are_over: bool) -> None:
        self._are_over = are_over
        self._held: list[Outage] = []
        self._told_ns: int | None = None

    def take(self, outages: Sequence[Outage]) -> None:
        """Hold those of `outages` that are of this object's kind: either over, or still lasting.

        An object for outages that still last also drops each held outage that has ended according to `outages`.
        """
        if not self._are_over:
            ended = {(one.function, one.from_ns) for one in outages if one.to_ns is not None}
            self._held = [one for one in self._held if (one.function, one.from_ns) not in ended]
        self._held += [one for one in outages if (one.to_ns is not None) == self._are_over]

    def due(self, now_ns: int) -> list[Outage]:
        """Return the held outages if they are to be reported now, and hold them no longer.

        The list is empty if the last report was less than a second ago.
        """
        if not self._held or (self._told_ns is not None and now_ns - self._told_ns < TELL_AGAIN_NS):
            return []
        self._told_ns = now_ns
        return self.all()

    def all(self) -> list[Outage]:
        """Return all held outages, and hold them no longer."""
        held, self._held = self._held, []
        return held
