"""Runs the modules of a node in partitions; the agent's loop never waits for them.

The host executes the core's actions on modules, and answers them by events. (The simulator has another host,
which runs modules in its own process: `heronry_tools.sim.world.module_host`.) A partition has four states:

    absent    it has no process. The host starts the process when the core starts a module of the partition,
              or in advance: once the PE runs modules, the host starts one absent partition per second, so that
              starting a process delays no reconfiguration in flight
    loading   its process imports the code of all its modules in the table. Meanwhile start orders of the core
              wait, and are sent when the code has been imported. Steps that the core orders meanwhile are
              answered with `NotReady`, so that the core orders them again with present inputs
    running   its process executes orders, one after the other
    ending    its process is killed and not reaped yet; a new process for the same partition may start
              meanwhile

The host ends a partition that sends an answer without an order, a packet that cannot be read, or a packet that is too
long. The host reports to the core that a partition has ended, and why; the core decides which module counts as failed.

The core decides that a step hangs, with one exception. If a module is stopped during its step, the core no
longer waits for this step, although the step delays all later orders. So the host itself ends the partition
when such a step has spent the time after which a module counts as hanging.
"""

import time
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress

from heronry_agent.core.step_times import HUNG_NS, NS_MHZ, hung_ns
from heronry_agent.core.vocabulary import (
    Action,
    AtRest,
    Drive,
    EndPartition,
    Heard,
    ImagesMissing,
    MeasureStep,
    ModuleEvent,
    NotReady,
    PartitionEnded,
    SaveState,
    StartFailed,
    StartModule,
    StateEvent,
    StepFailed,
    StepMeasured,
    StepModule,
    Stepped,
    StopModule,
)
from heronry_agent.shell.devices import Devices
from heronry_agent.shell.partition_groups import PartitionGroups
from heronry_agent.shell.partition_log import PartitionLog
from heronry_agent.shell.partition_messages import (
    Answer,
    Done,
    Failed,
    Garbled,
    Load,
    Loaded,
    Save,
    Start,
    StartRefused,
    Step,
    Stop,
    decode_answer,
)
from heronry_agent.shell.partition_process import PartitionProcess, used_ns
from heronry_agent.shell.partition_states import kept_of
from heronry_agent.shell.start_orders import orders_of
from heronry_wire.pe_table import ModuleEntry, PeTable
from heronry_wire.sansio import NEVER_NS

WARM_UP_NS = 1_000_000_000
LOADING_NS = 20_000_000_000
_SOON_NS = 2_000_000


