"""A snapshot as metrics for Prometheus, in its text format; names and units by Prometheus' conventions.

A metric is a figure of each PE, bus, function or module, or of the manager. A figure that is not known has no sample:
the feed, from which the snapshot is made, does not give it. Times are seconds, shares are ratios from 0 to 1, sizes are
bytes. A state is given by one sample for each of its possible names: 1 for the present name, 0 for all others. Counters
are 0 when the feed begins.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, get_args

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from heronry_tools.watch.snapshot import Bus, Function, Pe, Snapshot, Standing
from heronry_wire.node_cost import NodeCost

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

_NS_PER_S = 1_000_000_000
_TIMES = ("detect", "decide", "distribute", "activate")
_COSTS: tuple[tuple[str, str, Callable[[NodeCost], float]], ...] = (
    ("wake_ups_per_second", "Wake-ups of the agent", lambda cost: cost.wake_ups_per_s),
    ("agent_cpu_used_ratio", "Processor time of the agent, of one core,", lambda cost: cost.agent_per_mille / 1000),
    ("modules_cpu_used_ratio", "The same of its partitions and drivers,", lambda cost: cost.modules_per_mille / 1000),
    ("longest_turn_seconds", "Longest turn of the agent", lambda cost: cost.longest_turn_us / 1_000_000),
)


def exposition(snapshot: Snapshot) -> bytes:
    """Return the page that Prometheus scrapes."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Once(snapshot))
    return bytes(generate_latest(registry))


