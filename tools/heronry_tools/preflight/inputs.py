"""Whether data come on every wired input, and outputs from every function, as far as the buses show it.

The running configuration tells who sends which identifier how often. A source is *silent* if nothing came from it for
longer than five of its periods, and longer than T_lease of the bus. A datum whose producer lacks another silent datum
is not named itself: it follows from that one. Data between modules of one PE are on no bus; the PE itself tells which
of them are silent.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation, survivors
from heronry_dg.traffic import hops, identifiers
from heronry_tools.reports.findings import Finding
from heronry_tools.runtime.witness import Witness
from heronry_wire.canaerospace import decode_data
from heronry_wire.frame import Frame, Malformed
from heronry_wire.protocol_times import t_lease_ns

_PERIODS = 5
_NS_PER_MS = 1_000_000
_Datum = tuple[str, str]  # producer and variable


@dataclass(slots=True)
class _Source:
    """One datum on one bus.

    node: of its producer. patience_ns: after a longer silence it is silent.
    last_ns: of its last frame, or the beginning of the listening. longest_ns: its longest silence.
    """

    node: int
    period_ns: int
    patience_ns: int
    last_ns: int
    longest_ns: int = 0
    frames: int = 0


@dataclass(slots=True)
class WiredInputs:
    """Listens to the data of one configuration on some buses of a spec, from `begun_ns` on."""

    spec: Spec
    configuration: Configuration
    now: Situation
    buses: Collection[str]
    begun_ns: int
    witness: Witness = field(init=False)
    _sources: dict[tuple[str, int], _Source] = field(init=False)
    _data: dict[tuple[str, int], _Datum] = field(init=False)
    _on_a_bus: frozenset[_Datum] = field(init=False)

    def __post_init__(self) -> None:
        """Work out which data the buses carry."""
        self.witness = Witness(self.spec)
        self._sources, self._data = {}, {}
        given = identifiers(self.spec)
        for hop in hops(survivors(self.spec, self.now), self.configuration):
            if hop.bus not in self.buses:
                continue
            pe = self.configuration.modules[hop.producer].pe
            period_ns = 10**12 // self.spec.modules[hop.producer].modes[hop.mode].rate_mhz
            patience_ns = max(_PERIODS * period_ns, t_lease_ns(self.spec.buses[hop.bus].heartbeat_ns))
            key = hop.bus, given[hop.producer, hop.variable]
            self._sources[key] = _Source(self.spec.pes[pe].node_id, period_ns, patience_ns, self.begun_ns)
            self._data[key] = hop.producer, hop.variable
        self._on_a_bus = frozenset(self._data.values())

    @property
    def wired(self) -> frozenset[_Datum]:
        """Return the data that an input takes: producer and variable of each."""
        return frozenset((wire.producer, wire.variable) for _, _, wire in self.configuration.wires())

    @property
    def patience_ns(self) -> int:
        """How long to listen, in ns, so that every silence and every function is judged."""
        functions = [self.witness.patience_ns(name) for name in self.spec.functions]
        return max([*functions, *(source.patience_ns for source in self._sources.values())], default=0)

    def take(self, bus: str, t_ns: int, frame: Frame) -> None:
        """Take a frame that ended at `t_ns` on a bus of the spec."""
        if frame.error or frame.extended or frame.remote:
            return
        if bus == self.spec.manager.bus:
            self.witness.see(t_ns, frame)
        source = self._sources.get((bus, frame.can_id))
        if source is None:
            return
        datum = decode_data(frame)
        if not isinstance(datum, Malformed) and datum.node_id == source.node:
            source.longest_ns = max(source.longest_ns, t_ns - source.last_ns)
            source.last_ns = t_ns
            source.frames += 1

    def findings(self, end_ns: int, told: Collection[_Datum] = ()) -> Iterator[Finding]:
        """Return findings about data, and about the functions in the configuration, after listening up to `end_ns`.

        told: data that PEs report as silent themselves; they may be on no bus.
        """
        wired = self.wired
        silent: dict[_Datum, _Source | None] = dict.fromkeys(one for one in told if one in wired)
        for key, source in self._sources.items():
            source.longest_ns = max(source.longest_ns, end_ns - source.last_ns)
            if source.longest_ns > source.patience_ns and silent.get(self._data[key]) is None:
                silent[self._data[key]] = source
        roots = self._roots(silent)
        for producer in dict.fromkeys(datum[0] for datum in roots):
            yield self._silence(producer, {one: source for one, source in silent.items() if one[0] == producer})
        others = len(silent) - sum(datum[0] in {root[0] for root in roots} for datum in silent)
        if others:
            says = f"{others} more {'datum is' if others == 1 else 'data are'} silent, which follows from the above"
            yield Finding("inputs", says, "repeat it when that is mended")
        if not silent:
            yield Finding("inputs", f"fresh data come on {self._heard()}")
        yield from self._functions(silent, end_ns)

    def _heard(self) -> str:
        wires = [(wire.producer, wire.variable) for _, _, wire in self.configuration.wires()]
        heard = sum(datum in self._on_a_bus for datum in wires)
        rest = "" if heard == len(wires) else "; the others are on no bus that is heard here"
        return f"{heard} of {len(wires)} wired inputs{rest}"

    def _silence(self, producer: str, data: Mapping[_Datum, _Source | None]) -> Finding:
        pe, device = self.configuration.modules[producer].pe, self.spec.modules[producer].device
        sources = [source for source in data.values() if source is not None]
        named = ", ".join(variable for _, variable in data)
        what = f"gives {named} with gaps" if any(source.frames for source in sources) else f"gives no {named}"
        readers = dict.fromkeys(
            consumer for consumer, _, wire in self.configuration.wires() if (wire.producer, wire.variable) in data
        )
        if sources:
            longest = max(sources, key=lambda source: source.longest_ns)
            heard = (
                f"{longest.longest_ns / _NS_PER_MS:.0f} ms of silence, due every {longest.period_ns / _NS_PER_MS:g} ms"
            )
        else:
            heard = "as its readers report"
        look = f"look at device:{device}, and" if device is not None else "look"
        says = f"{producer} on {pe} {what} ({heard}), which goes to {', '.join(readers)}"
        return Finding("inputs", says, f"{look} into the log of the agent of {pe}")

    def _roots(self, silent: Collection[_Datum]) -> list[_Datum]:
        """Return the silent data that follow from no other one; of a loop of silent data all of them."""
        upstream = {datum: self._lacked(datum[0], silent) for datum in silent}
        for _ in silent:  # as many steps as a way through all of them has
            upstream = {datum: found.union(*(upstream[one] for one in found)) for datum, found in upstream.items()}
        return [datum for datum in silent if all(datum in upstream[one] for one in upstream[datum])]

    def _lacked(self, module: str, silent: Collection[_Datum]) -> set[_Datum]:
        """Return the silent data that a module lacks, itself or by data that are on no bus."""
        found, seen, frontier = set[_Datum](), {module}, [module]
        while frontier:
            for wire in self.configuration.modules[frontier.pop()].inputs.values():
                datum = wire.producer, wire.variable
                if datum in silent:
                    found.add(datum)
                elif datum not in self._on_a_bus and wire.producer not in seen:
                    seen.add(wire.producer)
                    frontier.append(wire.producer)
        return found

    def _functions(self, silent: Collection[_Datum], end_ns: int) -> Iterator[Finding]:
        serving = {
            name: next((one for one in function.outputs if one in self.configuration.modules), None)
            for name, function in self.spec.functions.items()
        }
        judged = {name: module for name, module in serving.items() if module is not None}
        unheard = [name for name in judged if not self.witness.served(name, end_ns)]
        for name in unheard:
            module = judged[name]
            if not self._lacked(module, silent):
                pe = self.configuration.modules[module].pe
                says = f"{name} is served as planned, but no output of {module} on {pe} is heard"
                yield Finding("functions", says, f"look into the log of the agent of {pe}")
        if not unheard:
            yield Finding("functions", f"the outputs of {len(judged)} functions are heard")
