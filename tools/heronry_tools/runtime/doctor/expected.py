"""What should be on one bus, as the table of a PE describes it; `expected_by_spec` has what a spec says of it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from heronry_wire.pe_table import PeTable
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS

if TYPE_CHECKING:
    from heronry_dg.model import Foreign


@dataclass(frozen=True, slots=True)
class Expected:
    """One bus as a spec or a PE's table describes it: its nodes, bit rate, channels and heartbeat period.

    pes: the PEs whose states this bus carries, those beyond gateways too: node-ID -> name.
    asked: of these, the nodes that an SDO client on this bus reaches: no gateway forwards SDO. None: all of them.
    periods_ns: heartbeat period of each of them, by node-ID; empty: not known.
    own: the identifiers that the system itself uses there; None: not known.
    foreign: declared frames of other equipment.
    most_load: the share of the bit rate that all frames together may take; None: not known.
    """

    spec: str
    digest: str
    bitrate: int
    pes: dict[int, str]
    channels: int = 1
    heartbeat_ns: int = USUAL_HEARTBEAT_NS
    is_radio: bool = False  # its bit rate is that of the radio link, not of the adapter
    own: frozenset[int] | None = None
    foreign: tuple["Foreign", ...] = ()
    asked: frozenset[int] | None = None
    periods_ns: dict[int, int] = field(default_factory=dict)
    most_load: float | None = None


def expected_by_table(file: Path) -> Expected:
    """Return what the table of a PE says about its bus toward the manager; raises TableError."""
    table = PeTable.from_json(file.read_text(encoding="utf-8"))
    port = table.ports[table.uplink]
    return Expected(
        table.spec,
        table.spec_digest,
        port.bitrate,
        {n: f"node {n}" for n in (*port.nodes, table.node_id)},
        port.channels,
        port.heartbeat_ns,
        port.wireless,
    )
