"""The agent of one PE as a state machine: frames, time and answers of modules in, actions out.

Its parts decide, each in its own file: what to obey (`obedience`, `reign`), what to run next (`staging`) and how to get
there (`reconfiguration`), what runs (`running_modules`), whether it may drive what is exclusive (`permission`), what to
say (`reporting`, `faults`, `canopen_node`) and what to pass on (`gateway`). This file sends each frame to the part that
wants it, by one look-up of its identifier: what no part wants costs no more than that. A frame with 29 bits, a remote
or an error frame reaches no part.

Whatever comes in, in whatever order, nothing here raises: bad bytes are counted (`counts`, by what and identifier) and
change nothing. Only a driver that lets time go back gets an exception, and so does a broken invariant.

What a PE does when it hears nobody: it goes on with what it runs, without its exclusive outputs (rule 6) and, if the
spec's policy is `safe_mode`, without what is not critical (`without_manager`); and says in its state that it hears no
lease. Another node with the same node-ID is noted and counted; it is the driver that refuses to start beside one.
"""

from collections import Counter, deque
from collections.abc import Callable, Collection
from functools import partial

from heronry_agent.core.authenticity import Authenticity, Secret
from heronry_agent.core.canopen_node import CanopenNode
from heronry_agent.core.channel_reports import ChannelReports
from heronry_agent.core.command_acceptance import Obedience
from heronry_agent.core.gateway import Gateway
from heronry_agent.core.mastership import Reign
from heronry_agent.core.output_authorization import Permission
from heronry_agent.core.pe_objects import Parts
from heronry_agent.core.publishing import ECHO_NODES
from heronry_agent.core.radio_port import RadioPort
from heronry_agent.core.reconfiguration import Reconfiguration
from heronry_agent.core.reporting import Facts, Reporting
from heronry_agent.core.running_modules import RunningModules
from heronry_agent.core.slice_reading import SliceReader
from heronry_agent.core.staging import Staging
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import (
    Action,
    ChannelsLost,
    DriveFailed,
    Driven,
    Event,
    Heard,
    ImagesMissing,
    Left,
    NotReady,
    PartitionEnded,
    StartFailed,
    StepFailed,
    StepMeasured,
    Stepped,
)
from heronry_agent.core.without_manager import WithoutManager
from heronry_wire.frame import Frame
from heronry_wire.identifiers import PE_NODES, actuator_echo_id, emcy_id, emergency_event_id, heartbeat_id, state_id
from heronry_wire.management import PeFlags
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import InvariantError, Received, Send, Tick, Withdraw, require

_OWN = (emergency_event_id, state_id, emcy_id, heartbeat_id, actuator_echo_id)
_Handler = Callable[[Received], None]

_STATE_BYTES = 8
_PAGE_1 = 0x40  # the page is in the two highest bits of byte 0 of a state frame (management.STATE_0)