class _Once:
    """A collector that gives the metrics of one snapshot to the library of Prometheus."""

    def __init__(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot

    def collect(self) -> Iterator[Metric]:
        """Yield every metric of the snapshot."""
        view = self._snapshot
        yield from _system(view)
        yield from _pes(view)
        yield from _buses(view)
        yield from _functions(view)
        yield from _reconfigurations(view)


def _gauge(name: str, text: str, labels: tuple[str, ...], samples: Iterable[tuple[tuple[str, ...], Any]]) -> Metric:
    family = GaugeMetricFamily(f"heronry_{name}", text, labels=labels)
    for values, sample in samples:
        if sample is not None:
            family.add_metric(values, float(sample))
    return family


def _counter(name: str, text: str, labels: tuple[str, ...], samples: Iterable[tuple[tuple[str, ...], Any]]) -> Metric:
    family = CounterMetricFamily(f"heronry_{name}", text, labels=labels)
    for values, sample in samples:
        family.add_metric(values, float(sample))
    return family


def _system(view: Snapshot) -> Iterator[Metric]:
    names = ("spec", "spec_digest", "phase", "stage", "manager_state")
    values = (view.spec, view.spec_digest, view.phase or "", view.stage, view.manager.state or "")
    yield _gauge("info", "Spec, phase and stage, as labels.", names, [(values, 1)])
    yield _gauge("epoch", "Epoch of the running configuration.", (), [((), view.epoch)])
    yield _gauge("term", "Term of the active manager.", (), [((), view.manager.term)])
    yield _gauge("manager_node", "Node-ID of the manager.", (), [((), view.manager.node)])
    yield _gauge("latched_faults", "Latched faults.", (), [((), len(view.faults))])
    down = [((element,), 1) for element in view.down]
    yield _gauge("element_down", "Elements that the situation lacks.", ("element",), down)
    yield _counter("events", "Events of the feed.", (), [((), view.events)])
    yield _counter("lost_events", "Events that this reader was too slow for.", (), [((), view.lost_lines)])
    plants = [
        ((name,), None if plant.state is None else plant.state == "on_path") for name, plant in view.plants.items()
    ]
    yield _gauge("control_loop_closed", "Whether the control loop through a plant is closed.", ("plant",), plants)


def _pes(view: Snapshot) -> Iterator[Metric]:
    pes = view.pes.items()
    yield _gauge(
        "pe_standing",
        "Standing of a PE with the manager: 1 for the present one.",
        ("pe", "standing"),
        (((name, one), pe.standing == one) for name, pe in pes for one in get_args(Standing)),
    )
    ages = (((name,), _age_s(view, pe)) for name, pe in pes)
    yield _gauge("pe_silence_seconds", "Time since the last frame of a PE.", ("pe",), ages)
    for kind, unit, text in (("cpu", "ratio", "CPU"), ("ram", "ratio", "RAM"), ("flash", "ratio", "Flash")):
        shares = (((name,), _share(getattr(pe, kind))) for name, pe in pes)
        yield _gauge(f"pe_{kind}_planned_{unit}", f"{text} of a PE that the configuration uses.", ("pe",), shares)
    measured = (((name,), None if pe.load_percent is None else pe.load_percent / 100) for name, pe in pes)
    yield _gauge("pe_cpu_measured_ratio", "CPU load that a PE measures.", ("pe",), measured)
    yield _gauge("pe_modules", "Modules placed on a PE.", ("pe",), (((name,), len(pe.modules)) for name, pe in pes))
    yield _counter("pe_reboots", "Boots of a PE seen.", ("pe",), (((name,), pe.reboots) for name, pe in pes))
    restarts = (((name,), pe.restarts) for name, pe in pes)
    yield _counter("pe_module_restarts", "Restarts of modules that a PE has reported.", ("pe",), restarts)
    for part, text, of in _COSTS:
        costs = (((name,), None if pe.cost is None else of(pe.cost)) for name, pe in pes)
        yield _gauge(f"pe_{part}", f"{text} of a PE in the last 10 s.", ("pe",), costs)
    yield _counter("pe_standstills", "Long standstills of a PE.", ("pe",), (((n,), pe.stood_still) for n, pe in pes))


def _buses(view: Snapshot) -> Iterator[Metric]:
    buses = view.buses.items()
    loads: tuple[tuple[str, str, Any], ...] = (
        ("bus_load_ratio", "Share of the bit rate used in the last second.", lambda bus: bus.load),
        ("bus_load_peak_ratio", "Share used in the busiest 100 ms of the last second.", lambda bus: bus.peak),
        ("bus_load_planned_ratio", "Share of the bit rate that the configuration plans.", lambda bus: bus.planned),
        ("bus_frames_per_second", "Frames in the last second.", lambda bus: bus.frames_per_s),
        ("bus_bit_rate", "Bits per second of a bus.", lambda bus: bus.bit_rate),
    )
    for name, text, of in loads:
        yield _gauge(name, text, ("bus",), (((bus,), of(one)) for bus, one in buses))
    by_kind = (((name, kind), bits) for name, bus in buses for kind, bits in bus.bits_per_s.items())
    yield _gauge("bus_bits_per_second", "Bits in the last second, by kind of traffic.", ("bus", "kind"), by_kind)
    yield _counter("bus_errors", "Error frames of a bus.", ("bus",), (((name,), bus.errors) for name, bus in buses))
    lacking = (((name, channel), len(by)) for name, bus in buses for channel, by in bus.channels.items())
    yield _gauge("channel_lost_by_nodes", "Nodes that hear nothing on a channel.", ("bus", "channel"), lacking)
    links = (((name,), _link(bus)) for name, bus in buses if bus.link is not None)
    yield _gauge("link_usable_ratio", "Usable share of the bandwidth of a radio.", ("bus",), links)


def _functions(view: Snapshot) -> Iterator[Metric]:
    functions = view.functions.items()
    facts: tuple[tuple[str, str, Any], ...] = (
        ("function_wanted", "Whether a function is wanted in this phase.", lambda one: one.wanted),
        ("function_served", "Whether a function is served, as planned.", lambda one: one.served),
        ("function_degraded", "Whether a function is served in a lesser mode.", lambda one: one.degraded),
        ("function_heard", "Whether the outputs of a function are heard on the bus.", lambda one: one.heard),
        ("function_value", "Value of a function, 0 to 100.", lambda one: one.value),
        ("function_priority", "Priority of a function.", lambda one: one.priority),
    )
    for name, text, of in facts:
        samples = (((function, one.criticality), of(one)) for function, one in functions)
        yield _gauge(name, text, ("function", "criticality"), samples)
    missing = (((name, one.criticality), _missing_s(view, one)) for name, one in functions)
    text = "For how long a function has been wanted and not served."
    yield _gauge("function_unserved_seconds", text, ("function", "criticality"), missing)
    restarts = (((name,), module.restarts) for name, module in view.modules.items())
    yield _counter("module_restarts", "Restarts of a module that its PE has reported.", ("module",), restarts)


def _reconfigurations(view: Snapshot) -> Iterator[Metric]:
    last = view.reconfigurations[-1] if view.reconfigurations else None
    done = 0 if last is None else last.number
    yield _counter("reconfigurations", "Reconfigurations that are done.", (), [((), done)])
    times = [] if last is None else [((part,), getattr(last.times_ns, part)) for part in _TIMES]
    seconds = [(labels, None if ns is None else ns / _NS_PER_S) for labels, ns in times]
    yield _gauge("last_reconfiguration_seconds", "The four times of the last reconfiguration.", ("part",), seconds)


def _age_s(view: Snapshot, pe: Pe) -> float | None:
    return None if pe.last_heard_ns is None else max(0, view.t_ns - pe.last_heard_ns) / _NS_PER_S


def _missing_s(view: Snapshot, function: Function) -> float:
    return 0.0 if function.not_since_ns is None else (view.t_ns - function.not_since_ns) / _NS_PER_S


def _share(budget: Any) -> float | None:
    return budget.used / budget.of if budget.of else None


def _link(bus: Bus) -> float:
    return 0.0 if bus.link in (None, "gone") else float(str(bus.link).removesuffix("%")) / 100
