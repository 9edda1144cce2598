"""The agent of one PE as a state machine: it takes frames, the time and results of modules, and returns actions.

Each part of the agent has a file of its own, and decides one matter:

    inbound                                            which part takes a frame
    command_acceptance, followed_manager               which commands to accept
    staging                                            what to run next
    table_change                                       another table, beside the one that flies
    active_configuration                               how the next configuration replaces the present one
    running_modules, checkpoints                       what runs, and with which state it starts
    output_authorization, exclusive_frames             whether exclusive outputs are authorized
    condition, reporting, faults, canopen_node         what to report
    gateway, radios                                    what to forward
    deadlines                                          when to act

This file makes the parts. At each event it hands the event to one part, then steps the modules that are due, then sends
the state frames that the parts have requested, and then queues the frames to a radio. A frame that no part takes is
dropped after one look-up of its identifier. No part gets a frame with a 29-bit identifier, a remote frame or an error
frame.

No frame raises an exception, whatever its bytes are and whenever it comes. A malformed frame is counted (`counts`) and
changes nothing. An exception means a programming error: the caller's time went back, or an invariant is broken.

A PE that hears no other node continues to run its modules, but holds back its exclusive outputs (protocol rule 6). If
the policy is `safe_mode`, the PE also stops its expendable modules (`without_manager`). Its state frames report that it
hears no LEASE.

If another node uses this PE's node-ID, the agent logs and counts the frames of that node. The driver does not start the
agent while such a node is heard.
"""

from collections import Counter, deque
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType

from heronry_agent.core.authority import Authenticity, ExclusiveFrames, FollowedManager, OutputAuthorization, Secret
from heronry_agent.core.canopen import CanopenNode, GivenTable, Parts, Programs
from heronry_agent.core.command_acceptance import CommandAcceptance
from heronry_agent.core.condition import Condition, StateReports
from heronry_agent.core.configuration import ActiveConfiguration, SliceReader, Staging
from heronry_agent.core.deadlines import Deadlines
from heronry_agent.core.forwarding import Gateway, Radios
from heronry_agent.core.inbound import Inbound
from heronry_agent.core.modules import RunningModules, WithoutManager
from heronry_agent.core.reports import ChannelReports, Reporting
from heronry_agent.core.table_change import TableBeside, TableSwitch
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import (
    Action,
    AtRest,
    ChannelsLost,
    DriveFailed,
    Driven,
    Event,
    ImagesArrived,
    ImagesMissing,
    Left,
    NotReady,
    PartitionEnded,
    ProgramChanged,
    ProgramState,
    StartFailed,
    StateLacking,
    StateRestored,
    StateSaved,
    StateUnused,
    StepFailed,
    StepMeasured,
    Stepped,
    TablePrepared,
)
from heronry_wire.management import NO_EPOCH
from heronry_wire.node_cost import NodeCost
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import InvariantError, Received, Tick, require
from heronry_wire.sdo import Abort
from heronry_wire.standstill import StoodStill

_NS_PER_MS = 1_000_000


