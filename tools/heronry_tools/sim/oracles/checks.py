"""All that watches a run, behind one look-up by identifier."""

from collections.abc import Callable, Collection, Sequence
from functools import partial

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.runtime.witness import Witness
from heronry_tools.sim.oracles.authenticity import AuthenticityCheck
from heronry_tools.sim.oracles.blame import BlameCheck
from heronry_tools.sim.oracles.channels import ChannelCheck
from heronry_tools.sim.oracles.commanded import Commanded
from heronry_tools.sim.oracles.configurations import ConfigurationCheck
from heronry_tools.sim.oracles.end_state import Seen, end_state
from heronry_tools.sim.oracles.epochs import EpochCheck
from heronry_tools.sim.oracles.exclusion import ExclusionCheck
from heronry_tools.sim.oracles.freshness import FreshnessCheck
from heronry_tools.sim.oracles.journal import JournalCheck, Read
from heronry_tools.sim.oracles.liveness import Losses
from heronry_tools.sim.oracles.load import LoadCheck
from heronry_tools.sim.oracles.orphans import OrphanCheck
from heronry_tools.sim.oracles.phase import PhaseCheck
from heronry_tools.sim.oracles.planned_load import PlannedLoadCheck
from heronry_tools.sim.oracles.proven_states import ProvenStates
from heronry_tools.sim.oracles.publishing import PublishingCheck
from heronry_tools.sim.oracles.radio import RadioCheck
from heronry_tools.sim.oracles.safe_mode import SafeModeCheck
from heronry_tools.sim.oracles.service import ServiceCheck, Struck
from heronry_tools.sim.oracles.solitude import Solitude
from heronry_tools.sim.oracles.terms import TermCheck
from heronry_tools.sim.oracles.transitions import TransitionCheck
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Clash, Sent
from heronry_tools.sim.world.nodes import Driven, Moved
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.authentication import Key
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import (
    ALLOCATED_DATA_IDS,
    GATEWAY_IDS,
    MANAGER_NODES,
    PE_NODES,
    STANDARD_DATA_IDS,
    Command,
    actuator_echo_id,
    emcy_id,
    management_id,
    state_id,
)
from heronry_wire.management import (
    Activate,
    Alive,
    Control,
    ElementKind,
    Emergency,
    Lease,
    decode_command,
    decode_emergency,
)
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import PeState, StatePage0


