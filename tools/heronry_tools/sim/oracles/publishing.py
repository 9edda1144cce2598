"""No node publishes what its epoch does not give it: data frames against the configurations that were commanded.

A node reports in its state which epoch it follows, and immediately when it follows another one. From then on a data
frame of its own must belong to what that epoch publishes from there; for T_lease longer it may also be one of the epoch
before, that was queued. A node may already follow what was activated since its last state: its controller was off, and
the datum was in the mailbox before the state. A gateway may send whatever the epoch routes over the bus. A node that
has started anew and follows no epoch publishes nothing: nothing runs on what is unconfigured, and what a dead node had
queued died with it.

Not verified: an epoch whose configuration could not be read back from the frames.
"""

from dataclasses import dataclass

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_dg.traffic import hops, identifiers
from heronry_tools.sim.oracles.commanded import Commanded
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.management import NO_EPOCH

_Key = tuple[str, str]  # bus and sender


@dataclass(slots=True)
class _Told:
    """What a node has reported: which epoch it follows, since when, and which one it followed before."""

    epoch: int
    incarnation: int
    since_ns: int
    before: int = NO_EPOCH
    said_ns: int = 0  # when it reported that last


class PublishingCheck(Oracle):
    """Follows data frames and the epochs of their senders."""

    def __init__(self, spec: Spec, commanded: Commanded) -> None:
        super().__init__()
        self._commanded = commanded
        self._all = survivors(spec, Situation())
        self._identifiers = identifiers(spec)
        self._gateways = {pe.name for pe in spec.pes.values() if len(pe.buses) > 1}
        self._queued_ns = LEASE_PERIODS * max(bus.heartbeat_ns for bus in spec.buses.values())
        self._told: dict[str, _Told] = {}
        self._good: dict[_Key, frozenset[int]] = {}  # what the sender's epoch publishes there
        self._published: dict[int, dict[str, dict[int, str]]] = {}  # by epoch: bus, identifier, producer's PE

    def said(self, state: StateSaid) -> None:
        """A node reports itself which epoch it follows."""
        sender, t_ns, page = state.pe, state.t_ns, state.page
        told = self._told.get(sender)
        if told is None or told.incarnation != page.incarnation:
            self._told[sender] = _Told(page.epoch, page.incarnation, t_ns)
        elif told.epoch != page.epoch:
            self._told[sender] = _Told(page.epoch, page.incarnation, t_ns, told.epoch)
        self._told[sender].said_ns = t_ns
        for key in [key for key in self._good if key[1] == sender]:
            del self._good[key]

    def published(self, sent: Sent) -> None:
        """A data frame was sent."""
        good = self._good.get((sent.bus, sent.sender))
        if good is None or sent.frame.can_id not in good:
            self._assess(sent)

    def _assess(self, sent: Sent) -> None:
        told = self._told.get(sent.sender)
        if told is None:
            return  # it has just started; data before its first state are for `planned_load`
        queued = told.before if sent.end_ns - told.since_ns <= self._queued_ns else told.epoch
        good: set[int] = set()
        epochs = self._commanded.epochs.values()
        since = {one.number for one in epochs if one.activated_ns is not None and one.activated_ns >= told.said_ns}
        for epoch in {told.epoch, queued, *since} - {NO_EPOCH}:
            found = self._identifiers_of(epoch, sent.bus, sent.sender)
            if found is None:
                return
            good |= found
            if epoch == told.epoch:
                self._good[sent.bus, sent.sender] = found
        if sent.frame.can_id not in good:
            story = f"{sent.sender} sends {sent.frame.can_id} on {sent.bus}, which epoch {told.epoch} does not ask for"
            self.violations.append(Violation(sent.end_ns, "publishing", story))

    def _identifiers_of(self, epoch: int, bus: str, sender: str) -> frozenset[int] | None:
        """What an epoch lets a node send on a bus; None where that cannot be known."""
        if epoch not in self._published:
            known = self._commanded.epochs.get(epoch)
            if known is None or known.configuration is None:
                return None
            self._published[epoch] = self._read(known.configuration)
        on_bus = self._published[epoch].get(bus, {})
        return frozenset(i for i, pe in on_bus.items() if pe == sender or sender in self._gateways)

    def _read(self, configuration: Configuration) -> dict[str, dict[int, str]]:
        published: dict[str, dict[int, str]] = {}
        for hop in hops(self._all, configuration):
            identifier = self._identifiers[hop.producer, hop.variable]
            published.setdefault(hop.bus, {})[identifier] = configuration.modules[hop.producer].pe
        return published