class AgentCore:
    """The agent of one PE."""

    def __init__(
        self,
        table: PeTable,
        incarnation: int,
        now_ns: int,
        *,
        missing_images: frozenset[str] = frozenset(),
        secret: Secret | None = None,
        followed: Collection[str] | None = None,
    ) -> None:
        """Start unconfigured; the first deadline is now.

        incarnation: 0..255, another one than at the last start of this PE.
        missing_images: images of the table that cannot be loaded here; a slice that names one is refused.
        secret: the key of the fleet; with one nothing is obeyed but what was tagged with it.
        followed: actuators of other PEs whose echoes move the world here; None: all.
        Raises TableError where the table contradicts itself.
        """
        index = self._index = TableIndex(table)
        turn = self._turn = Turn(now_ns)
        self.lease_ns = index.lease_ns  # T_lease
        self.clashed = False  # another node has spoken under an identifier of this one
        self.reign = Reign(index.leased_ns)
        self.permission = Permission(index.lease_ns)
        self.reconfiguration = Reconfiguration(index)
        self.staging = Staging(SliceReader(index, missing_images), table.ports[index.uplink].heartbeat_ns // 2)
        self.modules = RunningModules(turn, index, self.reconfiguration, self.permission)
        self._without_manager = WithoutManager(turn, self.reign, self.reconfiguration, self.modules)
        self._gateway = Gateway(index)
        self._late_ns = table.ports[index.uplink].heartbeat_ns // 4  # a frame that is, was not taken when it came
        self.permission.revoked = self._take_back
        self._secret = secret
        self._echo_ids = ECHO_NODES.keys() if followed is None else _echo_ids(table, followed)
        authenticity = self.authenticity = self._make_authenticity(secret)
        self._obedience = Obedience(
            turn,
            index,
            self.reign,
            self.permission,
            self.staging,
            self.reconfiguration,
            self.modules,
            self._gateway,
            self._without_manager,
            authenticity,
        )
        self._radios = {
            port: RadioPort(port, index, now_ns) for port, entry in enumerate(table.ports) if entry.link_id is not None
        }
        self._channels = ChannelReports(index.node)
        self._reporting = Reporting(index, incarnation, now_ns, None if authenticity is None else authenticity.seal)
        self._canopen = CanopenNode(
            Parts(
                turn,
                index,
                incarnation,
                self.reign,
                self.reconfiguration,
                self.modules,
                self._facts,
                authenticity=authenticity,
            )
        )
        self._keeps_what_is_critical = table.without_manager == "safe_mode"
        self._told: dict[str, bool] = {"output": True}
        self._proven_changes = 0
        self._recent: deque[tuple[int, Event]] = deque(maxlen=16)
        self._fixed_handlers = self._find_fixed_handlers()
        self._handlers = self._fixed_handlers
        self._quiet = self._find_quiet()
        self._due_ns: int | None = None  # the next deadline, once it has been asked for

    @property
    def counts(self) -> Counter[tuple[str, int]]:
        """What was not understood or not obeyed, by what it was and identifier (or module)."""
        return self._turn.counts

    def hears(self, identifier: int) -> bool:
        """Tell whether frames of an identifier mean anything here now; a driver may keep all others to itself."""
        return identifier in self._handlers

    @property
    def identifiers(self) -> Collection[int]:
        """Every identifier that means something here now: another object whenever they have changed."""
        return self._handlers

    @property
    def radio_ports(self) -> Collection[int]:
        """Ports whose every frame is measured: hand over all that comes there, and tell what has `Left`."""
        return self._radios.keys()

    def step(self, now_ns: int, event: Event) -> list[Action]:
        """Take one event and give what is to be done, in this order; `now_ns` never goes back."""
        turn = self._turn
        out = turn.begin(now_ns)
        if type(event) is Received:
            frame = event.frame
            identifier = frame.can_id
            if self._radios:
                self._measure(event)
            handler = self._handlers.get(identifier)
            if handler is None:
                return self._by_radio(out) if self._radios else out
            if frame.extended or frame.remote or frame.error:
                turn.count("not a data frame of 11 bits", identifier)
                return out
            turn.arrived(event.age_ns, self._late_ns)
            handler(event)
            if identifier in self._quiet:
                return self._by_radio(out) if self._radios else out
        else:
            self._take_own(event)
        self._recent.append((now_ns, event))
        self._due_ns = None
        if turn.rewired:
            self._handlers = self._fixed_handlers | self._find_data_handlers()
            self._quiet = self._find_quiet()
        if self.authenticity is not None and self.modules.faults.changes != self._proven_changes:
            self._proven_changes = self.modules.faults.changes
            turn.wants_page_0 = True  # it proves what EMCY has said
        if turn.wants_page_0 or turn.wants_page_1:
            out += self._reporting.at_once(self._facts(), page_0=turn.wants_page_0, page_1=turn.wants_page_1)
        return self._by_radio(out) if self._radios else out

    def next_deadline_ns(self) -> int:
        """When to call with Tick, if nothing comes before."""
        due_ns = self._due_ns
        if due_ns is None:
            due_ns = min(self._reporting.next_ns, self.modules.next_ns)
            due_ns = min(due_ns, self.modules.faults.next_ns)
            due_ns = min(due_ns, self.staging.ask_ns)
            due_ns = min(due_ns, self._canopen.next_ns)
            due_ns = min(due_ns, self._without_manager.next_ns)
            due_ns = self._due_ns = min(due_ns, self._channels.next_ns)
        for radio in self._radios.values():
            due_ns = min(due_ns, radio.next_ns)
        return due_ns

    def validate(self) -> None:
        """Check every invariant; raises InvariantError with the recent events."""
        try:
            self.reconfiguration.validate()
            self.modules.validate()
            running, staged = self.reconfiguration.running, self.staging.staged
            require(staged.epoch != running.epoch or staged is running, "one epoch has two configurations")
        except InvariantError as error:
            story = "\n".join(f"  {at_ns} {event}" for at_ns, event in self._recent)
            raise InvariantError(f"{error}; recent events:\n{story}") from None

    def _measure(self, event: Received) -> None:
        frame, radio = event.frame, self._radios.get(event.port)
        if radio is not None and not (frame.extended or frame.remote or frame.error):
            self._turn.out += radio.heard(frame, self._turn.now_ns)

    def _by_radio(self, out: list[Action]) -> list[Action]:
        """Let what goes to a radio wait for its turn, and whatever has its turn now go.

        What is passed on is as old as it is: after a pause of this process nothing stale goes by radio.
        """
        now_ns, passed = self._turn.now_ns, []
        for action in out:
            if type(action) is Send and action.port in self._radios:
                self._radios[action.port].send(action.frame, action.until_ns, self._turn.arrived_ns)
                continue
            if isinstance(action, Withdraw):
                for radio in self._radios.values():
                    radio.withdraw(action.identifiers)
            passed.append(action)
        for radio in self._radios.values():
            passed += radio.step(now_ns)
        return passed

    def _take_own(self, event: Event) -> None:
        """Take what comes from this PE itself: time, and the answers of its modules."""
        modules = self.modules
        match event:
            case Tick():
                self._tick()
            case Stepped():
                modules.stepped(event)
            case StepFailed() | StartFailed() | DriveFailed() | PartitionEnded():
                modules.went_wrong(event)
            case Driven():
                modules.driven(event)
                return
            case NotReady():
                modules.not_ready(event)
            case StepMeasured():
                modules.measured(event)
            case ImagesMissing():
                self._images_missing(event)
            case Left(port, took_ns):
                self._radios[port].left(took_ns)
            case ChannelsLost(port, channels):  # pragma: no branch - frames do not come here
                self._channels_lost(port, channels)
        if self._turn.now_ns >= self.modules.next_ns:
            self.modules.tick()
            self.modules.release()

    def _images_missing(self, event: ImagesMissing) -> None:
        """Code that is not there: slices that name it are refused from now on."""
        self.staging.reader.missing_images |= event.images
        for image in sorted(event.images):
            self._turn.note("image", f"{image} cannot be run here")

    def _channels_lost(self, port: int, lost: frozenset[int]) -> None:
        """The driver has compared the channels of a bus: this is told, and nothing else happens."""
        bus = self._index.table.ports[port].bus
        names = ", ".join(f"{bus}.{channel}" for channel in sorted(lost))
        self._turn.note("channel", f"{names} carries nothing here" if lost else f"{bus} has both its channels")
        self._tell(self._channels.told(port, lost, self._turn.now_ns))

    def _tell(self, frames: list[Frame]) -> None:
        self._turn.out += [Send(self._index.uplink, frame) for frame in frames]

    def _tick(self) -> None:
        turn = self._turn
        if self.staging.tick(turn.now_ns):
            turn.wants_page_1 = True
        if turn.now_ns >= self._without_manager.next_ns:
            self._without_manager.tick()
        if turn.now_ns >= self._canopen.next_ns:
            if not self._canopen.booted:
                self._note_start()
            self._canopen.tick()
        if turn.now_ns >= self._reporting.next_ns:
            turn.out += self._reporting.tick(turn.now_ns, self._facts())
            if self.authenticity is not None:
                self.authenticity.beat()
        if turn.now_ns >= self.modules.faults.next_ns:
            self.modules.repeat_faults()
        if turn.now_ns >= self._channels.next_ns:
            self._tell(self._channels.tick(turn.now_ns))

    def _note_start(self) -> None:
        table = self._index.table
        self._turn.note("start", f"PE {table.name} of {table.spec}, node {table.node_id}")
        secret = self._secret
        told = "no key: whoever can send on the bus can command it" if secret is None else f"{secret.key!r}"
        self._turn.note("start", told)

    def _make_authenticity(self, secret: Secret | None) -> Authenticity | None:
        if secret is None:
            return None
        return Authenticity(
            self._turn,
            self._index,
            self.reign,
            self._gateway,
            facts=self._facts,
            pending=self.modules.faults.messages,
            secret=secret,
        )

    def _facts(self) -> Facts:
        """What the state frames tell now; a change that nobody commanded is noted on the way."""
        now_ns = self._turn.now_ns
        hears_lease = self.reign.hears_lease(now_ns)
        held = self.modules.has_exclusive_output and not self.permission.allows(now_ns)
        goes_on = "with what is critical" if self._keeps_what_is_critical else "as before"
        self._note_change("lease", hears_lease, "a manager is heard", f"no manager is heard; going on {goes_on}")
        self._note_change("output", not held, "exclusive outputs are free", "exclusive outputs are held back")
        flags = PeFlags.HEARS_LEASE if hears_lease else PeFlags(0)
        if self.modules.faults.pending:
            flags |= PeFlags.FAULT_PENDING
        if held:
            flags |= PeFlags.OUTPUT_HELD
        running = self.reconfiguration.running
        return Facts(
            self.reconfiguration.state,
            flags,
            running.epoch,
            running.digest,
            *self.staging.told,
            self.staging.reason,
            self.modules.load_percent,
        )

    def _note_change(self, kind: str, holds: bool, gained: str, lost: str) -> None:
        if self._told.get(kind, False) != holds:
            self._told[kind] = holds
            self._turn.note(kind, gained if holds else lost)

    def _find_quiet(self) -> frozenset[int]:
        """Identifiers whose frames move no deadline and no state frame: most of all that comes."""
        quiet = (self._state, self._echo, self._from_beyond, self._forward)
        often = (self._datum,) if self.authenticity is None else (self._datum, self.authenticity.hold)
        return frozenset(
            identifier
            for identifier, handler in self._handlers.items()
            if handler in quiet or (isinstance(handler, partial) and handler.func in often)
        )

    def _find_fixed_handlers(self) -> dict[int, _Handler]:
        """Handlers that do not depend on the configuration, by identifier."""
        handlers: dict[int, _Handler] = dict.fromkeys(self._gateway.rising_ids, self._from_beyond)
        handlers |= dict.fromkeys(map(state_id, PE_NODES), self._state)
        handlers |= dict.fromkeys(self._echo_ids, self._echo)
        commands = self._obedience.handlers()
        handlers |= commands if self.authenticity is None else self.authenticity.guarded(commands)
        handlers |= self._canopen.handlers()
        own = (identify(self._index.node) for identify in _OWN)
        return handlers | dict.fromkeys(own, self._own_identifier)

    def _find_data_handlers(self) -> dict[int, _Handler]:
        """Handlers of the data that the configuration has this PE read or forward."""
        sources = self._index.table.sources
        remote = self.reconfiguration.running.slice.remote
        handlers: dict[int, _Handler] = dict.fromkeys(self._gateway.data_ids, self._forward)
        for source in remote.keys() & self.modules.mailboxes.boxes.keys():
            handlers[sources[source].identifier] = partial(self._datum, source)
        return handlers

    def _datum(self, source: int, event: Received) -> None:
        if not self.modules.mailboxes.boxes[source].put(event.frame.data, self._turn.arrived_ns):
            self._turn.count("foreign or malformed datum", event.frame.can_id)
        self._forward(event)

    def _forward(self, event: Received) -> None:
        turn = self._turn
        turn.out += self._gateway.data(event.port, event.frame, turn.now_ns, self._contested_until_ns)

    def _contested_until_ns(self, now_ns: int) -> int | None:
        """Until when what is exclusive may go up; not at all what came while nobody ran: its news may be behind it."""
        turn = self._turn
        return None if turn.arrived_ns <= turn.held_until_ns else self.permission.identifiers_until_ns(now_ns)

    def _take_back(self) -> None:
        """Another PE may be sending by now what this one was allowed to: what waits of that must not follow."""
        self._turn.withdraw(self._index.identifiers(self.modules.exclusive_sources) | self._gateway.contested_ids)

    def _from_beyond(self, event: Received) -> None:
        self._turn.out += self._gateway.up(event.port, event.frame)

    def _state(self, event: Received) -> None:
        """Another PE lives, and may show that we have been overtaken. Only the epoch of page 0 is read: this is hot."""
        data = event.frame.data
        if len(data) != _STATE_BYTES:
            self._turn.count("malformed state", event.frame.can_id)
            return
        if data[0] < _PAGE_1:
            if event.port == self._index.uplink:
                self.permission.heard(self._turn.arrived_ns)
            epoch, running = data[2] << 8 | data[3], self.reconfiguration.running.epoch
            if epoch != running:
                self.permission.saw_epoch(epoch, running)
        if event.port != self._index.uplink:
            self._from_beyond(event)

    def _echo(self, event: Received) -> None:
        """Another PE's actuator was told something, which moves the world here too, or an output ran there."""
        heard = self.modules.heard_echo(event.frame)
        if heard is not None:
            self._turn.out.append(Heard(*heard))
        self._from_beyond(event)

    def _own_identifier(self, event: Received) -> None:
        self._turn.count("node-ID clash", event.frame.can_id)
        if self.authenticity is None and event.frame.can_id == state_id(self._index.node):
            self.permission.clashed(self._turn.arrived_ns)
        if not self.clashed:
            self.clashed = True
            self._turn.note("clash", f"another node has node-ID {self._index.node}: it sent {event.frame.can_id}")


def _echo_ids(table: PeTable, actuators: Collection[str]) -> Collection[int]:
    """Identifiers under which the PEs of these actuators echo."""
    return {actuator_echo_id(device.node) for device in table.devices if device.name in actuators}
