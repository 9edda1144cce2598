"""The report of a gateway on its radio: which share of the radio's bandwidth can be used.

    LINK, of radio r       291 + r       sent toward the manager by the gateway between r and the manager

Radios are numbered in the spec's order; there are nine identifiers. The gateway sends a report on its uplink every
heartbeat period of the radio, and immediately when the radio is gone or back. Other gateways on the way to the manager
forward the report.

Reports are not acknowledged. The next report replaces a lost one, a doubled report has no effect, and a late report is
recognized by its sequence number. A forged report can make the manager treat the radio as gone, or plan with a
bandwidth that the radio does not have.

Malformed bytes decode to `Malformed`; encoding a number that does not fit raises ValueError.

Source: docs/protocol.md, protocol rule 9.
"""

from dataclasses import dataclass
from enum import IntEnum

from heronry_wire.frame import Malformed, WireError
from heronry_wire.identifiers import GATEWAY_IDS, PE_NODES
from heronry_wire.layout import Field, Layout

PER_MILLE = 1000


class LinkState(IntEnum):
    """Whether the gateway hears frames from beyond its radio."""

    UP = 0
    GONE = 1  # no frame came from beyond the radio for as many periods as its bus allows to be missed


LINK = Layout(
    "LINK",
    Field("node", 8),
    Field("state", 2, {state.value: state.name for state in LinkState}),
    Field("sequence", 6),
    Field("usable", 16, unit="per mille"),
    Field("delivered", 8, unit="%"),
    Field("queued", 8),
    Field("dropped", 16),
)
SEQUENCES = 64
_DROPS = 1 << 16


@dataclass(frozen=True, slots=True)
class LinkReport:
    """Condition of a radio, as measured by the gateway between the radio and the manager."""

    node: int  # of the gateway
    state: LinkState
    sequence: int  # modulo 64
    usable: int  # usable bandwidth, in thousandths of the radio's bit rate
    delivered: int  # frames from beyond the radio that arrived, in per cent of those that were sent
    queued: int  # frames that wait at the gateway; 255 stands for more
    dropped: int  # frames that the gateway has dropped since its start, modulo 65536

    def encode(self) -> bytes:
        """Encode the payload of LINK."""
        dropped = self.dropped % _DROPS
        return LINK.pack(
            self.node, self.state, self.sequence, self.usable, self.delivered, min(self.queued, 255), dropped
        )


def link_id(radio: int) -> int:
    """Return the identifier of the reports on a radio; raises WireError if `radio` is not one of the numbers 0 to 8.

    radio: position of the radio among the wireless buses of the spec, from 0.
    """
    if not 0 <= radio < len(GATEWAY_IDS):
        raise WireError(
            f"radio number {radio}, counted from 0, has no identifier for the reports of its gateway: "
            f"identifiers exist for {len(GATEWAY_IDS)} radios"
        )
    return GATEWAY_IDS[radio]


def decode_link(data: bytes) -> LinkReport | Malformed:
    """Decode the payload of a LINK frame; `Malformed` with the reason where the payload is not valid."""
    fields = LINK.unpack(data)
    if fields is None:
        return Malformed("LINK has a wrong length")
    node, state, sequence, usable, delivered, queued, dropped = fields
    if node not in PE_NODES or state not in tuple(LinkState) or usable > PER_MILLE or delivered > 100:
        return Malformed("LINK has an impossible node, state or share")
    return LinkReport(node, LinkState(state), sequence, usable, delivered, queued, dropped)