class PartitionHost:
    """Runs the partitions of one PE, and carries out the core's orders to modules and to devices."""

    def __init__(self, table: PeTable, devices: Devices, groups: PartitionGroups | None = None) -> None:
        """Begin without partitions.

        devices: the devices of the table's modules.
        groups: control groups for the partitions; None: none are used.
        """
        self._devices = devices
        self._groups = groups
        self._entries = {module.index: module for module in table.modules}
        self._processes: dict[str, PartitionProcess] = {}
        self._load_by_ns: dict[str, int] = {}  # time limit of each partition that loads
        self._waiting: dict[str, list[StartModule]] = {}  # starts to send when the partition has loaded
        self._held: defaultdict[str, list[StepModule]] = defaultdict(list)  # steps: NotReady answers them after loading
        self._modes: dict[int, int] = {}
        self._numbers: dict[int, dict[str, int]] = {}  # numbers of the leaves of each running module, by path
        self._ending: list[tuple[PartitionProcess, bool]] = []  # each with: whether to report its end to the core
        self._cold = sorted({module.partition for module in table.modules}, reverse=True)
        self._warm_ns = NEVER_NS

    def add(self, modules: Collection[ModuleEntry], now_ns: int) -> None:
        """Run more modules when they are started; those of new partitions load their code in advance.

        modules: with the numbers by which the actions of the core will name them.
        """
        self._entries |= {module.index: module for module in modules}
        named = {module.partition for module in modules}
        self._cold += sorted(named.difference(self._processes, self._cold), reverse=True)
        if self._cold and self._warm_ns == NEVER_NS:
            self._warm_ns = now_ns

    def keep_only(self, modules: Collection[int]) -> None:
        """End each partition that has none of these modules: its table neither flies nor is beside any more."""
        kept = {self._entries[module].partition for module in modules}
        self._entries = {module: entry for module, entry in self._entries.items() if entry.partition in kept}
        self._cold = [name for name in self._cold if name in kept]
        for name in self._processes.keys() - kept:
            self._end(name, tell=False)

    def watch(self, now_ns: int) -> tuple[list[PartitionProcess | PartitionLog], int]:
        """Return what `select` is to wait for: the partitions and the pipes to which they print.

        Also gives the time in ns at which to call `take`, if `select` reports nothing before.
        """
        watched: list[PartitionProcess | PartitionLog] = []
        due_ns = min(self._load_by_ns.values()) if self._load_by_ns else self._warm_ns
        for process in self._processes.values():
            if not process.gathers:
                watched.append(process)
            elif process.look_ns < due_ns:
                due_ns = process.look_ns
            log = process.log
            if log.is_open:
                if now_ns >= log.look_ns:
                    watched.append(log)
                elif log.look_ns < due_ns:
                    due_ns = log.look_ns
        for device in self._devices.real:
            due_ns = min(due_ns, device.next_deadline_ns())
            if device.log is not None and now_ns >= device.log.look_ns:
                watched.append(device.log)
        return watched, min(due_ns, now_ns + _SOON_NS) if self._ending or self._devices.are_moving else due_ns

    def carry_out(self, action: Action, now_ns: int) -> ModuleEvent | None:
        """Execute an action of the core on a module or a device.

        Returns the event that answers the action. None: `take` returns the event later, or the action has no answer.
        """
        match action:
            case StepModule():
                self._step(action, now_ns)
            case SaveState():
                self._save(action)
            case StartModule():
                return self._start(action, now_ns)
            case StopModule():
                self._stop(action)
                if not action.keep:
                    self._devices.make_safe(action.module, now_ns)
            case MeasureStep():
                return self._measure(action, now_ns)
            case EndPartition():
                self._end(action.partition, tell=False)
            case Drive():
                return self._devices.drive(action, now_ns)
            case Heard():
                self._devices.heard(action, now_ns)
            case _:
                pass
        return None

    @property
    def has_real_devices(self) -> bool:
        """Tell whether a device has a process of its own."""
        return bool(self._devices.real)

    def look_at_devices(self, exclusive_until_ns: int, lease_ns: int, now_ns: int) -> None:
        """Renew the validity of commands to devices (`Devices.look`); call this at the beginning of each turn."""
        self._devices.look(exclusive_until_ns, lease_ns, now_ns)

    def flush(self, now_ns: int) -> None:
        """Send the orders that `carry_out` has collected; call this at the end of each turn of the loop."""
        for process in self._processes.values():
            if process.has_orders:
                process.flush(now_ns)

    def take(self, ready: Collection[object], now_ns: int) -> list[ModuleEvent]:
        """Read the answers of the `ready` partitions, and check time limits; returns the events for the core.

        ready: what `select` has reported as readable.
        """
        events: list[ModuleEvent] = []
        for process in [*self._processes.values()]:
            if ready and process.log.is_open and process.log in ready:
                process.log.read(now_ns)
            if (now_ns >= process.look_ns) if process.gathers else (process in ready):
                process.gathers = False
                events += self._read(process, now_ns)
            if process.broken is None and process.loading and now_ns >= self._load_by_ns.get(process.name, NEVER_NS):
                self._look_at_loading(process, now_ns)
            if process.broken is not None:
                self._end(process.name, tell=True)
        for device in self._devices.real:
            if device.log is not None and device.log in ready:
                device.log.read(now_ns)
        if self._ending:
            events += self._reap()
        if self._devices.are_moving:
            events += [AtRest(module) for module in self._devices.at_rest(now_ns)]
        if now_ns >= self._warm_ns and not self._load_by_ns:
            self._warm_up(now_ns)
        return events

    def used_ns(self) -> int:
        """Return the processor time of the present processes of partitions and drivers so far, in ns."""
        drivers = [device.pid for device in self._devices.real if device.pid is not None]
        return sum(map(used_ns, (*(process.pid for process in self._processes.values()), *drivers)))

    def abandon(self) -> None:
        """End all partitions without a report to the core, and make every device safe; new partitions may follow."""
        self._ending = [(process, False) for process, _ in self._ending]
        for name in list(self._processes):
            self._end(name, tell=False)
        self._devices.make_all_safe(time.monotonic_ns())

    def close(self) -> None:
        """End all partitions, make every device safe, and wait until every process has ended."""
        self.abandon()
        self._devices.close()
        while self._ending:
            self._reap()
            time.sleep(_SOON_NS / 1e9)

    # Actions of the core

    def _start(self, action: StartModule, now_ns: int) -> StartFailed | None:
        name = action.entry.partition
        self._modes[action.module] = action.mode
        self._devices.begun(action.module)
        leaves = action.entry.modes[action.mode].leaves
        self._numbers[action.module] = {leaf.path: number for number, leaf in enumerate(leaves)}
        if name not in self._processes:
            try:
                self._spawn(name, now_ns)
            except OSError as error:
                return StartFailed(action.module, f"partition {name} cannot be started: {error.strerror}")
        if self._warm_ns == NEVER_NS and self._cold:
            self._warm_ns = now_ns + WARM_UP_NS
        if self._processes[name].loading:
            self._waiting[name].append(action)
        else:
            self._tell_start(self._processes[name], action)
        return None

    def _tell_start(self, process: PartitionProcess, action: StartModule) -> None:
        leaves = tuple((leaf.path, leaf.variable) for leaf in action.entry.modes[action.mode].leaves)
        process.refusals_due[action.module] += 1
        process.states_due[action.module] += action.kept is not None
        process.send(Start(action.module, orders_of(action), leaves, kept_of(action.kept)))

    def _save(self, action: SaveState) -> None:
        """Have a state saved; while the partition loads its code, no step was computed, and there is no new state."""
        process = self._processes.get(self._entries[action.module].partition)
        if process is not None and not process.loading:
            process.states_due[action.module] += 1
            process.send(Save(action.module, action.round, action.most_bytes))

    def _stop(self, action: StopModule) -> None:
        name = self._entries[action.module].partition
        process = self._processes.get(name)
        if process is None:
            return
        if process.loading:
            self._waiting[name] = [start for start in self._waiting[name] if start.module != action.module]
            self._held[name] = [step for step in self._held[name] if step.module != action.module]
        else:
            process.send(Stop(action.module, action.keep))
            process.disown(action.module)

    def _step(self, action: StepModule, now_ns: int) -> None:
        name = self._entries[action.module].partition
        process = self._processes.get(name)
        if process is None:
            return  # the partition has just ended; the event for the core follows
        if process.loading:
            self._held[name].append(action)
            return
        numbers = self._numbers[action.module]
        inputs = [(numbers[path], *datum) for path, (_, datum) in action.inputs.items()]
        reading = self._devices.read(action.module, now_ns)
        process.expect(action.module, action.release, now_ns)
        process.send(Step(action.module, action.release, now_ns, action.until_ns, reading, inputs))

    def _measure(self, action: MeasureStep, now_ns: int) -> StepMeasured:
        process = self._processes.get(self._entries[action.module].partition)
        if process is None:
            return StepMeasured(action.module, action.release, 0)
        unwanted = process.unwanted(now_ns)
        if unwanted is not None:
            stopped, spent_ns = unwanted
            if spent_ns >= hung_ns(self._rate_mhz(self._entries[stopped])):
                process.broken = "it hangs in a step of a module that was stopped"
        return StepMeasured(action.module, action.release, process.spent_ns(action.module, action.release, now_ns))

    # Answers of the partitions

    def _read(self, process: PartitionProcess, now_ns: int) -> Iterator[ModuleEvent]:
        while process.broken is None and (packet := process.receive()) is not None:
            yield from self._hear(process, decode_answer(packet), now_ns)
            if not process.owes:
                return

    def _hear(self, process: PartitionProcess, answer: Answer, now_ns: int) -> Iterator[ModuleEvent]:
        match answer:
            case Done(module, release, ended_ns, result):
                spent_ns = process.answered(module, release, min(ended_ns, now_ns), self._period_ns(module))
                if spent_ns is not None:
                    outputs, writes = result.outputs, result.writes
                    reports = result.reports + self._devices.reports(module, now_ns)
                    asked = result.phases, spent_ns, result.priorities, result.misspelt
                    yield Stepped(module, release, outputs, writes, reports, *asked)
                    return
            case Failed(module, release, reason, traceback):
                if process.answered(module, release, now_ns, NEVER_NS) is not None:
                    yield StepFailed(module, release, reason, traceback)
                    return
            case StartRefused(module, reason, traceback) if process.refusals_due[module] > 0:
                process.refusals_due[module] -= 1
                yield StartFailed(module, reason, traceback)
                return
            case _ if isinstance(answer, StateEvent) and process.states_due[answer.module] > 0:
                process.told_state(answer.module, now_ns)
                yield answer
                return
            case Loaded(missing) if process.loading:
                yield from self._loaded(process, missing)
                return
            case Garbled(reason):
                process.broken = reason
                return
            case _:
                pass
        process.broken = "it has sent an answer that no order called for"

    def _loaded(self, process: PartitionProcess, missing: Mapping[str, str]) -> Iterator[ModuleEvent]:
        process.loading = False
        process.limit_memory()
        del self._load_by_ns[process.name]
        if missing:
            own = {entry.image for entry in self._entries.values()}
            yield ImagesMissing({image: reason for image, reason in missing.items() if image in own})
        for action in self._waiting.pop(process.name):
            self._tell_start(process, action)
        for step in self._held.pop(process.name, ()):
            yield NotReady(step.module, step.release)

    def _period_ns(self, module: int) -> int:
        entry = self._entries.get(module)
        return NS_MHZ // self._rate_mhz(entry) if entry is not None else 0

    def _rate_mhz(self, entry: ModuleEntry) -> int:
        return entry.modes[self._modes.get(entry.index, 0)].rate_mhz

    # Processes

    def _spawn(self, name: str, now_ns: int) -> None:
        ram = sum(entry.ram for entry in self._entries.values() if entry.partition == name)
        process = self._processes[name] = PartitionProcess(name, ram, self._groups, self._code_of(name))
        process.send(Load(self._images_of(name)))
        self._load_by_ns[name], self._waiting[name] = now_ns + LOADING_NS, []
        if name in self._cold:
            self._cold.remove(name)

    def _images_of(self, name: str) -> tuple[str, ...]:
        """Return the images that a partition imports at its start."""
        return tuple(sorted({entry.image for entry in self._entries.values() if entry.partition == name}))

    def _code_of(self, _name: str) -> str | None:
        """Return the file from which a partition imports before all others; None: there is none."""
        return None

    def _warm_up(self, now_ns: int) -> None:
        self._warm_ns = now_ns + WARM_UP_NS
        if not self._cold:
            self._warm_ns = NEVER_NS
            return
        name = self._cold.pop()
        with suppress(OSError):  # the next start of one of the partition's modules tries again
            self._spawn(name, now_ns)

    def _look_at_loading(self, process: PartitionProcess, now_ns: int) -> None:
        """End a partition that has spent more than LOADING_NS on loading its code."""
        left_ns = LOADING_NS - process.loading_ns(now_ns)
        if left_ns <= 0:
            process.broken = "it does not finish loading its code"
        self._load_by_ns[process.name] = now_ns + max(left_ns, HUNG_NS)

    def _end(self, name: str, *, tell: bool) -> None:
        process = self._processes.pop(name, None)
        if process is None:
            return
        process.kill()
        self._ending.append((process, tell))
        self._load_by_ns.pop(name, None)
        self._waiting.pop(name, None)
        self._held.pop(name, None)

    def _reap(self) -> list[ModuleEvent]:
        events: list[ModuleEvent] = []
        still = []
        for process, tell in self._ending:
            words = process.reap()
            if words is None:
                still.append((process, tell))
            elif tell:
                events.append(PartitionEnded(process.name, process.broken or words, process.computing))
        self._ending = still
        return events
