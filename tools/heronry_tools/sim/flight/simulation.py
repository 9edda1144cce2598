"""One simulated flight: an aircraft of simulated nodes, the faults injected into it, and the oracles that observe it.

All random values (start-up times, clocks, durations of planning, lost frames) are drawn from one seed. So the same
spec, seed and faults always give the same frames, bit for bit; `digest` is a digest of all frames.

The parts are `wiring` (the buses), `fleet` (the PEs), `managers`, `world` (the devices), `operator` and `reloads`. Only
`truth` holds the real situation, which the cores must find out. The oracles (`checks`) get the truth, the frames and
the driven outputs, but no state of a core.
"""

from collections.abc import Callable, Collection
from functools import partial
from random import Random
from typing import TypeVar

from heronry_dg.model import Foreign, Spec
from heronry_manager.core.settings import CodeBundle
from heronry_manager.core.topology import uplink_bus
from heronry_manager.events import Event
from heronry_tools.aircraft.plant import Failure, Plant, PlantOfDevices
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.flight.fleet import Fleet
from heronry_tools.sim.flight.managers import Managers, journal
from heronry_tools.sim.flight.operator import Operator
from heronry_tools.sim.flight.reloads import Reloads
from heronry_tools.sim.flight.truth import Truth
from heronry_tools.sim.flight.wiring import Wiring
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.oracles.end_state import unnoticed_ns
from heronry_tools.sim.oracles.flown_spec import FlownSpec
from heronry_tools.sim.oracles.queues import QueueCheck
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.oracles.waivers import Waivers
from heronry_tools.sim.world.bus import Faults, Sent
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.frame_digest import FrameDigest
from heronry_tools.sim.world.inspection.diagnostic_client import DiagnosticClient
from heronry_tools.sim.world.local_clock import LocalClocks
from heronry_tools.sim.world.next_spec import NextSpec
from heronry_tools.sim.world.planning import Planners, Prepared, prepared
from heronry_tools.sim.world.stranger import Stranger
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import LAST_MANAGER, MANAGER_NODES

MS = 1_000_000
PERFECT = Faults()
DEFAULT_DECIDE_NS = 30 * MS
DEFAULT_SKEW_PPM = 100  # largest error of a clock

_LOOK_NS = 100 * MS
_LATEST_START_NS = 200 * MS
_LONGEST_WAIT_NS = 70_000 * MS  # for a table that was refused several times: the longest pause, and a transfer; and
# for the tables of another spec


_E = TypeVar("_E", bound=Event)


