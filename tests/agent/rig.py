"""Hosts for images under test: one module at a time, or all modules of a spec in one loop without a bus."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from heronry_agent.module import DISAGREEMENT, Datum, Inputs, Module, Value
from heronry_agent.shell.image_catalogues import find_image
from heronry_dg.gates import Leaf
from heronry_dg.model import Mode, Spec
from heronry_tools.aircraft.plant import Plant

SECOND_NS = 1_000_000_000
FRESH_PERIODS = 3


@dataclass
class Host:
    """The context of one module: it reads and writes by two functions, and remembers what was reported."""

    module: str = "module_under_test"
    mode: str = "only"
    period_ns: int = 25_000_000
    now_ns: int = 0
    device: str = "device_under_test"
    reading: Callable[[int], Value | None] = lambda _now_ns: None
    drive: Callable[[Value, int], object] | None = None
    written: list[Value] = field(default_factory=list)
    reports: list[tuple[str, int]] = field(default_factory=list)
    phases: list[str] = field(default_factory=list)

    def read(self) -> Value | None:
        return self.reading(self.now_ns)

    def write(self, value: Value) -> None:
        self.written.append(value)
        if self.drive is not None:
            self.drive(value, self.now_ns)

    def report_failed(self, element: str, detail: int = 0) -> None:
        assert 0 <= detail <= 0xFFFF
        self.reports.append((element, detail))

    def report_disagreement(self, detail: int = 0) -> None:
        self.reports.append((DISAGREEMENT, detail))

    def request_priority(self, function: str, priority: int | None) -> None:
        """A test that uses it has a host of its own."""

    def request_phase(self, phase: str) -> None:
        self.phases.append(phase)

    @property
    def reported(self) -> list[str]:
        return [element for element, _ in self.reports]


class Rig:
    """One image on its host: `step(variable=value)` feeds it and moves time on by one period."""

    def __init__(self, image: str, mode: str = "only", rate_hz: float = 40, module: str = "module_under_test") -> None:
        self.host = Host(module=module, mode=mode, period_ns=round(SECOND_NS / rate_hz))
        self.module: Module = find_image(image)(self.host)

    def step(self, **given: Value | None) -> Mapping[str, Value]:
        """Values by variable; None for one that is not supplied."""
        return self.feed({name: Datum(value, 1, 0) for name, value in given.items() if value is not None})

    def feed(self, data: Mapping[str, Datum]) -> Mapping[str, Value]:
        outputs = self.module.step(Inputs({str(i): (name, datum) for i, (name, datum) in enumerate(data.items())}))
        self.host.now_ns += self.host.period_ns
        return outputs

    def run(self, seconds: float, **given: Value | None) -> Mapping[str, Value]:
        """Step with the same inputs for some time; gives the last outputs."""
        outputs: Mapping[str, Value] = {}
        for _ in range(round(seconds * SECOND_NS / self.host.period_ns)):
            outputs = self.step(**given)
        return outputs


@dataclass
class _Running:
    host: Host
    module: Module
    mode: Mode


class Flight:
    """Modules of a spec, each in one mode, in one synchronous loop on one plant.

    A datum reaches every reader immediately; it is fresh for three periods of its producer, as on a real host.
    """

    def __init__(self, spec: Spec, modes: Mapping[str, str], plant: Plant | None = None) -> None:
        self.spec = spec
        self.plant = plant or Plant(0)
        self.now_ns = 0
        self.running: dict[str, _Running] = {}
        self.data: dict[str, dict[int, tuple[Value, int, int]]] = {}  # variable -> version -> value, made, stale
        for name, mode in modes.items():
            self.start(name, mode)

    def start(self, name: str, mode_name: str) -> None:
        module, mode = self.spec.modules[name], self.spec.modules[name].modes[mode_name]
        host = Host(module=name, mode=mode_name, period_ns=1_000_000_000_000 // mode.rate_mhz)
        if module.device is not None:
            device = host.device = module.device
            host.reading = lambda now_ns: self.plant.read(device, now_ns)
            host.drive = lambda value, now_ns: self.plant.write(device, value, now_ns)
        self.running[name] = _Running(host, find_image(module.image)(host), mode)

    def stop(self, name: str) -> None:
        del self.running[name]

    @property
    def reports(self) -> list[str]:
        return [element for running in self.running.values() for element in running.host.reported]

    def value(self, variable: str) -> Value | None:
        """Best fresh value of a variable."""
        datum = self._freshest(variable, range(1, 16))
        return None if datum is None else datum.value

    def fly(self, seconds: float, tick_ns: int = 12_500_000) -> None:
        end_ns = self.now_ns + round(seconds * SECOND_NS)
        while self.now_ns < end_ns:
            for name in list(self.running):
                if self.now_ns % self.running[name].host.period_ns < tick_ns:
                    self._step(name)
            self.now_ns += tick_ns

    def _step(self, name: str) -> None:
        running = self.running[name]
        running.host.now_ns = self.now_ns
        outputs = running.module.step(Inputs(dict(self._wired(running.mode.leaves()))))
        assert outputs.keys() <= running.mode.gives.keys(), name
        for variable, value in outputs.items():
            stale_ns = self.now_ns + FRESH_PERIODS * running.host.period_ns
            version = running.mode.gives[variable]
            self.data.setdefault(variable, {})[version] = (value, self.now_ns, stale_ns)

    def _wired(self, leaves: Iterable[tuple[str, Leaf]]) -> Iterable[tuple[str, tuple[str, Datum]]]:
        for path, leaf in leaves:
            datum = self._freshest(leaf.variable, range(leaf.best, leaf.worst + 1))
            if datum is not None:
                yield path, (leaf.variable, datum)

    def _freshest(self, variable: str, versions: range) -> Datum | None:
        held = self.data.get(variable, {})
        for version in versions:
            if version in held:
                value, made_ns, stale_ns = held[version]
                if self.now_ns <= stale_ns:
                    return Datum(value, version, self.now_ns - made_ns)
        return None


def best_modes(spec: Spec) -> dict[str, str]:
    """Every module in its best mode, and of each DEMUX the primary branch alone."""
    spare = {branch for demux in spec.demuxes.values() for branch in demux.branches[1:]}
    return {name: next(iter(module.modes)) for name, module in spec.modules.items() if name not in spare}
