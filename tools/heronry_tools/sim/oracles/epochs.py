"""An epoch number stands for one configuration, and no PE returns to an older epoch; verified from state frames.

There are two rules:

- An epoch has one digest: the same in all state frames that name the epoch, on every bus and for the whole flight.
- The epoch number of a PE never falls within an incarnation. (A change from no epoch to an epoch is a rise.) Only
  frames that the PE itself sends are compared: a gateway forwards states late, and perhaps in another order.

The last state of each PE is kept for `end_state`.
"""

from dataclasses import dataclass

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.identifiers import state_id
from heronry_wire.management import NO_EPOCH, is_newer
from heronry_wire.state_frames import StatePage0, StatePage1, decode_state, without_sequence


@dataclass(slots=True)
class LastState:
    """The last page 0 of a PE, and the time at which it was heard.

    meaning: the bytes of the page without the sequence number.
    """

    t_ns: int
    page: StatePage0
    meaning: bytes


class EpochCheck(Oracle):
    """Verifies by the state frames that an epoch has one digest, and that no PE returns to an older epoch."""

    def __init__(self, spec: Spec, *, has_digests: bool = True) -> None:
        """Begin with no state frame seen.

        has_digests: False in flights with a key: there, state frames have a tag in the place of the digest.
        """
        self._has_digests = has_digests
        super().__init__()
        self._owners = {state_id(pe.node_id): pe.name for pe in spec.pes.values()}
        self.last: dict[tuple[str, int], LastState] = {}  # by bus and identifier
        self._digests: dict[int, int] = {}

    def changed_page(self, sent: Sent) -> StatePage0 | StatePage1 | None:
        """Verify a state frame; return its page if this is a page 1 or a changed page 0, else None."""
        key = (sent.bus, sent.frame.can_id)
        data = sent.frame.data
        meaning = without_sequence(data)
        before = self.last.get(key)
        if before is not None and before.meaning == meaning:
            before.t_ns = sent.end_ns
            return None
        page = decode_state(data)
        if isinstance(page, StatePage1):
            return page
        if not isinstance(page, StatePage0):
            return None
        if before is not None and sent.sender == self._owners.get(sent.frame.can_id):
            self._compare(sent, before.page, page)
        self.last[key] = LastState(sent.end_ns, page, meaning)
        has_digest = self._has_digests and page.epoch != NO_EPOCH
        if has_digest and self._digests.setdefault(page.epoch, page.digest) != page.digest:
            story = f"{sent.sender} reports epoch {page.epoch} with digest {page.digest:06X}; it had another before"
            self.violations.append(Violation(sent.end_ns, "digest", story))
        return page

    def _compare(self, sent: Sent, before: StatePage0, page: StatePage0) -> None:
        if before.incarnation == page.incarnation and is_newer(before.epoch, page.epoch):
            story = f"{sent.sender} went back from epoch {before.epoch} to {page.epoch}"
            self.violations.append(Violation(sent.end_ns, "epoch", story))
