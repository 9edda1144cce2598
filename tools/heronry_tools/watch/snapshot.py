"""The snapshot: everything that is known of a system at one moment, whatever its source.

`reducer` makes it from events and the spec. All views (`heronry top`, `heronry web`, metrics) show a snapshot, and the
same events give the same snapshot. `docs/watch.md` describes it to users.

A *feed* is the stream of events from which a snapshot is made. Names of times end in `_ns`: they are nanoseconds of the
feed's clock. This clock is CLOCK_MONOTONIC for a live system, the recorder's clock for a recording, and virtual time
for the simulator. The *document* is a snapshot as JSON. In it, `null` stands for a fact that the feed does not give,
unless the text about a field says something else. A feed that has only the frames of a bus gives no causes (`knows_why`
is false). Then reconfigurations have no `causes`, and `detect` and `decide` are known only if a PE fell silent.

A later program may add keys to the document. If it removes a key, or changes the meaning of a key, it also raises the
version `v`.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from heronry_wire.node_cost import NodeCost

VERSION = 1
KEPT_RECONFIGURATIONS = 100
KEPT_EVENTS = 500

Source = Literal["manager", "bus", "log", "record", "simulator"]
Standing = Literal["waiting", "up", "suspect", "down", "returning"]
Stage = Literal["starting", "planning", "preparing", "activating", "running", "stopped"]
Severity = Literal["error", "warning", "notice", "good", "detail"]
Live = Literal["served", "degraded", "lost", "idle", "dead"]


@dataclass(frozen=True, slots=True)
class Budget:
    """A capacity, and how much of it the running configuration uses."""

    used: int = 0
    of: int = 0


@dataclass(frozen=True, slots=True)
class Manager:
    """The active manager; in a feed of one manager's events, the manager that sends them, active or not."""

    node: int | None = None
    term: int | None = None
    state: str | None = None  # listening, standing by, starting, active, retired (`heronry status`)
    advises: bool = False
    key: str | None = None  # fingerprint of its key
    journal: str | None = None  # what is wrong with its journal


@dataclass(frozen=True, slots=True)
class Pe:
    """A processing element. CPU in thousandths of a reference core, RAM and flash in bytes."""

    node_id: int
    standing: Standing = "waiting"
    why: str | None = None  # why it is not available
    last_heard_ns: int | None = None
    incarnation: int | None = None  # number of its boot, as its state frames have it (modulo 256)
    reboots: int = 0  # seen since the feed began
    restarts: int = 0  # restarts of its modules that it has reported
    epoch: int | None = None  # the epoch that it reports to run
    runs: str | None = None  # UNCONFIGURED, BROKEN, PARTIAL, ACTIVE: how far it is in that epoch
    hears_manager: bool | None = None
    load_percent: int | None = None  # load of its CPU, as it measures
    cpu: Budget = Budget()
    ram: Budget = Budget()
    flash: Budget = Budget()
    modules: tuple[str, ...] = ()  # the modules that the running configuration places here
    stood_still: int = 0  # long standstills of its computer
    cost: NodeCost | None = None  # what it costs its computer, as the manager has read it


@dataclass(frozen=True, slots=True)
class Bus:
    """A bus. Loads are shares of the bit rate, from 0 to 1."""

    bit_rate: int
    most: float  # `max_load` of the spec: the largest load of data and management together
    planned: float | None = None  # planned load of the data of the running configuration
    load: float | None = None  # measured over the last second
    peak: float | None = None  # in the busiest 100 ms of the last second
    bits_per_s: Mapping[str, int] = field(default_factory=dict)  # over the last second, by kind of traffic
    frames_per_s: int | None = None
    error_state: str | None = None  # of the listening controller: active, warning, passive, bus_off
    errors: int = 0  # error frames since the feed began
    trouble: str | None = None  # what is wrong with the bus, as the manager reports it
    channels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # channel -> nodes that do not hear it
    link: str | None = None  # of a radio: usable share of its bandwidth, or gone; null: all of it


@dataclass(frozen=True, slots=True)
class Function:
    """A function: whether the plan serves it (`served`), and whether its outputs are heard (`heard`)."""

    wanted: bool
    criticality: str
    priority: int
    served: bool | None = None
    degraded: bool = False  # served, in another than its best mode
    mode: str | None = None
    value: int | None = None
    why_not: str | None = None
    shortfalls: tuple[str, ...] = ()  # what is less than the best in its output module and upstream of it
    not_since_ns: int | None = None  # since when it is wanted and not served
    heard: bool | None = None  # its outputs are heard on the manager's bus
    heard_ns: int | None = None  # its last output


@dataclass(frozen=True, slots=True)
class Wire:
    """What one input of a module is connected to."""

    producer: str
    variable: str
    version: int


@dataclass(frozen=True, slots=True)
class Module:
    """A module of the spec; `pe` is the PE on which the module runs, or null if it does not run."""

    pe: str | None = None
    mode: str | None = None
    degraded: bool = False  # runs in another than its best mode
    wires: Mapping[str, Wire] = field(default_factory=dict)  # by the path of the input in its gate expression
    failure: str | None = None  # why it failed last, as its PE gives it
    restarts: int = 0
    can_run: bool = True  # in this situation, with unlimited resources


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that counts until the operator clears it."""

    element: str
    by: str
    code: str | None = None
    detail: int | None = None
    since_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Silence:
    """An input of a running module that gets no data, or an output that it leaves out."""

    module: str
    by: str  # the PE of the module
    what: Literal["input", "output"]
    variable: str
    producer: str | None = None  # of an input, the module that should give it
    since_ns: int | None = None  # when it was reported


@dataclass(frozen=True, slots=True)
class Place:
    """Where a module runs, and in which mode."""

    pe: str
    mode: str


@dataclass(frozen=True, slots=True)
class Times:
    """How long each of the four parts of a reconfiguration took, in ns; null: the feed does not tell it."""

    detect: int | None = None
    decide: int | None = None
    distribute: int | None = None
    activate: int | None = None


@dataclass(frozen=True, slots=True)
class Outage:
    """A silence of a function's outputs on the bus."""

    function: str
    from_ns: int
    to_ns: int | None = None  # null: the silence has not ended


