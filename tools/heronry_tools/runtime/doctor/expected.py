"""What should be on one bus, as a spec or the table of a PE describes it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from heronry_wire.pe_table import PeTable
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS

if TYPE_CHECKING:
    from heronry_dg.model import Foreign, Spec


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
    """Give what the table of a PE says about its bus toward the manager; raises TableError."""
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


def expected_by_spec(spec: "Spec", bus_name: str) -> Expected:
    """Give what a spec says about one of its buses."""
    from heronry_dg.check.wire import lacks_identifiers  # noqa: PLC0415 - a small install lacks pydantic
    from heronry_dg.echo_rates import EchoRates  # noqa: PLC0415
    from heronry_dg.own_identifiers import own_identifiers  # noqa: PLC0415
    from heronry_manager.core.topology import uplink_bus  # noqa: PLC0415

    bus, rates = spec.buses[bus_name], EchoRates(spec)
    here = [pe for pe in spec.pes.values() if rates.carries(bus_name, pe.name)]
    uplinks = {pe.node_id: uplink_bus(spec, pe.name) for pe in here}
    return Expected(
        spec.name,
        spec.digest,
        bus.bitrate,
        {pe.node_id: pe.name for pe in here},
        bus.channels,
        bus.heartbeat_ns,
        bus.kind == "wireless",
        own=None if lacks_identifiers(spec) else frozenset(own_identifiers(spec)[bus_name]),
        foreign=bus.foreign,
        asked=frozenset(node for node, uplink in uplinks.items() if uplink == bus_name),
        periods_ns={node: max(bus.heartbeat_ns, spec.buses[uplink].heartbeat_ns) for node, uplink in uplinks.items()},
        most_load=float(bus.max_load),
    )
