"""A radio is not given more than it carries, and what crosses it is not old: verified by the frames on both its sides.

    age     a datum that a gateway sends by radio came to it no longer ago than T_lease, and what one frame may take in
            a controller (a heartbeat period of the radio). However slow the radio: so no queue has grown
    load    second by second, the data on a radio stay within the budget for what its gateway has reported as usable:
            the most of the last seconds, in which the manager believes a fall, plans, and the PEs take their steps. A
            quarter more is tolerated, as everywhere

A frame is known by its bytes. Where data are changed past the CRC a new one may become what an old one was: then one
that came of late and differs in a byte may be it.

Seconds in which a gateway reports that its radio is gone, or reports nothing, are not verified: a PE beyond the radio
may go on sending.
"""

from collections import defaultdict
from fractions import Fraction

from heronry_dg.model import Spec
from heronry_manager.core.topology import radios, uplink_bus
from heronry_tools.sim.oracles.limits import LEASE_PERIODS, PATIENCE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.gateway_report import PER_MILLE, LinkReport, LinkState, decode_link
from heronry_wire.timing import worst_bits

_SECOND_NS = 1_000_000_000
_REMEMBERED_S = 10  # at least; by then message codes have come round, and bytes tell no frame from another
_TOLERANCE = Fraction(5, 4)


class RadioCheck(Oracle):
    """Compares what comes to gateways, what they send, and what they report."""

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._is_altered = False  # data are, or have been, changed past the CRC
        found = radios(spec)
        self._radio_of = {radio.link_id: radio for radio in found.values()}
        self._gateway_of = {bus: radio.gateway for bus, radio in found.items()}
        self._inward = {bus: uplink_bus(spec, radio.gateway) for bus, radio in found.items()}
        self._longest_ns = {
            bus: LEASE_PERIODS * spec.buses[self._inward[bus]].heartbeat_ns + spec.buses[bus].heartbeat_ns
            for bus in found
        }
        buses = {bus: spec.buses[bus] for bus in found}
        self._budget = {name: bus.bitrate * (bus.max_load - bus.reserve) for name, bus in buses.items()}
        self._grace_ns = {bus: PATIENCE_PERIODS * spec.buses[bus].heartbeat_ns for bus in found}
        self._came: dict[tuple[str, int, bytes], int] = {}  # bus, identifier, bytes -> when
        self._came_before: dict[tuple[str, int, bytes], int] = {}  # the same, of the seconds before
        self._reports: defaultdict[str, list[tuple[int, LinkReport]]] = defaultdict(list)
        self._second = 0
        self._bits: defaultdict[str, int] = defaultdict(int)

    def altered(self) -> None:
        """Data are changed past the CRC from now on."""
        self._is_altered = True

    def measured(self, sent: Sent) -> None:
        """A gateway reports on its radio."""
        radio, report = self._radio_of.get(sent.frame.can_id), decode_link(sent.frame.data)
        if radio is not None and isinstance(report, LinkReport):
            self._reports[radio.bus].append((sent.end_ns, report))

    def published(self, sent: Sent) -> None:
        """A data frame was sent."""
        second = sent.end_ns // _SECOND_NS
        if second != self._second:
            self._close(sent.end_ns)
            self._second = second
            if not second % _REMEMBERED_S:
                self._came_before, self._came = self._came, {}
        self._came[sent.bus, sent.frame.can_id, sent.frame.data] = sent.end_ns
        if sent.bus not in self._gateway_of:
            return
        self._bits[sent.bus] += worst_bits(len(sent.frame.data))
        if sent.sender == self._gateway_of[sent.bus]:
            self._passed_on(sent)

    def _passed_on(self, sent: Sent) -> None:
        key = (self._inward[sent.bus], sent.frame.can_id, sent.frame.data)
        came_ns = self._came.get(key, self._came_before.get(key))
        if (
            came_ns is not None
            and sent.end_ns - came_ns > self._longest_ns[sent.bus]
            and not self._may_be_altered(sent)
        ):
            age_ms = (sent.end_ns - came_ns) / 1e6
            story = f"{sent.sender} sent a datum {sent.frame.can_id} by {sent.bus} that had come {age_ms:.0f} ms before"
            self.violations.append(Violation(sent.end_ns, "radio", story))

    def _may_be_altered(self, sent: Sent) -> bool:
        bus, data = self._inward[sent.bus], sent.frame.data
        return self._is_altered and any(
            (of_bus, can_id) == (bus, sent.frame.can_id)
            and sent.end_ns - came_ns <= self._longest_ns[sent.bus]
            and sum(a != b for a, b in zip(came, data, strict=False)) == 1
            for (of_bus, can_id, came), came_ns in (*self._came.items(), *self._came_before.items())
        )

    def _close(self, t_ns: int) -> None:
        for bus, bits in self._bits.items():
            usable = self._most_usable(bus, t_ns)
            if usable is not None and bits > self._budget[bus] * usable * _TOLERANCE / PER_MILLE:
                story = f"{bus} carried {bits} bits of data in a second, and {usable / 10:.0f} % of it could be used"
                self.violations.append(Violation(t_ns, "radio", story))
        self._bits.clear()

    def _most_usable(self, bus: str, t_ns: int) -> int | None:
        """The most that was reported of late; None where the radio was gone, or nothing was reported."""
        recent = [report for at_ns, report in self._reports[bus][-200:] if at_ns >= t_ns - self._grace_ns[bus]]
        if not recent or t_ns - self._reports[bus][-1][0] > _SECOND_NS:
            return None
        if any(report.state is LinkState.GONE for report in recent):
            return None
        return max(report.usable for report in recent)