class AgentCore:
    """The agent of one PE: a state machine that its driver calls with events, and that returns actions."""

    def __init__(
        self,
        table: PeTable,
        incarnation: int,
        now_ns: int,
        *,
        missing_images: Mapping[str, str] = MappingProxyType({}),
        secret: Secret | None = None,
        followed: Collection[str] | None = None,
        every_echo: bool = False,
        cost: Callable[[], NodeCost | None] = lambda: None,
        takes_tables: bool = False,
        program: ProgramState | None = None,
        kept_parts: bytes = b"",
        slow_to_rest: frozenset[int] = frozenset(),
    ) -> None:
        """Start without a configuration; the first deadline is `now_ns`.

        incarnation: boot count, 0..255, different from that of the last start of this PE.
        missing_images: images of the table whose code is not on this PE, each with the reason. The agent reports their
            modules to the manager at its start, and refuses a slice that contains one of these modules.
        secret: the key of the fleet; with a key the PE executes only commands that are tagged with it.
        followed: names of actuators on other PEs; the output echoes of these actuators go to the plant of this PE.
            None: those of all actuators.
        every_echo: whether the simulated plants of other PEs need an echo of every command; if not, outputs are echoed
            as often as the table says.
        cost: returns what this node costs its computer, or None while that is not known; clients read it by SDO.
        takes_tables: whether the PE accepts another table over the bus: while it runs nothing, in place of its own
            (`new_table`), else beside it (`table_change`).
        program: what the loader of code says; None: this PE has no loader.
        kept_parts: what this loader has kept of an unfinished bundle (`KeepParts`).
        slow_to_rest: modules whose StopModule the driver answers with AtRest.
        Raises TableError where the table contradicts itself.
        """
        index = self._index = TableIndex(table)
        uplink = table.ports[index.uplink]
        turn = Turn(now_ns, uplink.heartbeat_ns)
        gateway = Gateway(index)
        self._turn = turn
        self.lease_ns = index.lease_ns  # T_lease
        followed_manager = self.followed_manager = FollowedManager(index.leased_ns)
        exclusive_frames = ExclusiveFrames(turn, index, gateway)
        output_authorization = self.output_authorization = OutputAuthorization(
            index.lease_ns, revoked=exclusive_frames.withdraw, has_key=secret is not None
        )
        active_configuration = self.active_configuration = ActiveConfiguration(index)
        staging = self.staging = Staging(SliceReader(index, missing_images), uplink.heartbeat_ns // 2)
        modules = self.modules = RunningModules(turn, index, active_configuration, output_authorization)
        modules.echoes.every, modules.rests.slow = every_echo, slow_to_rest
        without_manager = WithoutManager(turn, followed_manager, active_configuration, modules)
        condition = Condition(
            turn, index, followed_manager, output_authorization, staging, active_configuration, modules
        )
        facts, pending = condition.facts, modules.faults.messages
        authenticity = None
        if secret is not None:
            authenticity = Authenticity(
                turn,
                index,
                followed_manager,
                gateway,
                facts=facts,
                pending=pending,
                secret=secret,
                saw_epoch=lambda epoch: output_authorization.saw_epoch(epoch, active_configuration.running.epoch),
            )
        self.authenticity = authenticity
        beside = self._beside = TableBeside(turn, index, staging, active_configuration)
        table_switch = TableSwitch(
            turn,
            index,
            beside,
            staging=staging,
            active_configuration=active_configuration,
            modules=modules,
            gateway=gateway,
            followed_manager=followed_manager,
        )
        acceptance = CommandAcceptance(
            turn,
            index,
            followed_manager,
            output_authorization,
            staging,
            active_configuration,
            modules,
            gateway,
            exclusive_frames,
            without_manager,
            authenticity,
            table_switch,
        )
        beside.changed = acceptance.look_at_exclusive
        given = self._given = GivenTable(turn, index.node)

        def take_table(text: bytes) -> Abort | None:
            if not takes_tables:
                return Abort.DEVICE_STATE
            if active_configuration.running.epoch == NO_EPOCH:
                return given.take(text)
            beside.take(text)
            return None

        self._programs = None if program is None else Programs(turn, program, kept_parts)
        parts = Parts(
            turn,
            index,
            incarnation,
            followed_manager,
            active_configuration,
            modules,
            facts,
            take_table=take_table,
            flies_by_two=takes_tables,
            authenticity=authenticity,
            cost=cost,
            programs=self._programs,
        )
        canopen = CanopenNode(parts)
        reporting = Reporting(index, incarnation, now_ns, None if authenticity is None else authenticity.seal)
        reports = self._state_reports = StateReports(turn, condition, reporting, modules, authenticity)
        channels = self._channels = ChannelReports(turn, index)
        self._radios = Radios(turn, index)
        notes = _start_notes(table, secret)
        self._deadlines = Deadlines(turn, staging, without_manager, canopen, reports, modules, channels, notes)
        self._inbound = Inbound(
            turn,
            index,
            output_authorization=output_authorization,
            active_configuration=active_configuration,
            modules=modules,
            gateway=gateway,
            authenticity=authenticity,
            commands=acceptance.handlers(),
            services=canopen.handlers(),
            followed=followed,
        )
        self._recent: deque[tuple[int, Event]] = deque(maxlen=16)
        self._due_ns: int | None = None  # the next deadline, once it has been computed

    @property
    def new_table(self) -> PeTable | None:
        """The table that was given to this PE over the bus in place of its own; None: there is none.

        The driver then ends this core, and starts another one with that table.
        """
        return self._given.table

    @property
    def table(self) -> PeTable:
        """The table by which this PE flies."""
        return self._index.table

    @property
    def counts(self) -> Counter[tuple[str, int]]:
        """How many frames and answers were malformed or refused, by (cause, number).

        The number is the CAN identifier of the frame, or the index of the module that answered.
        """
        return self._turn.counts

    @property
    def identifiers(self) -> Collection[int]:
        """CAN identifiers that the core takes at present; whenever they change, this is a new object.

        The driver may drop frames with other identifiers, except those from a radio (`radio_ports`).
        """
        return self._inbound.handlers

    @property
    def patient_identifiers(self) -> frozenset[int]:
        """Those of `identifiers` whose frames nobody awaits, except for the other ports of a gateway.

        It is enough if the core gets these frames when its next deadline is due.
        """
        return self._inbound.patient

    @property
    def radio_ports(self) -> Collection[int]:
        """Numbers of the ports that lead to a radio.

        On these ports the driver hands every frame to the core, whatever its identifier, and reports each sent frame
        that has left the CAN controller (`Left`).
        """
        return self._radios.ports.keys()

    def step(self, now_ns: int, event: Event) -> list[Action]:
        """Process one event, and return the actions that the driver has to execute, in the order of the list.

        Raises ValueError if `now_ns` is before that of the last call.
        """
        turn, inbound, radios = self._turn, self._inbound, self._radios
        turn.begin(now_ns)
        if type(event) is Received:
            frame = event.frame
            identifier = frame.can_id
            if radios.ports:
                radios.measure(event)
            handler = inbound.handlers.get(identifier)
            if handler is None:
                return radios.passed(turn.end()) if radios.ports else turn.end()
            if frame.extended or frame.remote or frame.error:
                turn.count("not a data frame of 11 bits", identifier)
                return turn.end()
            turn.arrived(event.age_ns, inbound.late_ns)
            handler(event)
            if identifier in inbound.quiet:
                return radios.passed(turn.end()) if radios.ports else turn.end()
        else:
            self._take_own(event)
        self._recent.append((now_ns, event))
        self._due_ns = None
        if turn.rewired:
            inbound.rewire()
        self._state_reports.immediate()
        return radios.passed(turn.end()) if radios.ports else turn.end()

    def next_deadline_ns(self) -> int:
        """Time in ns at which to call `step` with a Tick, if no event comes before."""
        due_ns = self._due_ns
        if due_ns is None:
            due_ns = self._due_ns = self._deadlines.next_ns()
        return min(due_ns, self._radios.next_ns) if self._radios.ports else due_ns

    def validate(self) -> None:
        """Check every invariant; raises InvariantError, whose message ends with the last events."""
        try:
            self.active_configuration.validate()
            self.modules.validate()
            running, staged = self.active_configuration.running, self.staging.staged
            require(staged.epoch != running.epoch or staged is running, "one epoch has two configurations")
        except InvariantError as error:
            story = "\n".join(f"  {at_ns} {event}" for at_ns, event in self._recent)
            raise InvariantError(f"{error}; recent events:\n{story}") from None

    def _take_own(self, event: Event) -> None:
        """Process an event that is not a received frame: the time, or what the driver reports."""
        modules = self.modules
        match event:
            case Tick():
                self._deadlines.tick()
            case Stepped():
                modules.stepped(event)
            case StepFailed() | StartFailed() | DriveFailed() | PartitionEnded():
                modules.went_wrong(event)
            case Driven():
                modules.driven(event)
                return
            case AtRest(module):
                modules.rests.came(module)
            case TablePrepared():
                self._beside.prepared(event)
            case StateSaved() | StateRestored() | StateLacking() | StateUnused():
                modules.checkpoints.take(event)
            case NotReady():
                modules.not_ready(event)
            case StepMeasured():
                modules.measured(event)
            case ImagesMissing() | ImagesArrived() | ProgramChanged():
                self._code_changed(event)
            case _:
                self._take_surroundings(event)
        if self._turn.now_ns >= self.modules.next_ns:
            self.modules.tick()
            self.modules.release()

    def _take_surroundings(self, event: Event) -> None:
        """Process what the driver reports of the buses and of this computer."""
        match event:
            case Left(port, took_ns):
                self._radios.ports[port].left(took_ns)
            case ChannelsLost(port, channels):
                self._channels.told(port, channels)
            case StoodStill():  # pragma: no branch - nothing else comes here
                if self._turn.standstills.count(event, self._turn.now_ns):
                    self._turn.note("late", f"this computer stood still for {event.for_ns // _NS_PER_MS} ms")

    def _code_changed(self, event: ImagesMissing | ImagesArrived | ProgramChanged) -> None:
        """Take what is known anew of the code on this PE.

        Images that are missing: report their modules to the manager, and refuse slices with these from now on, also
        slices of the table beside. Images that have arrived: accept such slices; the faults of their modules stay until
        the manager clears them.
        """
        readers = [one for one in (self.staging.reader, self.staging.beside) if one is not None]
        match event:
            case ImagesMissing(images):
                for reader in readers:
                    reader.missing_images |= images
                self.modules.lack(images)
            case ImagesArrived(arrived):
                for reader in readers:
                    reader.missing_images = {i: why for i, why in reader.missing_images.items() if i not in arrived}
                self.modules.have(arrived)
            case ProgramChanged(state):  # pragma: no branch - nothing else is left
                require(self._programs is not None, "a loader reports, and this PE was started without one")
                assert self._programs is not None
                self._programs.changed(state)


def _start_notes(table: PeTable, secret: Secret | None) -> tuple[str, str]:
    """Return two texts to log at the start: which PE this is, and which key it has, or that it has none."""
    key = "no key: any node on the bus can command this PE" if secret is None else f"{secret.key!r}"
    return f"PE {table.name} of {table.spec}, node {table.node_id}", key
