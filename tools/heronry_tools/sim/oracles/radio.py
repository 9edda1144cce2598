"""The oracle of radios: a radio gets no more data than it carries, and data that cross it are not old.

The oracle reads the frames on both sides of each radio.

    age     a gateway sends each datum by radio at most T_lease plus one heartbeat period of the radio after
            it has received the datum, however slow the radio is. The heartbeat period allows for the time
            that a frame spends in the CAN controller. If every datum keeps this limit, the gateway's queue
            has not grown
    load    in each second, the data on a radio stay within their budget: the share of the radio's bit rate
            that its gateway reports as usable, times the load that the spec allows for data. A quarter more
            is tolerated, as in `load.py`

For `load`, the largest report of the last seconds counts. When the usable share falls, the manager needs
this time to confirm the fall and to plan, and the PEs need it to take their steps. A second is not verified
if the gateway reports its radio as gone, or reports nothing: a PE beyond the radio may still send in that
second.

For `age`, a frame is recognized by its bytes. An injected error may alter data so that the CRC does not show it. Then
the frame that a gateway sends may differ in one byte from the frame that it has received.
"""

from collections import defaultdict
from fractions import Fraction

from heronry_dg.model import Spec
from heronry_dg.uplinks import radios
from heronry_manager.core.topology import uplink_bus
from heronry_tools.sim.oracles.limits import LEASE_PERIODS, PATIENCE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_wire.gateway_report import PER_MILLE, LinkReport, LinkState, decode_link
from heronry_wire.timing import worst_bits

_SECOND_NS = 1_000_000_000
_REMEMBERED_S = 10  # frames are kept at least so long; then message codes repeat, and equal bytes prove nothing
_TOLERANCE = Fraction(5, 4)


class RadioCheck(Oracle):
    """Verifies the age and the amount of the data that a gateway sends by radio."""

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._is_altered = False  # data are or were altered past the CRC
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
        self._came: dict[tuple[str, int, bytes], int] = {}  # arrival (ns) by bus, identifier, bytes
        self._came_before: dict[tuple[str, int, bytes], int] = {}  # the same, for the seconds before
        self._reports: defaultdict[str, list[tuple[int, LinkReport]]] = defaultdict(list)
        self._second = 0
        self._bits: defaultdict[str, int] = defaultdict(int)

    def altered(self) -> None:
        """Note that data frames may be altered from now on in a way that their CRC does not show."""
        self._is_altered = True

    def measured(self, sent: Sent) -> None:
        """Record a gateway's report on its radio."""
        radio, report = self._radio_of.get(sent.frame.can_id), decode_link(sent.frame.data)
        if radio is not None and isinstance(report, LinkReport):
            self._reports[radio.bus].append((sent.end_ns, report))

    def published(self, sent: Sent) -> None:
        """Remember when a datum was sent on a bus.

        If the bus is a radio, also count the bits of the datum, and verify its age if a gateway has forwarded it.
        """
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
            story = f"{sent.sender} sent datum {sent.frame.can_id} on {sent.bus} {age_ms:.0f} ms after receiving it"
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
                story = f"{bus} carried {bits} bits of data in a second, but {usable / 10:.0f} % of it was usable"
                self.violations.append(Violation(t_ns, "radio", story))
        self._bits.clear()

    def _most_usable(self, bus: str, t_ns: int) -> int | None:
        """Return the largest usable share of a radio's bandwidth that recent reports of its gateway give, per mille.

        A report is recent if it was sent within the last PATIENCE_PERIODS heartbeat periods of the radio.

        Returns None if there is no recent report, if a recent report says that the radio is gone, or if the last report
        is more than a second old.
        """
        recent = [report for at_ns, report in self._reports[bus][-200:] if at_ns >= t_ns - self._grace_ns[bus]]
        if not recent or t_ns - self._reports[bus][-1][0] > _SECOND_NS:
            return None
        if any(report.state is LinkState.GONE for report in recent):
            return None
        return max(report.usable for report in recent)
