"""The share of each radio's bandwidth that plans may use, from the reports of its gateway.

Reports fluctuate, and a plan must not follow each fluctuation. So there are fixed steps (`STEPS`), and plans use one of
them. What changes the step of a radio depends on its state:

    settling   no PE beyond the radio has been available since the start, or since the radio was gone. Each report sets
               the step directly. This interrupts no PE, and a PE that returns gets a plan that fits the radio
    followed   some PE beyond the radio has been available since the start, or since the radio was gone. The step falls
               and rises by the rules below
    gone       the gateway hears nothing from beyond the radio, so all PEs there are lost together

In the state followed:

- The step falls after two reports in a row that are more than a tenth below it. The new step is the largest one that is
  not above the reported bandwidth; from 90 % on, it is 100 %. With a longer wait the queues of the gateway would grow.
- The step rises when, for ten heartbeat periods of the radio, all reports were at least a twentieth above a higher
  step (for the step 100 %, at least 94.5 %). If a fall comes within a minute of the fall before, these ten periods are
  doubled, to forty at most. After a minute without a fall, the next fall sets them to ten again.

If a report is lost, the next one replaces it. A late or doubled report is recognized by its sequence number and
dropped. A report from another node than the gateway is dropped as well. `heronry_wire.gateway_report` says what a
forged report can do. While a gateway is silent the step of its radio stays, and the state frames show which PEs beyond
the radio are lost. After a restart of the manager nothing is known here until the next report.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from heronry_dg.model import Spec
from heronry_dg.uplinks import Radio, radios
from heronry_wire.frame import Frame, Malformed
from heronry_wire.gateway_report import PER_MILLE, SEQUENCES, LinkReport, LinkState, decode_link
from heronry_wire.protocol_times import FORGIVEN_AFTER_NS, HOLD_DOWN_PERIODS

STEPS = (1000, 800, 600, 400, 250, 160, 80, 40, 20, 0)  # thousandths of the bit rate
_LATE = 8  # a report that is fewer numbers behind the last one is late; with more, the gateway has restarted
MOST_DOUBLINGS = 2
_BELOW, _ABOVE = Fraction(9, 10), Fraction(21, 20)


@dataclass(frozen=True, slots=True)
class LinkChange:
    """A change of a radio that plans must take into account.

    what: limited, gone or back.
    step: the share of its bandwidth that plans may use from now on, per mille.
    """

    what: str
    radio: Radio
    step: int


@dataclass(slots=True)
class LinkRecord:
    """What the manager remembers of one radio: the share of bandwidth that plans use, and the gateway's reports.

    All shares are shares of the radio's bandwidth, in per mille.
    """

    radio: Radio
    period_ns: int
    step: int = PER_MILLE  # the share that plans use, in thousandths
    gone: bool = False
    settling: bool = True  # no PE beyond the radio has been available since the start, or since the radio was gone
    report: LinkReport | None = None
    low: bool = False  # the last report was more than a tenth below the step
    rising_since_ns: int | None = None  # since when all reports have been high enough for a higher step
    lowest: int = PER_MILLE  # lowest usable share reported since `rising_since_ns`
    falls: int = 0  # each within a minute of the fall before
    fell_ns: int = 0  # time of the last fall

    def is_new(self, report: LinkReport) -> bool:
        """Tell whether a report is newer than the last one: neither late nor doubled."""
        if self.report is None:
            return True
        behind = (self.report.sequence - report.sequence) % SEQUENCES
        return behind >= _LATE

    def hold_down_ns(self) -> int:
        """Return how long an increase of bandwidth must last before plans use it, in nanoseconds."""
        return self.period_ns * HOLD_DOWN_PERIODS << min(max(0, self.falls - 1), MOST_DOUBLINGS)


class RadioLinks:
    """Keeps, for every radio that a gateway reports on, the share of its bandwidth that plans may use."""

    def __init__(self, spec: Spec) -> None:
        self.records = {
            radio.link_id: LinkRecord(radio, spec.buses[radio.bus].heartbeat_ns) for radio in radios(spec).values()
        }
        self._gateway_nodes = {one.radio.bus: spec.pes[one.radio.gateway].node_id for one in self.records.values()}

    def limits(self) -> Mapping[str, Fraction]:
        """Return the share of bandwidth that plans may use, by `bus:NAME`, for each radio where it is less than 1."""
        short = (record for record in self.records.values() if record.step < PER_MILLE)
        return {f"bus:{record.radio.bus}": Fraction(record.step, PER_MILLE) for record in short}

    def restarted(self, gateway: str) -> None:
        """Forget the last reports of a lost gateway, since after a restart it numbers its reports anew."""
        for record in self.records.values():
            if record.radio.gateway == gateway:
                record.report = None

    def heard(self, frame: Frame, now_ns: int, *, any_pe_beyond: bool) -> list[LinkChange]:
        """Note a gateway's report on its radio; returns the changes that plans must take into account.

        any_pe_beyond: some PE beyond the radio is available.
        """
        record = self.records[frame.can_id]
        report = decode_link(frame.data)
        if isinstance(report, Malformed) or report.node != self._gateway_nodes[record.radio.bus]:
            return []
        if not record.is_new(report):
            return []
        record.report = report
        if report.state is LinkState.GONE:
            return self._lose(record)
        changes = []
        if record.gone:
            record.gone = False
            changes.append(LinkChange("back", record.radio, record.step))
        if any_pe_beyond:
            record.settling = False
        return [*changes, *self._follow(record, report.usable, now_ns)]

    def _lose(self, record: LinkRecord) -> list[LinkChange]:
        if record.gone:
            return []
        record.gone = record.settling = True
        record.step = PER_MILLE  # when the radio is back, the next report sets the step
        record.low, record.rising_since_ns = False, None
        return [LinkChange("gone", record.radio, 0)]

    def _follow(self, record: LinkRecord, usable: int, now_ns: int) -> list[LinkChange]:
        """Change the share of a radio's bandwidth that plans may use, if a report demands it.

        usable: the share that the report gives as usable, per mille.
        Returns the change; an empty list if there is none.
        """
        if record.settling:
            return self._set(record, _step_below(usable))
        was_low, record.low = record.low, usable < record.step * _BELOW
        if record.low:
            record.rising_since_ns = None
            return self._fall(record, usable, now_ns) if was_low else []
        if _step_below(int(usable / _ABOVE)) <= record.step:
            record.rising_since_ns = None
            return []
        return self._rise(record, usable, now_ns)

    def _fall(self, record: LinkRecord, usable: int, now_ns: int) -> list[LinkChange]:
        forgiven = now_ns - record.fell_ns >= FORGIVEN_AFTER_NS
        record.falls, record.fell_ns = 1 if forgiven else record.falls + 1, now_ns
        record.low = False
        return self._set(record, _step_below(usable))

    def _rise(self, record: LinkRecord, usable: int, now_ns: int) -> list[LinkChange]:
        if record.rising_since_ns is None:
            record.rising_since_ns, record.lowest = now_ns, usable
        record.lowest = min(record.lowest, usable)
        if now_ns - record.rising_since_ns < record.hold_down_ns():
            return []
        record.rising_since_ns = None
        return self._set(record, _step_below(int(record.lowest / _ABOVE)))

    def _set(self, record: LinkRecord, step: int) -> list[LinkChange]:
        if step == record.step:
            return []
        record.step = step
        return [LinkChange("limited", record.radio, step)]


def _step_below(usable: int) -> int:
    """Return the largest of `STEPS` (per mille) not above the share that a gateway reports; 1000 from 900 on."""
    return next(step for step in STEPS if usable >= (step if step < PER_MILLE else PER_MILLE * _BELOW))
