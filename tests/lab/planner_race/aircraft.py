"""Specs of drawn aircraft, composed of the blocks that aircraft are made of.

    control loop   two sensors of unlike quality, an estimator, a controller with feedback, two servos behind a DEMUX
    voting         three sensors, a voter (two of three, or exactly one), an annunciator
    payload        a sensor, a heavy program in three modes, a recorder; not wanted in every phase
    second source  another program for a state that is estimated already, on another PE
    monitor        reads the data there are, as optional inputs

Two buses are joined by one gateway. PEs come in three kinds, so that many are equal. Sensors and servos are bolted to
PEs; programs run where there is room (some require a feature, or are bound to a few PEs).

CPU and memory are drawn as weights and scaled at the end. The CPU of all modules in their best modes adds up to `work`
times the CPU of all PEs: at 1.05 some modules cannot run in their best mode, at 1.5 many cannot run. RAM and flash add
up to half of what the PEs have. The buses could carry two thirds of all data. The heartbeat period is the shortest with
which management fits into the reserve of the buses; a few data still miss their deadlines wherever they are wanted.
"""

import random
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

Fields = dict[str, object]
Needs = str | Fields | None

PHASES: Final = ("cruise", "survey")
_MEMORY_SHARE: Final = 0.5
_BITRATES: Final = (250_000, 500_000, 1_000_000)
_FRAME_BITS: Final = 135  # at most
_DATA_SHARE: Final = 0.7  # of a bit rate
_RESERVE: Final = 0.1
_HEARTBEATS_MS: Final = (20, 50, 100, 200)
_CLASSES: Final = {"loop": "AAB", "vote": "BC", "payload": "DE", "monitor": "CDE"}


@dataclass(frozen=True, slots=True)
class _Kind:
    """A kind of PE."""

    cpu_millis: int
    ram: int  # bytes
    flash: int
    features: tuple[str, ...]


_KINDS: Final = (
    _Kind(600, 48 << 10, 192 << 10, ()),
    _Kind(800, 64 << 10, 256 << 10, ("fpu",)),
    _Kind(1000, 96 << 10, 384 << 10, ("fpu", "vector")),
)


@dataclass(frozen=True, slots=True)
class _Mode:
    """A mode, with CPU and RAM as weights."""

    needs: Needs
    gives: Mapping[str, int]
    cpu: float
    rate_hz: int


@dataclass
class _Module:
    """A module; its flash is drawn like RAM."""

    modes: list[_Mode]  # best first
    device: str | None = None
    requires: Sequence[str] = ()
    runs_on: Sequence[str] = ()


