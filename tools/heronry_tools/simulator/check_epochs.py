"""One number, one configuration: epochs judged from the state frames alone.

Whoever names an epoch names one digest with it, on every bus, for ever. Within an incarnation a PE's epoch never goes
back; on each bus by itself, since a gateway hands on what it heard a moment ago. (From nothing to an epoch is forward.)

The last state of each PE is kept for who judges the end.
"""

from dataclasses import dataclass

from heronry_tools.simulator.bus import Sent
from heronry_tools.simulator.violation import Violation
from heronry_wire.management import NO_EPOCH, StatePage0, decode_state, is_newer


@dataclass(slots=True)
class LastState:
    """Page 0 of a PE's state, and when it was heard; `meaning` are its bytes without the sequence."""

    t_ns: int
    page: StatePage0
    meaning: bytes


class EpochCheck:
    """Follows the state frames."""

    def __init__(self) -> None:
        self.violations: list[Violation] = []
        self.last: dict[tuple[str, int], LastState] = {}  # by bus and identifier
        self._digests: dict[int, int] = {}

    def state(self, sent: Sent) -> None:
        """A state frame was sent."""
        key = (sent.bus, sent.frame.can_id)
        data = sent.frame.data
        meaning = data[:4] + data[5:]
        before = self.last.get(key)
        if before is not None and before.meaning == meaning:
            before.t_ns = sent.end_ns
            return
        page = decode_state(data)
        if not isinstance(page, StatePage0):
            return
        if before is not None:
            self._compare(sent, before.page, page)
        self.last[key] = LastState(sent.end_ns, page, meaning)
        if page.epoch != NO_EPOCH and self._digests.setdefault(page.epoch, page.digest) != page.digest:
            story = f"{sent.sender} runs epoch {page.epoch} as {page.digest:06X}, others as another configuration"
            self.violations.append(Violation(sent.end_ns, "digest", story))

    def _compare(self, sent: Sent, before: StatePage0, page: StatePage0) -> None:
        if before.incarnation == page.incarnation and is_newer(before.epoch, page.epoch):
            story = f"{sent.sender} went back from epoch {before.epoch} to {page.epoch}"
            self.violations.append(Violation(sent.end_ns, "epoch", story))