class Simulation:
    """One flight, simulated up to the virtual time `now_ns`."""

    def __init__(
        self,
        spec: Spec,
        seed: int = 0,
        *,
        faults: Faults = PERFECT,
        decide_ns: int = DEFAULT_DECIDE_NS,
        skew_ppm: int = DEFAULT_SKEW_PPM,
        planners: Planners = Planners.BEST,
        standby: bool = False,
        keep_trace: bool = False,
        contingencies: int | None = None,
        key: Key | None = None,
        absent: Collection[str] = (),
        aloft_ns: int = 0,
        plant: PlantOfDevices | None = None,
        observed: bool = True,
        brings_tables: bool = False,
        bundles: tuple[CodeBundle, ...] = (),
        following: NextSpec | None = None,
    ) -> None:
        """Switch on all nodes that are not `absent`, each at a random moment in the first 200 ms.

        faults: quality of every bus for the whole flight
        decide_ns: longest duration of a planning run, in ns; each run takes between 50 and 100 % of this time
        skew_ppm: largest error of a clock, in ppm
        contingencies: largest number of faults in a fault set for which a contingency is on board; None: no
            contingencies are made
        key: the key of managers and PEs; None without authentication
        standby: whether there are two managers, 126 and 127; while one is active, the other is the standby manager
        keep_trace: whether `trace` gets every frame
        absent: PEs that are not switched on here, but later by `Fleet.arrive`
        aloft_ns: time of the scripted flight at which the simulation starts, in ns
        plant: what the devices read and move; None: the scripted flight
        observed: whether the oracles observe the flight; if not, the results of `broken`, `unsettled` and `settle` have
            no meaning
        brings_tables: whether a manager brings a node without a table its table; fault `blank` needs it
        bundles: code that the managers bring to PEs that lack it; with it every PE has a loader
        following: the spec to which the aircraft may change in flight (`reloads`); then the managers bring tables, too.
            None: it does not change
        """
        self.spec, self.seed, self.key = spec, seed, key
        ahead: Prepared = prepared(spec, contingencies)
        chance = Random(seed)
        self.clock = Clock()
        self.world: PlantOfDevices = Plant(-aloft_ns) if plant is None else plant
        disks = {node: Disk(spec) for node in MANAGER_NODES}
        contents = [one.content for one in bundles]
        brings_tables |= following is not None
        self.checks = Checks(
            spec,
            ahead.tables.values(),
            key,
            partial(journal, disks),
            brings_tables=brings_tables,
            bundles=contents,
            other=None if following is None else FlownSpec(following.spec, following.ahead.tables),
        )
        if standby:
            self.checks.may_forget_phase()
        self.waivers = Waivers(self.checks.settling_ns)
        self.truth = Truth(self.checks, self.waivers)
        self.wiring = Wiring(spec, self.clock, seed, faults)
        clocks = LocalClocks(self.clock, chance, skew_ppm)
        self.managers = Managers(
            spec,
            self.clock,
            clocks,
            self.wiring,
            disks=disks,
            checks=self.checks,
            are_two=standby,
            key=key,
            prepared=ahead,
            planners=planners,
            decide_ns=lambda: chance.randint(decide_ns // 2, decide_ns),
            brings_tables=brings_tables,
            bundles=bundles,
        )
        self.fleet = Fleet(
            self.clock,
            clocks,
            self.wiring,
            self.world,
            tables=ahead.tables,
            checks=self.checks,
            truth=self.truth,
            seed=seed,
            key=key,
            absent=absent,
            has_loaders=bool(bundles),
            may_change=following is not None,
        )
        self.managers.code_brought = self.fleet.code_brought
        self.operator = Operator(self.clock, self.managers, self.checks, self.truth)
        self.reloads = None if following is None else Reloads(self.clock, self.managers, self.checks, following)
        self.trace: list[Sent] = []
        self._frames = FrameDigest()
        self._tap(keep_trace=keep_trace, observed=observed)
        self._switch_on(chance)

    @property
    def now_ns(self) -> int:
        """Return the virtual time in ns since the start of the simulation."""
        return self.clock.now_ns

    @property
    def witness(self) -> Witness:
        """Return the record of the functions whose outputs were heard on the manager's bus."""
        return self.checks.witness

    @property
    def events(self) -> list[Event]:
        """Return the events of the managers; of a standby manager only those about itself."""
        return self.managers.events

    def events_of(self, kind: type[_E]) -> list[_E]:
        """Return the events of one kind from all managers; of a standby manager only events about itself."""
        return self.managers.events_of(kind)

    def at(self, when_ns: int, what: Callable[[], None]) -> None:
        """Call `what` at the virtual time `when_ns`."""
        self.clock.at(when_ns, what)

    def run_until(self, end_ns: int) -> None:
        """Simulate up to and including `end_ns`."""
        self.clock.run_until(end_ns)

    def run_for(self, duration_ns: int) -> None:
        """Simulate for `duration_ns`."""
        self.clock.run_until(self.clock.now_ns + duration_ns)

    def digest(self) -> str:
        """Return the digest of every frame so far with its time, bus and sender: 16 hexadecimal digits."""
        return self._frames.so_far()

    # Faults of devices and channels; those of PEs and managers are in `fleet` and `managers`

    def fail_device(self, device: str, how: Failure, offset: float = 0.0) -> None:
        """Make a device fail as `how` says; modules may or may not detect the failure.

        offset: the error of a device with a bias, in the unit of the device
        """
        self.world.fail(device, how, self.clock.now_ns, offset)
        self.truth.failed(f"device:{device}")

    def break_channel(self, channel: str) -> None:
        """Break a channel of a replicated bus, for example `can0.1`, for all nodes."""
        self.wiring.channel(channel).break_wire()
        self.truth.failed(f"channel:{channel}")

    def mend_channel(self, channel: str) -> None:
        """Undo one break of a channel; the channel stays broken as long as another fault breaks it."""
        wire = self.wiring.channel(channel)
        wire.mend_wire()
        if not wire.broken:
            self.truth.is_back(f"channel:{channel}")

    def inspect(self, pe: str) -> DiagnosticClient:
        """Let a diagnostic client inspect a PE on the PE's uplink, by CANopen and CANaerospace."""
        return DiagnosticClient(
            self.clock,
            self.wiring.buses[uplink_bus(self.spec, pe)],
            self.fleet.tables[pe],
            lambda: self.checks.planned(pe),
            lambda story: self.checks.wrong(self.now_ns, story),
        )

    # What the oracles have found

    def broken(self) -> list[Violation]:
        """Return the violations so far of the rules that must hold during the whole flight."""
        return self.checks.broken(self.truth.situation, self.wiring.clashes())

    def unsettled(self) -> list[Violation]:
        """Return the rules for the end of a flight (`oracles.end_state`) that are violated now."""
        waiting = [Violation(self.now_ns, "table", f"{pe} waits for its table") for pe in self.fleet.blanks]
        waiting += [Violation(self.now_ns, "code", f"{pe} waits for code") for pe in self.fleet.waits_for_code()]
        if self.reloads is not None and self.reloads.is_under_way:
            waiting.append(Violation(self.now_ns, "reload", "the change to the other spec is still under way"))
        return self.checks.unsettled(self.truth.situation, self.now_ns) + waiting

    def settle(self) -> list[Violation]:
        """Simulate without further faults until the aircraft has converged, and return every violation.

        The aircraft has converged when all of this was true during the whole of a *quiet time*:

        - no rule for the end of a flight (`unsettled`) was violated
        - no epoch was activated
        - no queue has grown

        The quiet time is the longest time for which a silent PE or function may stay undetected. If the aircraft does
        not converge in the time allowed, the simulation ends; then the result also has the violations of the last
        moment.

        The oracle `planned_load` counts data only in the second half of the quiet time. In the first half a controller
        may still send queued frames, and a PE that returns may still send data of the modules that it ran before.
        """
        end_ns, well_since_ns = self.now_ns + self.checks.liveness_bound_ns(), None
        is_changing = self.reloads is not None and self.reloads.is_under_way
        if self.fleet.blanks or self.fleet.waits_for_code() or is_changing:
            end_ns += _LONGEST_WAIT_NS
        stays_well_ns = unnoticed_ns(self.checks.spec)
        wires = self.wiring.every_wire()
        queues, epoch = QueueCheck(self.now_ns, wires), self.checks.epoch
        while True:
            self.run_for(_LOOK_NS)
            unwell = self.unsettled() + queues.look(self.now_ns, wires)
            epoch_before, epoch = epoch, self.checks.epoch
            if epoch != epoch_before:
                unwell.append(
                    Violation(
                        self.now_ns, "active", f"epoch {epoch} was activated after the aircraft should have converged"
                    )
                )
            if unwell and self.now_ns >= end_ns:
                return self.broken() + unwell
            if unwell:
                well_since_ns = None
            elif well_since_ns is None:
                well_since_ns = self.now_ns
            elif self.now_ns - well_since_ns > stays_well_ns:
                return self.broken() + self.checks.unplanned(self.now_ns, self.truth.situation)
            elif 0 <= self.now_ns - well_since_ns - stays_well_ns // 2 < _LOOK_NS:
                self.checks.is_well(self.now_ns)

    # How the run is put together

    def _switch_on(self, chance: Random) -> None:
        self.at(chance.randrange(_LATEST_START_NS), self.managers.start)
        if self.managers.are_two:
            self.at(chance.randrange(_LATEST_START_NS), lambda: self.managers.start(LAST_MANAGER))
        for pe in self.spec.pes:
            self.at(chance.randrange(_LATEST_START_NS), lambda pe=pe: self.fleet.restore(pe))  # type: ignore[misc]
        for bus in self.spec.buses.values():
            for foreign in bus.foreign:
                self.at(chance.randrange(foreign.period_ns), partial(self._send_foreign, bus.name, foreign))

    def _send_foreign(self, bus: str, foreign: Foreign) -> None:
        """Let other equipment send its frames from now on, each with the first identifier of its range."""
        frame = Frame(foreign.first, bytes(foreign.data_bytes), foreign.extended)
        for wire in self.wiring.wires[bus]:
            Stranger(self.clock, wire, frame, foreign.period_ns)

    def _tap(self, *, keep_trace: bool, observed: bool) -> None:
        self.wiring.watch(self._frames.see, self.checks.carried)
        if not observed:
            self.checks.rest()
        for bus in self.wiring.buses:
            if observed:
                self.wiring.tap(bus, self.checks.see)
            if keep_trace:
                self.wiring.tap(bus, self.trace.append)