@dataclass
class Aircraft:
    """One aircraft, whose spec `document` draws."""

    rng: random.Random
    module_count: int
    pe_count: int
    _kinds: dict[str, _Kind] = field(default_factory=dict)  # by PE
    _devices: dict[str, Fields] = field(default_factory=dict)
    _variables: dict[str, Fields] = field(default_factory=dict)
    _gates: dict[str, Fields] = field(default_factory=dict)
    _modules: dict[str, _Module] = field(default_factory=dict)
    _functions: dict[str, Fields] = field(default_factory=dict)
    _separate: list[list[str]] = field(default_factory=list)
    _together: list[list[str]] = field(default_factory=list)
    _states: dict[str, str] = field(default_factory=dict)  # what programs estimate, for others to read -> estimator
    _seconds: set[str] = field(default_factory=set)  # states that have a second source
    _drawn: Counter[str] = field(default_factory=Counter)  # blocks so far, by kind

    def document(self, work: float) -> Fields:
        """Draw the aircraft; gives the spec as the content of its file."""
        for number in range(self.pe_count):
            self._kinds[f"pe{number:02}"] = _KINDS[(0, 1, 2, 0, 1, 0, 1, 2)[number % 8]]
        blocks = self._blocks()
        while (room := self.module_count - len(self._modules)) > 0:
            self._block(next(blocks), room)
        bitrate = self._bitrate()
        return {
            "dg": 1,
            "name": f"generated_{self.module_count}_x_{self.pe_count}",
            "buses": {"can0": self._bus(bitrate), "can1": self._bus(max(_BITRATES[0], bitrate // 2))},
            "manager": {"bus": "can0"},
            "pes": dict(self._pes()),
            "devices": self._devices,
            "variables": self._variables,
            "gates": self._gates,
            "modules": self._scaled(work),
            "functions": self._functions,
            "phases": {phase: {} for phase in PHASES},
            "separate": self._separate,
            "together": self._together,
        }

    def _pes(self) -> Iterator[tuple[str, Fields]]:
        """Two thirds of the PEs on the first bus, the others on the second one; the gateway is one of the largest."""
        for number, (name, kind) in enumerate(self._kinds.items()):
            buses = ["can0"] if number < self.pe_count * 2 // 3 else ["can1"]
            yield (
                name,
                {
                    "node_id": 92 + number,
                    "buses": ["can0", "can1"] if number == 2 else buses,
                    "cpu": kind.cpu_millis / 1000,
                    "ram": kind.ram,
                    "flash": kind.flash,
                    "features": list(kind.features),
                },
            )

    def _bitrate(self) -> int:
        """Choose the least bit rate that would carry two thirds of all data, best modes, all of it published."""
        best = [module.modes[0] for module in self._modules.values()]
        bits_per_s = sum(_FRAME_BITS * mode.rate_hz * len(mode.gives) for mode in best)
        return next((b for b in _BITRATES if 3 * b * _DATA_SHARE >= 2 * bits_per_s), _BITRATES[-1])

    def _bus(self, bitrate: int) -> Fields:
        """Give a bus the shortest heartbeat with which two thirds of the PEs and a manager keep to the reserve."""
        frames = self.pe_count * 2 // 3 + 3
        fitting = (ms for ms in _HEARTBEATS_MS if frames * _FRAME_BITS * 1000 <= ms * bitrate * _RESERVE)
        return {"bitrate": bitrate, "heartbeat_ms": next(fitting, _HEARTBEATS_MS[-1])}

    # Blocks

    def _blocks(self) -> Iterator[str]:
        yield from ("loop", "vote", "payload", "second", "monitor")
        while True:
            yield self.rng.choice(("loop", "loop", "vote", "payload", "second", "monitor"))

    def _block(self, block: str, room: int) -> None:
        """Draw a block, or a monitor where there is no room for it."""
        size = {"loop": 7, "vote": 5, "payload": 3, "second": 1, "monitor": 1}[block]
        open_states = [state for state in self._states if state not in self._seconds]
        if size > room or (block == "second" and not open_states):
            block = "monitor"
        name = f"{block}{self._drawn[block]}"
        self._drawn[block] += 1
        match block:
            case "loop":
                self._loop(name)
            case "vote":
                self._vote(name)
            case "payload":
                self._payload(name)
            case "second":
                self._second(name, self.rng.choice(open_states))
            case _:
                self._monitor(name)

    def _loop(self, name: str) -> None:
        rate = self.rng.choice((25, 40, 50))
        raw, state, demand, feedback = (
            self._variable(f"{name}_{v}", 2) for v in ("raw", "state", "demand", "position")
        )
        self._variables[feedback].update(type="FLOAT", initial=0)
        self._sensor(f"{name}_sensor_a", {raw: 1}, 2 * rate)
        self._sensor(f"{name}_sensor_b", {raw: 2}, rate)
        others, beside = self._some_states(2), self._some_states(1)
        fused: Needs = {"and": [f"{raw}@1", _optional(others)]} if others else f"{raw}@1"
        self._modules[f"{name}_estimator"] = _Module(
            [
                _Mode(fused, {state: 1}, self.rng.uniform(3, 5), rate),
                _Mode(raw, {state: 2}, self.rng.uniform(2, 3), rate),
            ],
            requires=self.rng.choice(((), ("fpu",))),
        )
        self._states[state] = f"{name}_estimator"
        self._modules[f"{name}_controller"] = _Module(
            [
                _Mode(
                    {"and": [state, _optional([feedback, *beside])]},
                    {demand: 1},
                    self.rng.uniform(3, 4),
                    rate,
                ),
                _Mode(
                    {"or": {"k": 1, "of": [f"{state}@1", f"{state}@2"]}}, {demand: 2}, self.rng.uniform(2, 3), rate // 2
                ),
            ],
            runs_on=self._few_pes(),
        )
        self._gates[f"{name}_out"] = {"demux": demand}
        for servo in (f"{name}_servo_a", f"{name}_servo_b"):
            self._bolted(servo, "actuator", _Mode(f"{name}_out", {feedback: 1}, 1, rate))
        self._modules[f"{name}_monitor"] = _Module([_Mode({"and": [demand, feedback]}, {}, self.rng.uniform(1, 3), 10)])
        self._function(name, "loop", f"{name}_out")
        self._function(f"{name}_watch", "monitor", f"{name}_monitor")

    def _vote(self, name: str) -> None:
        rate = self.rng.choice((10, 20))
        raws = [self._variable(f"{name}_raw_{which}") for which in "abc"]
        for raw in raws:
            self._sensor(f"{raw}_sensor", {raw: 1}, rate)
        voted, beside = self._variable(f"{name}_voted", 2), self._some_states(2)
        self._modules[f"{name}_voter"] = _Module(
            [
                _Mode({"or": {"k": 2, "of": list(raws)}}, {voted: 1}, self.rng.uniform(2, 4), rate),
                _Mode({"xor": list(raws)}, {voted: 2}, self.rng.uniform(1, 2), rate),
            ]
        )
        self._states[voted] = f"{name}_voter"
        self._modules[f"{name}_annunciator"] = _Module(
            [_Mode({"and": [voted, _optional(beside)]}, {}, self.rng.uniform(1, 3), rate)]
        )
        if self.rng.random() < 0.5:
            self._together.append([f"{name}_voter", f"{name}_annunciator"])
        self._function(name, "vote", f"{name}_annunciator")

    def _payload(self, name: str) -> None:
        rate = self.rng.choice((5, 10))
        frame, product = self._variable(f"{name}_frame"), self._variable(f"{name}_product", 3)
        self._sensor(f"{name}_camera", {frame: 1}, rate)
        where = self._some_states(3)
        self._modules[f"{name}_program"] = _Module(
            [
                _Mode({"and": [frame, *where[:1]]}, {product: 1}, self.rng.uniform(4, 6), rate),
                _Mode({"and": [frame, _optional(where)]}, {product: 2}, self.rng.uniform(2, 4), rate),
                _Mode(frame, {product: 3}, self.rng.uniform(1, 2), rate // 2),
            ],
            requires=self.rng.choice(((), ("fpu",), ("vector",))),
        )
        self._bolted(f"{name}_recorder", "actuator", _Mode({"or": {"k": 1, "of": [product, frame]}}, {}, 1, rate))
        self._function(name, "payload", f"{name}_recorder")

    def _second(self, name: str, state: str) -> None:
        """Draw a second estimate of a state, from less: worse than the best, and never on the same PE."""
        self._seconds.add(state)
        needs: Needs = _optional(others) if (others := self._some_states(2, before=state)) else None
        self._modules[name] = _Module([_Mode(needs, {state: 2}, self.rng.uniform(1, 3), 10)])
        self._separate.append([self._states[state], name])

    def _monitor(self, name: str) -> None:
        read = self._some_states(4)
        self._modules[name] = _Module(
            [
                _Mode(_optional(read), {}, self.rng.uniform(2, 4), 10),
                _Mode({"or": {"k": 1, "of": read[:2]}}, {}, self.rng.uniform(1, 2), 5),
            ],
            runs_on=self._few_pes(),
        )
        self._function(name, "monitor", name)

    # Parts

    def _variable(self, name: str, versions: int = 1) -> str:
        self._variables[name] = {"type": self.rng.choice(("FLOAT", "FLOAT", "SHORT2", "UCHAR")), "versions": versions}
        return name

    def _some_states(self, most: int, before: str | None = None) -> list[str]:
        """Pick states to read; only states that were drawn before another one, so that no cycle is possible."""
        known = list(self._states)
        known = known[: known.index(before)] if before is not None else known
        return self.rng.sample(known, min(len(known), self.rng.randint(1, most)))

    def _sensor(self, name: str, gives: Mapping[str, int], rate_hz: int) -> None:
        self._bolted(name, "sensor", _Mode(None, gives, 1, rate_hz))

    def _bolted(self, name: str, kind: str, mode: _Mode) -> None:
        """Draw a device and its driver; neighbours in the spec are bolted to different PEs."""
        last = next(reversed(self._devices.values()), {"pe": None})["pe"]
        device = f"{name}_device"
        self._devices[device] = {"kind": kind, "pe": self.rng.choice([pe for pe in self._kinds if pe != last])}
        self._modules[name] = _Module([mode], device=device)

    def _few_pes(self) -> Sequence[str]:
        """Draw four PEs out of all, or no bounds."""
        return self.rng.sample(list(self._kinds), 4) if self.rng.random() < 0.3 else ()

    def _function(self, name: str, block: str, output: str) -> None:
        """Draw a function; every other payload is wanted in the second phase alone."""
        priority: object = self.rng.randint(1, 10) * 10
        if block == "payload" and self.rng.random() < 0.5:
            priority = {"default": 0, PHASES[1]: priority}
        criticality: object = self.rng.choice(_CLASSES[block])
        if block == "monitor" and self.rng.random() < 0.3:
            criticality = {"default": criticality, PHASES[1]: "B"}
        self._functions[name] = {"output": output, "criticality": criticality, "priority": priority}

    # Scale

    def _scaled(self, work: float) -> Fields:
        """Turn weights into thousandths of a core and bytes, scaled to the PEs."""
        modules, kinds = list(self._modules.values()), list(self._kinds.values())
        cpu = work * sum(kind.cpu_millis for kind in kinds) / sum(module.modes[0].cpu for module in modules)
        heavy = [self.rng.uniform(0.5, 1.5) * module.modes[0].cpu for module in modules]
        ram, flash = (
            _MEMORY_SHARE * sum(there) / sum(heavy)
            for there in ([kind.ram for kind in kinds], [kind.flash for kind in kinds])
        )
        return {
            name: _written(module, cpu, int(ram * weight), int(flash * weight))
            for (name, module), weight in zip(self._modules.items(), heavy, strict=True)
        }


def _optional(variables: Sequence[str]) -> Fields:
    return {"or": {"k": 0, "of": list(variables)}}


def _written(module: _Module, cpu: float, ram: int, flash: int) -> Fields:
    """Write a module as a spec has it; a cheaper mode takes less memory as well."""
    best = module.modes[0].cpu
    modes = {
        f"mode{number}": {
            **({} if mode.needs is None else {"needs": mode.needs}),
            "gives": dict(mode.gives),
            "cpu": max(1, round(cpu * mode.cpu)) / 1000,
            "ram": int(ram * mode.cpu / best),
            "rate_hz": mode.rate_hz,
        }
        for number, mode in enumerate(module.modes)
    }
    return {
        **({"device": module.device} if module.device else {}),
        **({"requires": list(module.requires)} if module.requires else {}),
        **({"runs_on": list(module.runs_on)} if module.runs_on else {}),
        "flash": flash,
        "modes": modes,
    }