class Checks:
    """The checkers of one run."""

    def __init__(
        self,
        spec: Spec,
        tables: Collection[PeTable] = (),
        key: Key | None = None,
        read_journal: Read = lambda _: None,
    ) -> None:
        """Watch runs of this spec.

        tables: what its PEs were given, if anything on board matters.
        key: with which everything is tagged, if it is.
        read_journal: gives the bytes of a manager's journal.
        """
        self._spec, self._bus = spec, spec.manager.bus
        self._term = 0  # the highest that was heard
        self._commands = Commanded(spec, tables)
        self._proven = None if key is None else ProvenStates(key)
        self._exclusion = ExclusionCheck(spec)
        self._terms = TermCheck(spec, has_key=key is not None)
        self._journals = JournalCheck(spec, read_journal)
        self.authenticity = None if key is None else AuthenticityCheck(spec, key)
        self._orphans = OrphanCheck(spec, has_digests=key is None)
        self._epochs = EpochCheck(spec, has_digests=key is None)
        self._blame = BlameCheck(spec)
        self.channels = ChannelCheck(spec)
        self._configurations = ConfigurationCheck(spec)
        self._solitude = Solitude(spec)
        self._service = ServiceCheck(spec, self._solitude.ended_ns)
        self.phases = PhaseCheck(spec, self._service.entered)
        self._transitions = TransitionCheck(spec, self._commands.epochs)
        self._freshness = FreshnessCheck(spec, self._commands)
        self._publishing = PublishingCheck(spec, self._commands)
        self._safe_mode = SafeModeCheck(spec, self._commands)
        self._load = LoadCheck(spec)
        self._planned_load = PlannedLoadCheck(spec)
        self._radio = RadioCheck(spec)
        self._losses = Losses(spec)
        self._inspections: list[Violation] = []
        self.witness = Witness(spec)
        self._node_of_state = {state_id(node): node for node in PE_NODES}
        self._pe_of = dict.fromkeys(PE_NODES, "") | {pe.node_id: pe.name for pe in spec.pes.values()}
        self._pe_of_emcy = {emcy_id(node): pe for node, pe in self._pe_of.items()}
        self._last_commands: dict[int, bytes] = {}
        self._watchers: dict[int, Callable[[Sent], object]] = dict.fromkeys(
            (*STANDARD_DATA_IDS, *ALLOCATED_DATA_IDS), self._datum
        )
        self._watchers |= dict.fromkeys(self._node_of_state, self._state)
        self._watchers |= dict.fromkeys(map(emcy_id, PE_NODES), self._emergency)
        self._watchers |= dict.fromkeys(map(actuator_echo_id, PE_NODES), self._echo)
        self._watchers |= dict.fromkeys(GATEWAY_IDS, self._link)
        self._alive_ids = frozenset(management_id(manager, Command.ALIVE) for manager in MANAGER_NODES)
        self._watchers |= dict.fromkeys(self._alive_ids, self._alive)
        for manager in MANAGER_NODES:
            self._watchers[management_id(manager, Command.TAG)] = self._tagged
            for command in (Command.LEASE, Command.PREPARE, Command.SLICE, Command.ACTIVATE, Command.CONTROL):
                self._watchers[management_id(manager, command)] = partial(self._commanded, manager, command)

    def see(self, sent: Sent) -> None:
        """Take a frame from any bus."""
        watcher = self._watchers.get(sent.frame.can_id)
        if watcher is None:
            return
        if not sent.sender.startswith(STRANGER):
            watcher(sent)
        else:
            self._misled(sent)

    @property
    def reported(self) -> dict[str, int]:
        """Elements that some PE has reported as failed, and when."""
        return self._blame.reported

    def moved(self, moved: Moved) -> None:
        """A PE lets a device move."""
        self._exclusion.moved(moved)

    def driven(self, driven: Driven) -> None:
        """A module was stepped that drives."""
        self._exclusion.driven(driven)
        self._freshness.driven(driven)
        self._safe_mode.driven(driven)

    def looked(self, stepped: Driven) -> None:
        """A module was stepped that does not drive, and somebody has looked at what it was given."""
        self._freshness.driven(stepped)

    def bus_split(self, t_ns: int, bus: str, is_split: bool) -> None:
        """A bus is broken in the middle, or whole again."""
        self._solitude.split(t_ns, bus)
        if bus == self._bus:
            self._terms.split(is_split)
            self.phases.apart()

    def manager_copied(self, station: str, twin: str) -> None:
        """A manager is about to be started once more, elsewhere, with a copy of its journal."""
        self._journals.copied(station, twin)
        self._terms.copied(station, twin)
        self.phases.apart()
        self.may_count_again()

    def may_count_again(self) -> None:
        """From now on a manager may use numbers of commands that were used in its term already."""
        if self.authenticity is not None:
            self.authenticity.may_count_again()

    def altered(self) -> None:
        """Data are changed past the CRC from now on."""
        self._radio.is_altered = True

    def manager_died(self, t_ns: int, station: str) -> None:
        """A manager has died, and left its journal."""
        self._journals.died(t_ns, station)
        self._terms.died(station)

    def declared(self, t_ns: int, element: str) -> None:
        """The operator has declared that an element has failed, and a manager plans without it."""
        self._service.failed(t_ns, element)

    def cleared(self, t_ns: int, element: str, truth: Situation, *, everywhere: bool) -> None:
        """The operator has cleared an element that counted as down by `truth`; not everywhere: one manager knows."""
        self._blame.cleared(element, truth)
        self._service.cleared(t_ns, element, everywhere=everywhere)

    def wrong(self, t_ns: int, story: str) -> None:
        """Who inspects a PE has found something that is not by the book."""
        self._inspections.append(Violation(t_ns, "inspection", story))

    def planned(self, pe: str) -> dict[str, str]:
        """Modules that the epoch activated last lets run on a PE, with their modes."""
        epoch = self._commands.current
        configuration = None if epoch is None else epoch.configuration
        running = {} if configuration is None else configuration.modules
        return {name: one.mode for name, one in running.items() if one.pe == pe}

    def broken(self, truth: Situation, clashes: list[Clash]) -> list[Violation]:
        """Give what must never have been, so far; `clashes` are the buses' own."""
        stories = [
            Violation(c.t_ns, "clash", f"{' and '.join(c.stations)} both wanted to send {c.can_id} on {c.bus}")
            for c in clashes
            if not any(station.startswith(STRANGER) for station in c.stations)
        ]
        blamed = self._blame.violations(truth)
        checks = (
            *(self._exclusion, self._epochs, self._configurations, self._service, self._terms, self._orphans),
            *(self._freshness, self._publishing, self._load, self._radio, self._safe_mode, self.channels),
            *(self._transitions, self._journals, self.phases),
        )
        found = [violation for check in checks for violation in check.violations]
        found += [] if self.authenticity is None else self.authenticity.violations
        return sorted([*found, *blamed, *stories, *self._inspections])

    def unsettled(self, truth: Situation, now_ns: int) -> list[Violation]:
        """Give what must not be once a run has settled."""
        seen = Seen(self._epochs.last, self.witness, self._commands.current, self.phases.told, self._service.held)
        return end_state(self._spec, truth, now_ns, seen)

    @property
    def epoch(self) -> int | None:
        """The epoch that was activated last."""
        return None if self._commands.current is None else self._commands.current.number

    def is_well(self, t_ns: int) -> None:
        """From now on the aircraft is well, and goes on being so: the buses should carry what is planned."""
        self._planned_load.begin(t_ns)

    def unplanned(self, t_ns: int, truth: Situation) -> list[Violation]:
        """Give what was sent since then and is not planned; `truth` is what is really down."""
        return self._planned_load.violations(t_ns, self._commands.current, truth)

    def silences(self, struck: Sequence[Struck], end_ns: int) -> list[Violation]:
        """Give the critical functions that were silent in flight without need, by what was done to the aircraft."""
        return self._service.silences(self.witness.outages(end_ns), struck, end_ns)

    @property
    def settling_ns(self) -> int:
        """How long something critical may be silent after a fault."""
        return self._service.longest_ns

    def liveness_bound_ns(self) -> int:
        """Longest time from now on until all is well, if nothing more is done."""
        return self._losses.bound_ns()

    def _datum(self, sent: Sent) -> None:
        self._exclusion.published(sent)
        self._freshness.published(sent)
        self._publishing.published(sent)
        self._safe_mode.published(sent)
        self._load.published(sent)
        self._radio.published(sent)
        self._planned_load.published(sent)

    def _state(self, sent: Sent) -> None:
        if sent.bus == self._bus:
            self._orphans.state(self._node_of_state[sent.frame.can_id], sent.end_ns, sent.frame.data)
        page = self._epochs.state(sent)
        last = self._epochs.last.get((sent.bus, sent.frame.can_id))
        if last is not None and last.page.state is not PeState.UNCONFIGURED and sent.bus == self._bus:
            self._service.ran(sent.end_ns)
        if page is None:
            return
        node = self._node_of_state[sent.frame.can_id]
        if isinstance(page, StatePage0) and sent.sender == self._pe_of[node]:
            self._solitude.heard(sent.end_ns, sent.bus, sent.sender)
            self._solitude.started(sent.end_ns, sent.sender, page.incarnation)
            self._exclusion.spoke(sent.end_ns, sent.sender)
            self._publishing.state(sent.sender, sent.end_ns, page)
            self._terms.state(sent.bus, node, sent.end_ns, page)
            self._transitions.state(sent.sender, page)
        if sent.bus != self._bus:
            return
        if isinstance(page, StatePage0):
            self._freshness.state(node, sent.end_ns, page)
            self.phases.started(node, page.incarnation)
            self._safe_mode.state(self._pe_of[node], sent.end_ns, page)
        else:
            read = page if self._proven is None else self._proven.read(node, page, self._commands.digests(page))
            self._commands.staged(node, read)

    def _emergency(self, sent: Sent) -> None:
        pe, emergency = self._pe_of_emcy[sent.frame.can_id], decode_emergency(sent.frame.data)
        if sent.bus == self._bus and isinstance(emergency, Emergency) and emergency.kind is ElementKind.PHASE:
            self.phases.requested(self._spec.pes[pe].node_id, emergency)
        if sent.sender == pe:
            self._blame.emergency(sent)
            self._service.told(pe, emergency)
            self.channels.emergency(sent, pe, emergency)
        elif sent.sender in self._spec.pes:
            self._blame.handed_on(sent)

    def _commanded(self, manager: int, command: Command, sent: Sent) -> None:
        identifier, data = sent.frame.can_id, sent.frame.data
        if sent.bus == self._bus:
            self._orphans.commanded(sent.end_ns)
            if command is Command.LEASE:
                self._safe_mode.leased(sent.end_ns)
                self._exclusion.leased(sent.end_ns)
        if sent.bus != self._bus or self._last_commands.get(identifier) == data:
            return
        if command is Command.LEASE:
            self._last_commands[identifier] = data
        message = decode_command(command, data)
        if not isinstance(message, Malformed):
            if self._proven is not None and isinstance(message, Control):
                self._proven.commanded(manager, message)  # a session is opened for whoever believes it
            if not self._terms.commanded(sent.end_ns, manager, message, sent.sender):
                self._commands.take(sent.end_ns, message, reigns=False)
                return
            self._journals.commanded(sent.end_ns, sent.sender, message)
        self._exclusion.commanded(message)
        if isinstance(message, Control):
            self._controlled(sent.end_ns, message)
        elif not isinstance(message, Malformed):
            epoch = self._commands.take(sent.end_ns, message)
            if epoch is not None:
                self._configurations.activated(sent.end_ns, epoch)
                self._service.activated(sent.end_ns, epoch, self.phases.current)
            if isinstance(message, Activate | Lease):
                self._transitions.commanded(sent.end_ns, message)

    def _controlled(self, t_ns: int, message: Control) -> None:
        self._service.acknowledged(t_ns, message)
        self.phases.commanded(t_ns, message)

    def _alive(self, sent: Sent) -> None:
        if sent.bus != self._bus:
            return
        self._orphans.commanded(sent.end_ns)
        message = decode_command(Command.ALIVE, sent.frame.data)
        if isinstance(message, Alive):
            if not self._terms.alive(sent.end_ns, sent.sender, message.term):
                return
            self._solitude.heard(sent.end_ns, sent.bus, sent.sender)
            if message.term > self._term:
                self._term = message.term
                self._service.reigned(sent.end_ns)
            self._losses.alive(sent.end_ns, message)
            self._service.alive(sent.end_ns, self._losses.counted_on)

    def _misled(self, sent: Sent) -> None:
        """A stranger names who is counted on, or speaks for a PE, which with a key nobody believes."""
        can_id = sent.frame.can_id
        nodes: Collection[int] = ()
        if can_id in self._alive_ids:
            message = decode_command(Command.ALIVE, sent.frame.data)
            nodes = message.nodes if isinstance(message, Alive) else ()
        elif can_id in self._node_of_state and self._proven is None:
            nodes = (self._node_of_state[can_id],)
        self._exclusion.misled(sent.end_ns, [self._pe_of[node] for node in nodes])

    def _tagged(self, sent: Sent) -> None:
        if sent.bus == self._bus:
            self._terms.tagged(sent.end_ns, sent.sender)

    def _link(self, sent: Sent) -> None:
        if sent.bus == self._bus:
            self._radio.reported(sent)
            self._service.measured(sent)

    def _echo(self, sent: Sent) -> None:
        if sent.bus == self._bus:
            self.witness.see(sent.end_ns, sent.frame)
