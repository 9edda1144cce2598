"""One run: an aircraft of simulated nodes, what is done to it, and what is seen of it.

Everything that is random (start-up times, clocks, how long a plan takes, loss) is drawn from one seed, so a spec, a
seed and the list of what is done give the same frames, bit for bit; `digest` tells.

What is done to the aircraft is known here and nowhere else: `truth` is the situation as it really is. The cores must
find it out. Whoever judges the run (`checks`) is told the truth, and sees the frames and what is driven, and no core.
"""

import hashlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from random import Random
from typing import Any

from heronry_agent.core.authenticity import Secret
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_manager.core.topology import uplink_bus
from heronry_tools.aircraft.plant import Failure, Plant
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.faults.protocol_state import ProtocolState
from heronry_tools.sim.flight.operator import Operator
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.oracles.end_state import unnoticed_ns
from heronry_tools.sim.oracles.queues import QueueCheck
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.oracles.waivers import REPORTS, Waivers
from heronry_tools.sim.world.bus import Faults, Sent, SimulatedBus, Tampering
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.diagnostic_client import Technician
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.first_copies import FirstCopies
from heronry_tools.sim.world.frame_digest import FrameDigest
from heronry_tools.sim.world.local_clock import LocalClock
from heronry_tools.sim.world.planning import Planners, prepared
from heronry_tools.sim.world.simulated_manager import SimulatedManager
from heronry_tools.sim.world.simulated_pe import SimulatedPe
from heronry_wire.authentication import Key
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER, MANAGER_NODES
from heronry_wire.pe_table import PeTable

MS = 1_000_000
PERFECT = Faults()
DEFAULT_DECIDE_NS = 30 * MS

_LOOK_NS = 100 * MS
_LATEST_START_NS = 200 * MS
_CLOCKS_APART_NS = 1_000 * MS
DEFAULT_SKEW_PPM = 100  # what a quartz is off by
_OTHER_DIGEST = "0" * 64
_OF_A_STANDBY = (
    "manager_started",
    "standing_by",
    "stepped_down",
    "hears_nobody",
    "refused",
    "second_manager",
    "stopped",
)


