"""Runs the modules of one PE: has their steps computed on schedule, and sends their data and fault reports.

A module exists from the action StartModule to the action StopModule. Meanwhile the schedule decides when it is stepped.
The outputs of a step go to the mailboxes of this PE and, where the slice says so, to the buses. A command to the
module's device is executed and echoed, if it is authorized. Its reports and requests go to the manager
(`module_reports`).

A module *fails* when it

- raises an exception, hangs, or was computing when its partition ended;
- gives a value that no frame can carry, or gives its device a command that the device cannot execute.

A module that gives nothing has not failed here: `silence_watch` reports it.

The failure is reported, and the module is restarted as often as the table allows (`restarts`), then stopped: the
manager has the report, and decides where the module runs. A module that cannot be built, or that takes too long in many
steps in a row, is stopped immediately. A module whose code is not on this PE is reported when the PE boots up (or when
the import fails), and again to every new active manager. A partition in which a module hangs is ended by force. Its
other modules are restarted immediately, and other partitions are not affected.

The output authorization (protocol rule 6) is checked at the last moment, in three places:

- Before a step of a DEMUX branch. Without authorization it is not stepped, since it may command its device itself.
- After such a step. If the authorization has ended since the step began, the commands in the answer are not executed.
- Before a data frame of a module that may run elsewhere. Without authorization the frame is not sent; but the module
  is stepped, and its outputs reach modules on this PE.

If a module has been stopped since its step began, its answer is dropped.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from heronry_agent.core.authority import OutputAuthorization
from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.checkpoints import Checkpoints
from heronry_agent.core.configuration import ActiveConfiguration, Moves
from heronry_agent.core.modules.chains import chains
from heronry_agent.core.modules.echo_pace import EchoPace
from heronry_agent.core.modules.failure_texts import FailureTexts, with_names
from heronry_agent.core.modules.mailboxes import Mailboxes
from heronry_agent.core.modules.module_reports import ModuleReports
from heronry_agent.core.modules.publishing import Publisher
from heronry_agent.core.modules.rests import Rests
from heronry_agent.core.modules.schedule import Schedule
from heronry_agent.core.modules.silence_watch import SilenceWatch
from heronry_agent.core.reports import Faults, SilenceReports
from heronry_agent.core.restarts import Restarts
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import (
    Drive,
    DriveFailed,
    Driven,
    EndPartition,
    Failure,
    MeasureStep,
    NotReady,
    PartitionEnded,
    StartFailed,
    StartModule,
    StepFailed,
    StepMeasured,
    StepModule,
    Stepped,
    StopModule,
)
from heronry_agent.module import Value
from heronry_wire.configuration_slice import Slice
from heronry_wire.element_places import kind_and_place
from heronry_wire.failure_text import plain_reason
from heronry_wire.frame import Frame, WireError
from heronry_wire.management import EVERYWHERE, ElementKind, FaultCode
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.sansio import Send, require


@dataclass(frozen=True, slots=True)
class _Running:
    entry: ModuleEntry
    mode: int
    gives: dict[str, tuple[int, int]]  # variable -> source, version


class RunningModules:
    """Starts, steps and stops the modules of one PE."""

    def __init__(
        self,
        turn: Turn,
        index: TableIndex,
        active_configuration: ActiveConfiguration,
        output_authorization: OutputAuthorization,
    ) -> None:
        self._turn = turn
        self._index = index
        self._active_configuration = active_configuration
        self._output_authorization = output_authorization
        self._running: dict[int, _Running] = {}
        self._publish: dict[int, tuple[int, ...]] = {}  # ports of each source
        self.publisher = Publisher(index)
        self.echoes = EchoPace(index.table)
        self.mailboxes = Mailboxes(index)
        self.schedule = Schedule()
        self.restarts = Restarts()
        self.rests = Rests(turn, index)
        self.failures = FailureTexts()
        period_ns = index.table.ports[index.uplink].heartbeat_ns
        self.faults = Faults(index.node, period_ns, index.critical)
        silences = SilenceReports(self.faults, period_ns)
        self.silences = SilenceWatch(index, self.mailboxes, output_authorization, silences, period_ns)
        self._reports = ModuleReports(turn, index, self.faults, output_authorization)
        self.checkpoints = Checkpoints(turn, index, output_authorization, self.faults)
        self.has_exclusive_output = False
        self.load_percent = 0
        self._lacking: set[int] = set()  # modules whose code is not on this PE

    def carry_out(self, moves: Moves, wanted: Slice | None) -> None:
        """Stop and start modules as `moves` says; `wanted` is the new slice, None if the slice stays the same."""
        for module in moves.stop:
            self._stop(module, keep=module in moves.keep)
        for module in moves.drop:
            self.rests.stopped(module)
            self._turn.do(StopModule(module))
        if wanted is not None:
            self._wire(wanted, rewire=moves.rewire)
        for module, mode in moves.start:
            self._start(module, mode)
        self.take_stock()

    def carry_over(self, carried: CarriedOver) -> None:
        """Take the indices of another table, whose contents `index` has now; only modules that go on run."""
        modes = {module: one.mode for module, one in carried.by_module(self._running).items()}
        self._running = {module: self._entered(module, mode) for module, mode in modes.items()}
        self._lacking = {carried.named_modules[m] for m in self._lacking if m in carried.named_modules}
        self.schedule.renumber(carried.modules)
        self.restarts.renumber(carried.modules)
        self.faults.renumber(carried.element, self._index.critical)
        self.echoes.carry_over(self._index.table, carried)
        self.mailboxes.carry_over(carried)
        self.rests.carry_over(carried)
        self.failures.carry_over(carried)
        self._reports.carry_over(carried, modes)
        self.silences.carry_over()
        self.checkpoints.carry_over(carried)

    def _wire(self, wanted: Slice, *, rewire: bool) -> None:
        if rewire:
            self.mailboxes.rewire(wanted)
            self.schedule.chain(chains(self._index, wanted))
            self.silences.rewire(wanted, self._turn.now_ns)
        self._publish = {
            source: tuple(port for port in self._index.ports if mask >> port & 1)
            for source, mask in wanted.publish.items()
        }

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`, if no event comes before."""
        return min(self.schedule.next_ns, self.restarts.next_ns, self.rests.next_ns)

    def tick(self) -> None:
        """Restart the modules whose restart is due, and request a measurement of each step that takes too long."""
        for module in self.restarts.due(self._turn.now_ns):
            self._begin(module)
        self._turn.do(*(MeasureStep(*step) for step in self.schedule.overdue(self._turn.now_ns)))
        self.rests.tick()

    def release(self) -> None:
        """Begin the step of every module that is due."""
        now_ns = self._turn.now_ns
        for module in self.schedule.due(now_ns):
            until_ns = now_ns + self._index.lease_ns
            if self._running[module].entry.demux:
                until_ns = self._output_authorization.until_ns(now_ns)
                if now_ns > until_ns or self.rests.hold_back(module):
                    self._turn.count("step held", module)
                    self._reports.held()
                    self.silences.held(module, now_ns)
                    continue
            inputs = self.mailboxes.inputs(module, now_ns)
            self._turn.do(StepModule(module, self.schedule.begin(module, now_ns), inputs, until_ns))
            self.checkpoints.ask(module)

    def stepped(self, event: Stepped) -> None:
        """Process the answer to a step: outputs, commands to the device, reports and requests."""
        if not self.schedule.end(event.module, event.release, event.spent_ns):
            self._turn.count("stale answer", event.module)
            return
        running = self._running[event.module]
        self._drive(running, event.writes)
        if running.entry.silent_output and self.echoes.is_due(event.module, self._turn.now_ns):
            self._turn.do(Send(self._index.uplink, self.publisher.output_echo(event.module, running.mode)))
        self._reports.take(running.entry, running.mode, event, has_exclusive_output=self.has_exclusive_output)
        missing = [variable for variable in running.gives if variable not in event.outputs]
        if missing or event.module in self.silences.withholding:
            self.silences.left_out(running.entry, running.mode, missing, self._turn.now_ns)
        if missing or event.misspelt_inputs:
            self._reports.notices.look_for_misspelt(running.entry, event, missing)
        try:
            for variable, value in event.outputs.items():
                self._give(running, variable, value)
        except WireError as error:
            self._failed(event.module, Failure(str(error)))
        else:
            if self.schedule.overruns_now(event.module):
                self.checkpoints.failed(event.module, again=True)
                self._give_up(event.module, Failure("it takes longer than its period"), FaultCode.MODULE_OVERRUN)

    def driven(self, event: Driven) -> None:
        """Send the output echo of a device that has executed a command, if it is due."""
        running = self._running.get(event.module)
        if running is None or not self.echoes.is_due(event.module, self._turn.now_ns):
            return
        echo = self.publisher.echo(running.entry.device or "", event.value)
        self._turn.do(Send(self._index.uplink, echo or self.publisher.output_echo(event.module, running.mode)))

    def went_wrong(self, event: StepFailed | StartFailed | DriveFailed | PartitionEnded) -> None:
        """Restart or give up each module that has failed; if its module was stopped, a failed step is only counted."""
        match event:
            case StepFailed(module, release, reason, traceback):
                if self.schedule.end(module, release, 0):
                    self._failed(module, Failure(reason, traceback))
                else:
                    self._turn.count("stale answer", module)
            case StartFailed(module, reason, traceback):
                self._give_up(module, Failure(reason, traceback))
            case DriveFailed(module, reason):
                self._failed(module, Failure(reason))
            case PartitionEnded(partition, reason, computing):  # pragma: no branch - nothing else is left
                names = [self._index.modules[module].name for module in self.schedule.in_partition(partition)]
                words = f"partition {partition}{with_names(names)} ended: {reason}"
                self._lost(partition, computing, words, FaultCode.PARTITION_ENDED)

    def not_ready(self, event: NotReady) -> None:
        """Make a module due now, because its last step was not computed (NotReady)."""
        if not self.schedule.again(event.module, event.release, self._turn.now_ns):
            self._turn.count("stale answer", event.module)

    def measured(self, event: StepMeasured) -> None:
        """Take the duration so far of an unfinished step; if this shows that its module hangs, end the partition."""
        if not self.schedule.hangs(event.module, event.release, event.spent_ns, self._turn.now_ns):
            return
        partition = self._index.modules[event.module].partition
        self._turn.do(EndPartition(partition))
        self._lost(
            partition, event.module, f"it hangs, after {event.spent_ns // 1_000_000} ms", FaultCode.MODULE_OVERRUN
        )

    def _failed(self, module: int, failure: Failure, code: FaultCode = FaultCode.MODULE_EXCEPTION) -> None:
        """Restart a module after a failure; after too many failures, give it up and report `code`."""
        running = self._running.get(module)
        if running is None or module in self.restarts.waiting:
            return
        times = self.restarts.failed(module, running.entry.restarts, self._turn.now_ns)
        self.checkpoints.failed(module, again=times != 1)
        if times is None:
            self._give_up(module, failure, code)
            return
        reason = self.failures.found(module, failure)
        self._halt(module)
        self._turn.note(
            "restart", f"module {running.entry.name} is restarted, {times} of {running.entry.restarts}: {reason}"
        )
        self._reports.found(FaultCode.MODULE_RESTARTED, ElementKind.MODULE, module, times)

    def _give_up(self, module: int, failure: Failure, code: FaultCode = FaultCode.MODULE_EXCEPTION) -> None:
        """Stop a module, do not restart it any more, and report the failure to the manager."""
        if not self._active_configuration.drop(module):
            return
        name, reason = self._running[module].entry.name, self.failures.found(module, failure)
        self._stop(module)
        self.restarts.forget(module)
        self.take_stock()
        self._turn.note("fault", f"module {name} is stopped: {reason}")
        self._reports.found(code, ElementKind.MODULE, module, 0)

    def repeat_faults(self) -> None:
        """Send again the reports that are due and that the manager has not acknowledged."""
        self._reports.tell(self.faults.tick(self._turn.now_ns))

    def lack(self, images: Mapping[str, str]) -> None:
        """Report to the manager every module with one of these images: its code is not on this PE.

        images: the reason why each image cannot be run here; an SDO client can read the reason.
        """
        for image, reason in sorted(images.items()):
            self._turn.note("image", f"{image} cannot be run here: {plain_reason(reason)}")
        for module, entry in sorted(self._index.modules.items()):
            if entry.image in images:
                self.failures.found(module, Failure(images[entry.image]))
                if module not in self._lacking:
                    self._lacking.add(module)
                    self._reports.found(FaultCode.MODULE_MISSING, ElementKind.MODULE, module, 0)

    def have(self, images: Collection[str]) -> None:
        """Note that the code of these images is on this PE now."""
        self._lacking -= {module for module in self._lacking if self._index.modules[module].image in images}

    def cleared(self, a: int, index: int) -> None:
        """Clear the faults of an element, as the operator commanded (CLEAR).

        a: kind of the element, and the PE on which it is cleared (`kind_and_place`). index: index of the element.
        A module whose code is not on this PE is reported again immediately.
        """
        kind, place = kind_and_place(a)
        if kind == ElementKind.PRIORITY or place not in (EVERYWHERE, self._index.node):
            return
        self._reports.tell(self.faults.clear(kind, index))
        if kind == ElementKind.MODULE and index in self._lacking:
            self._reports.found(FaultCode.MODULE_MISSING, ElementKind.MODULE, index, 0)

    def entered(self, phase: int) -> None:
        """Note the mission phase that the manager announces; send the phase requests that follow from a new one."""
        self._reports.tell(self._reports.phase_requests.entered(phase, self._turn.now_ns))

    def new_mastership(self) -> None:
        """Send requests and uncleared faults again, because the manager of a new term may have missed them.

        Also start again each failed module whose fault has been cleared.
        """
        now_ns = self._turn.now_ns
        self._reports.new_mastership()
        cleared = []
        for module in sorted(self._lacking):
            self._reports.tell(self.faults.tell_again(ElementKind.MODULE, module, now_ns))
        for module in sorted(self._active_configuration.failed):
            told = self.faults.tell_again(ElementKind.MODULE, module, now_ns)
            self._reports.tell(told)
            cleared += [] if told else [module]
        self._reports.tell(
            self.faults.tell_all_again(self._output_authorization.hears_since_ns(self._turn.arrived_ns), now_ns)
        )
        if cleared:
            self.carry_out(self._active_configuration.forgive(cleared), None)

    def validate(self) -> None:
        """Check that exactly the modules run that the reconfiguration wants; raises InvariantError."""
        modes = {module: running.mode for module, running in self._running.items()}
        live = self._active_configuration.live
        require(modes == live, "modules {} run, but the reconfiguration wants {}", modes, live)
        scheduled = self.schedule.modules
        require(
            scheduled.isdisjoint(self.restarts.waiting), "scheduled {} and waiting {}", scheduled, self.restarts.waiting
        )
        require(scheduled | self.restarts.waiting == modes.keys(), "scheduled {}, running {}", scheduled, modes)

    def _start(self, module: int, mode: int) -> None:
        self._running[module] = self._entered(module, mode)
        self._begin(module)

    def _entered(self, module: int, mode: int) -> _Running:
        entry = self._index.modules[module]
        gives = {v: (self._index.source_of[entry.name, v], q) for v, q in entry.modes[mode].gives.items()}
        return _Running(entry, mode, gives)

    def _begin(self, module: int) -> None:
        """Request that a module is built, or continues in a new mode; its first step is due now."""
        entry, mode = self._running[module].entry, self._running[module].mode
        self.schedule.start(module, entry.modes[mode].rate_mhz, self._turn.now_ns, entry.partition)
        self._reports.phase_requests.started(module, mode)
        self.silences.began(module, self._turn.now_ns)
        self.rests.began(module)
        self._turn.do(StartModule(module, entry, mode, self.checkpoints.start(module)))

    def _stop(self, module: int, *, keep: bool = False) -> None:
        del self._running[module]
        self._halt(module, keep=keep and module not in self.restarts.waiting)
        self.restarts.cancel(module)

    def _halt(self, module: int, *, keep: bool = False) -> None:
        """Stop stepping a module, and drop its object; with `keep`, keep the object for another mode."""
        self.schedule.stop(module)
        self.silences.began(module, self._turn.now_ns)
        self._reports.stopped(module)
        self.checkpoints.stopped(module)
        self.rests.stopped(module, keep=keep)
        self._turn.do(StopModule(module, keep))

    def _lost(self, partition: str, culprit: int | None, reason: str, code: FaultCode) -> None:
        """Restart all modules of a partition that has ended; give up those that have failed too often.

        culprit: index of the module that counts as failed; None: every module of the partition does.
        """
        for module in self.schedule.in_partition(partition):
            if culprit in (None, module):
                self._failed(module, Failure(reason), code)
            else:
                self._halt(module)
                self.restarts.begin_at(module, self._turn.now_ns)

    def _drive(self, running: _Running, writes: tuple[Value, ...]) -> None:
        """Execute the commands of a module to its device; those of a DEMUX branch only if it is authorized now."""
        if writes and running.entry.demux and not self._output_authorization.allows(self._turn.now_ns):
            self._turn.count("write held", running.entry.index)
            self._reports.held()
            return
        self._turn.do(*(Drive(running.entry.index, value) for value in writes))

    def take_stock(self) -> None:
        """Recompute the load, and whether this PE has exclusive outputs, after a change of the running modules."""
        exclusive = self._index.movable.intersection(self._publish)
        self.has_exclusive_output = any(
            r.entry.demux or any(source in exclusive for source, _ in r.gives.values()) for r in self._running.values()
        )
        cpu_millis = sum(r.entry.modes[r.mode].cpu_millis for r in self._running.values())
        self.load_percent = 100 * cpu_millis // max(self._index.table.cpu_millis, 1)

    def _give(self, running: _Running, variable: str, value: Value) -> None:
        """Publish the value of an output of a module, and apply the phase rules of this variable.

        Raises WireError for a value that no frame can carry. An output that is not in the mode is only counted.
        """
        if variable not in running.gives:
            self._turn.count("output that the mode does not give", running.entry.index)
            return
        source, version = running.gives[variable]
        self._put_out(source, self.publisher.datum(source, version, value))
        self._reports.gave(running.entry.index, variable, value)

    def _put_out(self, source: int, frame: Frame) -> None:
        """Store a datum in the mailbox of its source, and send it on the buses that the slice names, if authorized."""
        box = self.mailboxes.boxes.get(source)
        if box is not None:
            box.put(frame.data, self._turn.now_ns)
        ports = self._publish.get(source)
        if not ports:
            return
        until_ns = None
        if source in self._index.movable:
            until_ns = self._output_authorization.identifiers_until_ns(self._turn.now_ns)
            if until_ns is None:
                self._turn.count("frame held", frame.can_id)
                self._reports.held()
                return
        self.publisher.sent(frame)
        self._turn.do(*(Send(port, frame, until_ns) for port in ports))
