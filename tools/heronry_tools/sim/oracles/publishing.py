"""No node publishes data that its epoch does not require of it; verified against the commanded configurations.

The state of a node names the epoch that the node follows, and the node reports a change of epoch immediately. A node
may send a data frame on a bus in two cases:

- The epoch requires this frame from a module on the node itself.
- The node is a gateway, and the epoch routes this frame over the bus, whichever module publishes it.

A node that has restarted and follows no epoch must publish nothing.

A frame may also belong to another epoch than the reported one:

- to the epoch before, for T_lease after the change: the frame was queued;
- to an epoch that was activated after the node's last state: after bus-off, a datum in the mailbox is sent before the
  next state.

Not verified: an epoch whose configuration could not be read back from the frames.
"""

from dataclasses import dataclass

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_dg.traffic import hops, identifiers
from heronry_tools.recording.commanded import Commanded
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.management import NO_EPOCH

_Key = tuple[str, str]  # bus and sender


@dataclass(slots=True)
class _Told:
    """The epoch that a node reports, the time since which it does so, and the epoch that it reported before."""

    epoch: int
    incarnation: int
    since_ns: int
    before: int = NO_EPOCH
    said_ns: int = 0  # when it reported the epoch last


class PublishingCheck(Oracle):
    """Verifies that a node sends a data frame only if the node's epoch lets it send this frame."""

    def __init__(self, spec: Spec, commanded: Commanded) -> None:
        super().__init__()
        self._commanded = commanded
        self._all = survivors(spec, Situation())
        self._identifiers = identifiers(spec)
        self._gateways = {pe.name for pe in spec.pes.values() if len(pe.buses) > 1}
        self._queued_ns = LEASE_PERIODS * max(bus.heartbeat_ns for bus in spec.buses.values())
        self._told: dict[str, _Told] = {}
        self._good: dict[_Key, frozenset[int]] = {}  # identifiers that the sender's epoch lets it publish there
        self._published: dict[int, dict[str, dict[int, str]]] = {}  # by epoch: bus, identifier, producer's PE

    def said(self, state: StateSaid) -> None:
        """Record the epoch that a PE reports."""
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
        """Verify that the epoch of the sender lets it send this data frame."""
        good = self._good.get((sent.bus, sent.sender))
        if good is None or sent.frame.can_id not in good:
            self._assess(sent)

    def _assess(self, sent: Sent) -> None:
        told = self._told.get(sent.sender)
        if told is None:
            return  # the node has just started; `planned_load` verifies data before its first state
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
            story = f"{sent.sender} sends {sent.frame.can_id} on {sent.bus}, not required by epoch {told.epoch}"
            self.violations.append(Violation(sent.end_ns, "publishing", story))

    def _identifiers_of(self, epoch: int, bus: str, sender: str) -> frozenset[int] | None:
        """Return the identifiers that a node may send on a bus in an epoch; None if that is not known."""
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
