"""What should be on one bus, as a spec describes it. This needs pydantic, which a node lacks; see `expected`."""

from heronry_dg.check.wire import lacks_identifiers
from heronry_dg.echo_rates import EchoRates
from heronry_dg.model import Spec
from heronry_dg.own_identifiers import own_identifiers
from heronry_manager.core.topology import uplink_bus
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.doctor.expected import Expected


def expected_in(spec: str) -> Expected:
    """Return what the spec that the argument SPEC names says about its manager's bus; raises UserError or SpecError."""
    loaded = load_spec(spec)
    return expected_by_spec(loaded, loaded.manager.bus)


def expected_by_spec(spec: Spec, bus_name: str) -> Expected:
    """Return what a spec says about one of its buses."""
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
