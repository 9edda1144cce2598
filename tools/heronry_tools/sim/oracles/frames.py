"""Gives the frames on a flight's buses to the oracles: each identifier is looked up once, each frame decoded once.

Repetitions are left out: a page 0 is passed on only if it differs from the page 0 that the same PE sent before, and a
LEASE only if it differs from the LEASE that the same manager sent before. Three methods of an oracle are exceptions:
`state_sent`, `manager_heard` and `leased` are called for every frame, also for one that repeats the frame before.

`terms` decides which manager is active. If a command comes from another manager, the oracles are told only that it was
sent (`manager_heard`, `leased`); its contents are recorded in `commanded`, as those of a manager that is not active.
Frames of foreign nodes are passed only to the method `misled` of an oracle.
"""

from collections.abc import Callable, Collection
from functools import partial

from heronry_tools.sim.oracles.known import Known
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid, listeners
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.stranger import STRANGER
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
    ManagementMessage,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    decode_command,
    decode_emergency,
    is_newer,
)
from heronry_wire.state_frames import PeState, StatePage0

_HEARD = (
    *(
        "published",
        "state_sent",
        "ran",
        "said",
        "told",
        "emergency",
        "handed_on",
        "requested",
        "wanted_priority",
        "measured",
    ),
    *("manager_heard", "leased", "commanded", "activated", "alive", "began", "misled"),
)
_COMMANDS = (Command.LEASE, Command.PREPARE, Command.SLICE, Command.ACTIVATE, Command.CONTROL)