@dataclass(frozen=True, slots=True)
class Reconfiguration:
    """A complete reconfiguration.

    moved, started, stopped: modules.
    lost: functions that were served before, and are wanted but not served now.
    unwanted: functions that were served before, and are not wanted now because of the phase or a priority of 0.
    gained: functions that are served now, and were not served before.
    kept: functions that were served before, and are served now.
    """

    number: int  # from 1, in the order of the feed
    epoch: int
    term: int | None
    began_ns: int  # after a loss, the last frame of the PE; without a loss, when the first time of `times_ns` began
    done_ns: int
    times_ns: Times
    causes: tuple[str, ...]
    sentence: str  # what happened and why, in one sentence
    moved: tuple[str, ...] = ()
    started: tuple[str, ...] = ()
    stopped: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    unwanted: tuple[str, ...] = ()
    gained: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
    outages: tuple[Outage, ...] = ()  # silences that began during it
    before: Mapping[str, Place] = field(default_factory=dict)  # modules before and after
    after: Mapping[str, Place] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Plant:
    """Whether the control loop through a plant of the spec is closed."""

    # on_path: closed; open; unmoved: no module drives the plant's actuators; unseen: no module reads its sensors;
    # null: what runs is not known
    state: str | None = None
    why: str | None = None


@dataclass(frozen=True, slots=True)
class Script:
    """The last script of the operator (docs/operator.md)."""

    state: str = "none"  # none, asked, held, refused, ended
    why: str | None = None  # why it was refused, or has ended


@dataclass(frozen=True, slots=True)
class Transfer:
    """A table or code that a PE waits for; `percent`: how much of it has come; None: it is not on its way."""

    pe: str
    what: Literal["table", "code"]
    says: str
    percent: int | None = None


@dataclass(frozen=True, slots=True)
class Stranger:
    """A node with a node-ID of a PE that the spec does not have.

    offer: in words, what it has; images: those of the spec that are on it; adopt: the command that writes the lines of
    the spec for it. None, nothing: it offers nothing.
    """

    node: int
    says: str
    offer: str | None = None
    images: tuple[str, ...] = ()
    adopt: str | None = None


@dataclass(frozen=True, slots=True)
class Graph:
    """The state of each symbol, mode and edge of the dependency graph, by its key (`reports.render`).

    The states are:

        served      in use
        degraded    in use, but the module runs in another mode than its best one
        lost        the output of a function that is wanted and not served
        idle        an alternative that is not chosen
        dead        a module that cannot run, a gate that cannot hold, or a variable that no module can give
    """

    nodes: Mapping[str, Live] = field(default_factory=dict)
    cells: Mapping[str, Live] = field(default_factory=dict)  # modes: KEY#NUMBER, from 0
    edges: Mapping[str, Live] = field(default_factory=dict)  # `graph_marks.edge_key`


@dataclass(frozen=True, slots=True)
class Told:
    """An event as a view lists it; `number` is its number in the feed."""

    number: int
    t_ns: int
    event: str
    severity: Severity
    sentence: str


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Everything that is known of a system at one moment."""

    v: int = VERSION
    source: Source = "manager"
    knows_why: bool = True
    spec: str = ""
    spec_digest: str = ""
    t_ns: int = 0  # of the last event
    began_ns: int | None = None  # of the first event
    events: int = 0  # number of events so far
    stage: Stage = "starting"
    phase: str | None = None
    epoch: int | None = None
    next_epoch: int | None = None  # the epoch that is being prepared
    unknown_epoch: int | None = None  # an epoch that the PEs run, if its configuration is not known
    manager: Manager = Manager()
    pes: Mapping[str, Pe] = field(default_factory=dict)
    buses: Mapping[str, Bus] = field(default_factory=dict)
    functions: Mapping[str, Function] = field(default_factory=dict)
    modules: Mapping[str, Module] = field(default_factory=dict)
    plants: Mapping[str, Plant] = field(default_factory=dict)
    script: Script = Script()
    faults: tuple[Fault, ...] = ()
    silences: tuple[Silence, ...] = ()
    transfers: tuple[Transfer, ...] = ()
    strangers: tuple[Stranger, ...] = ()
    priorities: Mapping[str, int] = field(default_factory=dict)  # changed priorities, by function
    down: tuple[str, ...] = ()  # the elements that the situation lacks
    reconfigurations: tuple[Reconfiguration, ...] = ()  # the last ones, oldest first
    outages: tuple[Outage, ...] = ()  # the last ones
    graph: Graph = Graph()
    told: tuple[Told, ...] = ()  # the last events, oldest first
    lost_lines: int = 0  # events that were dropped because this reader was too slow


def document(snapshot: Snapshot) -> dict[str, Any]:
    """Return a snapshot as plain data, as `heronry top --json` prints it."""
    return asdict(snapshot)