class Simulation:
    """One run, up to where it has been run."""

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
    ) -> None:
        """Switch everything on, each node at its own moment in the first 200 ms.

        decide_ns: the longest time a plan takes; every one is drawn between a half of it and this.
        skew_ppm: how far clocks are off, at most.
        contingencies: plans for up to so many faults are made ahead and on board; None: for none.
        key: what manager and PEs are given to prove what they say.
        standby: there are two managers, 126 and 127; each stands by while the other one reigns.
        """
        self.has_standby = standby
        self.spec, self.seed, self.faults = spec, seed, faults
        self._prepared = prepared(spec, contingencies)
        self.clock = Clock()
        self.world = Plant(0)
        self.events: list[dict[str, Any]] = []
        self.trace: list[Sent] = []
        self.key = key
        self.checks = Checks(spec, self._prepared.tables.values(), key, self._read_journal)
        if standby:
            self.checks.phases.may_forget()
        self.protocol = ProtocolState(self.clock)
        self.operator = Operator(self)
        self.excusable: set[str] = set()  # elements that may be reported although they have not failed
        self.broken_modules: dict[str, str] = {}  # how a module fails, or for what it ASKS, wherever it runs
        self.waivers = Waivers(self.checks.settling_ns)
        self.pes: dict[str, SimulatedPe] = {}
        self.managers: dict[int, SimulatedManager] = {}  # by seat: those that have not died
        self._random = Random(seed)
        self._decide_ns, self._skew_ppm, self._planners = decide_ns, skew_ppm, planners
        self._down: set[str] = set()
        self._cut: set[str] = set()
        self._stale: set[str] = set()  # PEs that were given the table of another spec
        self._incarnations = dict.fromkeys(spec.pes, 0)
        self.disks = {node: Disk(spec) for node in MANAGER_NODES}  # by seat
        self._frames = FrameDigest()
        self.wires = {
            bus.name: tuple(
                SimulatedBus(bus.name, bus.bitrate, self.clock, Random(f"{seed}/{channel}"), faults)
                for channel in (bus.name, f"{bus.name}.2")[: bus.channels]
            )
            for bus in spec.buses.values()
        }
        self.buses = {name: wires[0] for name, wires in self.wires.items()}
        self._both = {name: FirstCopies() for name, wires in self.wires.items() if len(wires) > 1}
        self._tap(keep_trace=keep_trace)
        self._switch_on()

    @property
    def manager(self) -> SimulatedManager | None:
        """The manager that reigns; where none does, the first one there is."""
        reigning = [one for one in self.managers.values() if one.core.reigns]
        first = next((self.managers[seat] for seat in sorted(self.managers, key=abs)), None)
        return max(reigning, key=lambda one: one.core.term, default=first)

    @property
    def now_ns(self) -> int:
        """Virtual time."""
        return self.clock.now_ns

    @property
    def truth(self) -> Situation:
        """The situation as it is; down is also what is cut off, was reported for a reason, or was declared failed."""
        excused = {
            element
            for element, t_ns in self.checks.reported.items()
            if element in self.excusable or self.waivers.cover(REPORTS, t_ns)
        }
        return Situation(frozenset(self._down | self._cut | self.operator.failed | excused), {}, self.phase)

    @property
    def phase(self) -> str | None:
        """Mission phase that was asked for last, by whoever may; it begins with the first one."""
        return self.checks.phases.current

    def at(self, when_ns: int, what: Callable[[], None]) -> None:
        """Let something be done at a time."""
        self.clock.at(when_ns, what)

    def at_end_of(self, frame: Sent, what: Callable[[], None]) -> None:
        """Let something be done at the end of a frame of a run that is replayed, before anybody has received it."""

        def tap(sent: Sent) -> None:
            if sent == frame:
                what()

        self.tap(frame.bus, tap)

    def tap(self, bus: str, tap: Callable[[Sent], None]) -> None:
        """Let somebody watch a bus, of a replicated one the first copies; the nodes cannot see them."""
        (self._both[bus].taps if bus in self._both else self.buses[bus].taps).append(tap)

    def tamper(self, frame: Sent, tampering: Tampering) -> None:
        """Let one frame of a run that is replayed be lost or doubled."""
        for wire in self.wires[frame.bus]:
            wire.tamper = lambda sent: tampering if sent == frame else None

    def run_until(self, end_ns: int) -> None:
        """Let time pass up to and including `end_ns`."""
        self.clock.run_until(end_ns)

    def run_for(self, duration_ns: int) -> None:
        """Let time pass."""
        self.clock.run_until(self.clock.now_ns + duration_ns)

    def digest(self) -> str:
        """Digest of every frame so far, with its time, bus and sender: 16 hexadecimal digits."""
        return self._frames.so_far()

    @property
    def data_identifiers(self) -> list[int]:
        """Identifiers of all data of the spec."""
        return sorted(source.identifier for source in next(iter(self._prepared.tables.values())).sources)

    @property
    def witness(self) -> Witness:
        """What is heard of the functions on the manager's bus."""
        return self.checks.witness

    def broken(self) -> list[Violation]:
        """Give what must never have been, so far."""
        wires = self.every_wire().values()
        return self.checks.broken(self.truth, [clash for wire in wires for clash in wire.clashes])

    def every_wire(self) -> dict[str, SimulatedBus]:
        """Every wire by the name of its bus, or of its channel where the bus is replicated."""
        return {
            name if len(wires) == 1 else f"{name}.{number}": wire
            for name, wires in self.wires.items()
            for number, wire in enumerate(wires, start=1)
        }

    def unsettled(self) -> list[Violation]:
        """Give what must not be once the aircraft has been left alone for a while."""
        return self.checks.unsettled(self.truth, self.now_ns)

    def settle(self) -> list[Violation]:
        """Leave the aircraft alone until all is well and stays so, or for the bound on that; gives every violation.

        It stays well when it is for longer than a silent PE or function goes unnoticed. What it sends is counted in the
        second half of that: before, a controller may still send what it has kept, and who returns what it ran.
        """
        end_ns, well_since_ns = self.now_ns + self.checks.liveness_bound_ns(), None
        stays_well_ns = unnoticed_ns(self.spec)
        wires = self.every_wire()
        queues, epoch = QueueCheck(self.now_ns, wires), self.checks.epoch
        while True:
            self.run_for(_LOOK_NS)
            unwell = self.unsettled() + queues.look(self.now_ns, wires)
            epoch_before, epoch = epoch, self.checks.epoch
            if epoch != epoch_before:
                unwell.append(Violation(self.now_ns, "active", f"epoch {epoch} has just been activated"))
            if unwell and self.now_ns >= end_ns:
                return self.broken() + unwell
            if unwell:
                well_since_ns = None
            elif well_since_ns is None:
                well_since_ns = self.now_ns
            elif self.now_ns - well_since_ns > stays_well_ns:
                return self.broken() + self.checks.unplanned(self.now_ns, self.truth)
            elif 0 <= self.now_ns - well_since_ns - stays_well_ns // 2 < _LOOK_NS:
                self.checks.is_well(self.now_ns)

    def events_of(self, kind: str) -> list[dict[str, Any]]:
        """Events of the managers, of one kind."""
        return [event for event in self.events if event["event"] == kind]

    # What is done to the aircraft

    def kill(self, pe: str) -> None:
        """Let a PE die now; one that is dead stays so."""
        dead = self.pes.pop(pe, None)
        if dead is not None:
            dead.stop()
            self._down.add(f"pe:{pe}")
            self._cut.discard(f"pe:{pe}")

    def restore(self, pe: str) -> None:
        """Start a PE that is not running: a new incarnation, on a clock of its own."""
        if pe in self.pes:
            return
        self._incarnations[pe] += 1
        if pe not in self._stale:
            self._down.discard(f"pe:{pe}")
        self._cut.discard(f"pe:{pe}")
        self.pes[pe] = SimulatedPe(
            self.clock,
            self._drawn_clock(self._random.randrange(_CLOCKS_APART_NS)),
            self._table(pe),
            self.wires,
            incarnation=self._incarnations[pe] % 256,
            secret=self._secret(pe),
            world=self.world,
            drive=self.checks.driven,
            look=self.checks.looked,
            move=self.checks.moved,
            broken=self.broken_modules,
            broke=lambda module: self.failed(f"module:{module}"),
            witness=self.checks.channels.copy,
        )

    def make_stale(self, pe: str) -> None:
        """Let a PE start with another spec's table from now on: it counts as down, since it can run nothing of ours."""
        self._stale.add(pe)
        self._down.add(f"pe:{pe}")

    def make_fresh(self, pe: str) -> None:
        """Let it start with the right one again."""
        self._stale.discard(pe)

    def _table(self, pe: str) -> PeTable:
        table = self._prepared.tables[pe]
        return replace(table, spec_digest=_OTHER_DIGEST) if pe in self._stale else table

    def cut(self, pe: str) -> None:
        """Break the wires of a PE that lives on; of one that is dead nothing is left to cut off."""
        if pe in self.pes:
            self.pes[pe].wire(cut_off=True)
            self._cut.add(f"pe:{pe}")

    def mend(self, pe: str) -> None:
        """Mend them."""
        if pe in self.pes:
            self.pes[pe].wire(cut_off=False)
        self._cut.discard(f"pe:{pe}")

    def deafen(self, pe: str, duration_ns: int) -> None:
        """Let a PE that lives hear nothing for a while, and be heard all the same."""
        deaf = self.pes[pe]
        deaf.wire(deaf=True)
        self.at(self.now_ns + duration_ns, lambda: deaf.wire(deaf=False))

    def inspect(self, pe: str) -> Technician:
        """Let somebody inspect a PE with tools for CANopen and CANaerospace, on the bus on which it is commanded."""
        table = self._prepared.tables[pe]
        return Technician(
            self.clock,
            self.buses[uplink_bus(self.spec, pe)],
            table,
            lambda: self.checks.planned(pe),
            lambda story: self.checks.wrong(self.now_ns, story),
        )

    def break_channel(self, channel: str) -> None:
        """Break a channel of a replicated bus for everybody (`can0.1`)."""
        bus, _, number = channel.rpartition(".")
        self.wires[bus][int(number) - 1].break_wire()
        self._down.add(f"channel:{channel}")

    def mend_channel(self, channel: str) -> None:
        """Mend it, if nothing else has broken it meanwhile."""
        bus, _, number = channel.rpartition(".")
        wire = self.wires[bus][int(number) - 1]
        wire.mend_wire()
        if not wire.broken:
            self._down.discard(f"channel:{channel}")

    def fail_device(self, device: str, how: Failure, offset: float = 0.0) -> None:
        """Let a device fail; whether anybody notices is for the monitors."""
        self.world.fail(device, how, self.clock.now_ns, offset)
        self.failed(f"device:{device}")

    def failed(self, element: str) -> None:
        """Take note that an element has failed for good."""
        self._down.add(element)

    def cleared(self, element: str) -> None:
        """Take note that an element has been taken for well; a module begins anew, and may fail again."""
        self.checks.cleared(self.now_ns, element, self.truth, everywhere=not self.has_standby)
        if element.startswith("module:"):
            self._down.discard(element)

    def excuse(self, module: str) -> None:
        """Let a module be reported, and its device: a servo that nobody drives any more looks like one that is stuck.

        Where no branch of a DEMUX is left, its surface stands still, and so do the sensors beside it.
        """
        spec, excusable = self.spec, self.excusable
        devices = {spec.modules[module].device}
        excusable.add(f"module:{module}")
        for function in spec.functions.values():
            branches = function.outputs
            if module in branches and len(branches) > 1 and all(f"module:{branch}" in excusable for branch in branches):
                places = {spec.devices[device].pe for branch in branches if (device := spec.modules[branch].device)}
                devices |= {one.name for one in spec.devices.values() if one.kind == "sensor" and one.pe in places}
        excusable |= {f"device:{device}" for device in devices if device is not None}

    def start_manager(self, seat: int = FIRST_MANAGER, *, advise: bool = False, standby: bool | None = None) -> None:
        """Start a manager, with its journal; one that only advises, where that is asked for.

        seat: its node, or -node for one that is started on another computer as if that were its own number.
        standby: whether it stands by where another one reigns; by default where there are two.
        """
        self.managers[seat] = SimulatedManager(
            self.clock,
            self._drawn_clock(0),
            self.spec,
            self.wires[self.spec.manager.bus],
            node=abs(seat),
            disk=self.disks[seat],
            name=_station(seat),
            advise=advise,
            key=self.key,
            standby=self.has_standby if standby is None else standby,
            planners=self._planners,
            ahead=self._prepared,
            decide_ns=lambda: self._random.randint(self._decide_ns // 2, self._decide_ns),
            tell=lambda told: self._tell(seat, told),
            witness=self.checks.channels.copy,
        )

    def double_manager(self, node: int, *, standby: bool) -> None:
        """Start a manager that runs once more, somewhere else, with a copy of its journal."""
        self.disks[-node] = Disk(self.spec, self.disks[node].data)
        self.checks.manager_copied(_station(node), _station(-node))
        self.start_manager(-node, standby=standby)

    def see_who_reigns(self) -> None:
        """Tell the protocol's state whether some manager can be heard that reigns."""
        reigning = (m for m in self.managers.values() if m.core.reigns and m.is_awake and m.stations[0][1].can_send)
        self.protocol.reigned(by_somebody=any(reigning))

    def _secret(self, pe: str) -> Secret | None:
        salt = f"{self.seed} {pe} {self._incarnations[pe]}".encode()
        return None if self.key is None else Secret(self.key, hashlib.sha256(salt).digest()[:16])

    def _drawn_clock(self, ahead_ns: int) -> LocalClock:
        return LocalClock(self.clock, ahead_ns, self._random.randint(-self._skew_ppm, self._skew_ppm))

    def _tell(self, seat: int, event: dict[str, Any]) -> None:
        """Take an event of a manager; of one that stands by, only what concerns itself."""
        reigns = self.manager
        self.see_who_reigns()
        if reigns is not None and reigns.core.reigns and reigns is not self.managers.get(seat):
            if event["event"] not in _OF_A_STANDBY:
                return
            self.events.append(event)
            return
        self.events.append(event)
        self.protocol.take(event)

    def kill_manager(self, seat: int | None = None, *, torn: Random | None = None) -> None:
        """Let a manager die now: this one, or the one that reigns. `torn`: of power, which tears its journal so."""
        victim = self.manager if seat is None else self.managers.get(seat)
        for number, one in list(self.managers.items()):
            if one is victim:
                one.stop()
                del self.managers[number]
                if torn is not None:
                    one.disk.torn(torn, self.now_ns)
                    self.checks.phases.may_forget()
                self.checks.manager_died(self.now_ns, _station(number))
        self.see_who_reigns()

    def _read_journal(self, station: str) -> bytes | None:
        """What is on a manager's disk; nothing where the disk takes nothing."""
        disk = next(disk for seat, disk in self.disks.items() if _station(seat) == station)
        return None if disk.refuses or disk.problem is not None else disk.data

    # How it is put together

    def _switch_on(self) -> None:
        self.at(self._random.randrange(_LATEST_START_NS), self.start_manager)
        if self.has_standby:
            self.at(self._random.randrange(_LATEST_START_NS), lambda: self.start_manager(LAST_MANAGER))
        for pe in self.spec.pes:
            self._down.add(f"pe:{pe}")
            self.at(self._random.randrange(_LATEST_START_NS), lambda pe=pe: self.restore(pe))  # type: ignore[misc]

    def _tap(self, *, keep_trace: bool) -> None:
        for name, wires in self.wires.items():
            for channel, wire in enumerate(wires):
                wire.taps.append(self._frames.see)
                if name in self._both:
                    wire.taps.append(partial(self.checks.channels.sent, channel))
                    wire.taps.append(self._both[name].see)
            self.tap(name, self.checks.see)
            if keep_trace:
                self.tap(name, self.trace.append)
            if self.checks.authenticity is not None:
                self.tap(name, self.checks.authenticity.see)


def _station(seat: int) -> str:
    return f"manager {seat}" if seat > 0 else f"manager {-seat} again"