class FrameWatch:
    """Decodes the frames on all buses of one flight, and calls the methods of the oracles that need them."""

    def __init__(
        self,
        known: Known,
        oracles: Collection[Oracle],
        changes: Callable[[int, int], "FrameWatch"],
        before: "FrameWatch | None" = None,
    ) -> None:
        """Pass frames to these oracles, and keep the facts in `known` up to date.

        changes: is called with the time (ns) and the number of an epoch of the other spec at its first command; returns
        what goes on with that command. before: from which this one goes on.
        """
        self._known, self._bus, self._changes = known, known.spec.manager.bus, changes
        self._of = {hook: listeners(oracles, hook) for hook in _HEARD}
        self._of_data = self._of["published"]
        self._term: int = 0 if before is None else before._term  # the highest term heard
        self._last_lease: tuple[int, bytes] | None = None  # identifier and data
        self._node_of_state = {state_id(node): node for node in PE_NODES}
        self._node_of_emcy = {emcy_id(node): node for node in PE_NODES}
        self._pe_of = dict.fromkeys(PE_NODES, "") | {pe.node_id: pe.name for pe in known.spec.pes.values()}
        self._pe_of_echo = {actuator_echo_id(node): pe for node, pe in self._pe_of.items()}
        self._alive_ids = frozenset(management_id(manager, Command.ALIVE) for manager in MANAGER_NODES)
        self._watchers = self._by_identifier()

    def see(self, sent: Sent) -> None:
        """Decode a frame of any bus, and call the methods of those oracles that need this frame."""
        watcher = self._watchers.get(sent.frame.can_id)
        if watcher is None or sent.frame.extended:
            return
        if not sent.sender.startswith(STRANGER):
            watcher(sent)
        else:
            self._misled(sent)

    def _by_identifier(self) -> dict[int, Callable[[Sent], None]]:
        watchers: dict[int, Callable[[Sent], None]] = {}
        watchers |= dict.fromkeys((*STANDARD_DATA_IDS, *ALLOCATED_DATA_IDS), self._datum)
        watchers |= dict.fromkeys(self._node_of_state, self._state)
        watchers |= dict.fromkeys(self._node_of_emcy, self._emergency)
        watchers |= dict.fromkeys(map(actuator_echo_id, PE_NODES), self._echo)
        watchers |= dict.fromkeys(GATEWAY_IDS, self._link)
        watchers |= dict.fromkeys(self._alive_ids, self._alive)
        for manager in MANAGER_NODES:
            watchers[management_id(manager, Command.TAG)] = self._tagged
            for command in _COMMANDS:
                watchers[management_id(manager, command)] = partial(self._commanded, manager, command)
        return watchers

    def _datum(self, sent: Sent) -> None:
        for oracle in self._of_data:
            oracle.published(sent)

    # What PEs send

    def _state(self, sent: Sent) -> None:
        known, node, is_on_managers_bus = self._known, self._node_of_state[sent.frame.can_id], sent.bus == self._bus
        if is_on_managers_bus:
            for oracle in self._of["state_sent"]:
                oracle.state_sent(sent.end_ns, node, sent.frame.data)
        page = known.epochs.changed_page(sent)
        last = known.epochs.last.get((sent.bus, sent.frame.can_id))
        if last is not None and last.page.state is not PeState.UNCONFIGURED and is_on_managers_bus:
            for oracle in self._of["ran"]:
                oracle.ran(sent.end_ns)
        if isinstance(page, StatePage0):
            self._page_0(sent, StateSaid(sent.end_ns, sent.bus, node, self._pe_of[node], page))
        elif page is not None and is_on_managers_bus:
            read = page if known.proven is None else known.proven.read(node, page, known.commanded.digests(page))
            known.commanded.staged(node, read)
            if known.beside is not None:
                known.beside.staged(node, read)

    def _page_0(self, sent: Sent, state: StateSaid) -> None:
        if sent.sender == state.pe:
            self._known.solitude.heard(state.t_ns, state.bus, state.pe)
            self._known.solitude.started(state.t_ns, state.pe, state.page.incarnation)
            for oracle in self._of["said"]:
                oracle.said(state)
        if state.bus == self._bus:
            for oracle in self._of["told"]:
                oracle.told(state)

    def _is_of_this_spec(self, sent: Sent, node: str) -> bool:
        """Tell whether the indices in a frame that comes from a PE or a manager are those of the present spec."""
        either = self._known.either
        return either is None or either.speaks(sent.end_ns, node, self._known.spec.digest)

    def _emergency(self, sent: Sent) -> None:
        node, emergency = self._node_of_emcy[sent.frame.can_id], decode_emergency(sent.frame.data)
        pe = self._pe_of[node]
        if not self._is_of_this_spec(sent, pe):
            return
        if sent.bus == self._bus and isinstance(emergency, Emergency) and emergency.kind is ElementKind.PHASE:
            for oracle in self._of["requested"]:
                oracle.requested(node, emergency)
        if sent.bus == self._bus and isinstance(emergency, Emergency) and emergency.kind is ElementKind.PRIORITY:
            for oracle in self._of["wanted_priority"]:
                oracle.wanted_priority(emergency)
        if sent.sender == pe:
            for oracle in self._of["emergency"]:
                oracle.emergency(sent, pe, emergency)
        elif sent.sender in self._known.spec.pes:
            for oracle in self._of["handed_on"]:
                oracle.handed_on(sent)

    def _link(self, sent: Sent) -> None:
        if sent.bus == self._bus:
            for oracle in self._of["measured"]:
                oracle.measured(sent)

    def _echo(self, sent: Sent) -> None:
        if sent.bus == self._bus and self._is_of_this_spec(sent, self._pe_of_echo[sent.frame.can_id]):
            self._known.witness.see(sent.end_ns, sent.frame)

    # What managers send

    def _commanded(self, manager: int, command: Command, sent: Sent) -> None:
        if sent.bus != self._bus:
            return
        identifier, data = sent.frame.can_id, sent.frame.data
        for oracle in self._of["manager_heard"]:
            oracle.manager_heard(sent.end_ns)
        if command is Command.LEASE:
            for oracle in self._of["leased"]:
                oracle.leased(sent.end_ns)
            if self._last_lease == (identifier, data):
                return
            self._last_lease = identifier, data
        elif command is Command.ACTIVATE:
            self._last_lease = None  # a manager that has lost its mastership may activate what no PE runs
        message = decode_command(command, data)
        if not isinstance(message, Malformed):
            self._new_command(manager, message, sent)

    def _new_command(self, manager: int, message: ManagementMessage, sent: Sent) -> None:
        known = self._known
        if known.proven is not None and isinstance(message, Control):
            known.proven.commanded(manager, message)  # a WELCOME of any manager opens a session
        is_active = known.terms.follow_command(sent.end_ns, manager, message, sent.sender)
        if known.beside is not None and isinstance(message, Prepare | SliceHead | SliceBody):
            known.beside.take(sent.end_ns, message, is_active=is_active)
        if not is_active:
            known.commanded.take(sent.end_ns, message, is_active=False)
            return
        step = message if isinstance(message, Activate | Lease) else None
        is_other = step is not None and self._is_of_the_other_spec(step)
        if step is not None and is_other and self._is_next(step):
            self._changes(sent.end_ns, step.epoch)._new_command(manager, message, sent)
            return
        epoch = None if is_other else known.commanded.take(sent.end_ns, message)
        if epoch is not None:
            for oracle in self._of["activated"]:
                oracle.activated(sent.end_ns, epoch)
        if isinstance(message, Control) and not self._is_of_this_spec(sent, sent.sender):
            return
        for oracle in self._of["commanded"]:
            oracle.commanded(sent.end_ns, sent.sender, message)

    def _is_of_the_other_spec(self, message: Activate | Lease) -> bool:
        """Tell whether a command takes a step of an epoch of the other spec."""
        beside, current = self._known.beside, self._known.commanded.current
        if beside is None or message.step is Step.PREPARED:
            return False
        if current is not None and (current.number, current.digest) == (message.epoch, message.digest):
            return False
        return beside.fits(message)

    def _is_next(self, message: Activate | Lease) -> bool:
        """Tell whether the PEs change by this command; LEASE may name what its manager remembers from before."""
        current = self._known.commanded.current
        return isinstance(message, Activate) or current is None or is_newer(message.epoch, current.number)

    def _alive(self, sent: Sent) -> None:
        if sent.bus != self._bus:
            return
        for oracle in self._of["manager_heard"]:
            oracle.manager_heard(sent.end_ns)
        message, known = decode_command(Command.ALIVE, sent.frame.data), self._known
        if not isinstance(message, Alive) or not known.terms.follow_alive(sent.end_ns, sent.sender, message.term):
            return
        known.solitude.heard(sent.end_ns, sent.bus, sent.sender)
        if message.term > self._term:
            self._term = message.term
            for oracle in self._of["began"]:
                oracle.began(sent.end_ns)
        known.losses.alive(sent.end_ns, message)
        for oracle in self._of["alive"]:
            oracle.alive(sent.end_ns, known.losses.available)

    def _tagged(self, sent: Sent) -> None:
        if sent.bus == self._bus:
            self._known.terms.tagged(sent.end_ns, sent.sender)

    # What foreign nodes send

    def _misled(self, sent: Sent) -> None:
        """Report a foreign node's ALIVE; without a key, also a state that a foreign node sends in the name of a PE.

        With a key no node believes such a state.
        """
        can_id = sent.frame.can_id
        nodes: Collection[int] = ()
        if can_id in self._alive_ids:
            message = decode_command(Command.ALIVE, sent.frame.data)
            nodes = message.nodes if isinstance(message, Alive) else ()
        elif can_id in self._node_of_state and self._known.proven is None:
            nodes = (self._node_of_state[can_id],)
        for oracle in self._of["misled"]:
            oracle.misled(sent.end_ns, [self._pe_of[node] for node in nodes])
