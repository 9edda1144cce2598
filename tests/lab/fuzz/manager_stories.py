"""Stories for the manager's core: true and false states, plans that come, fail or are late, the operator's orders.

As in `agent_stories`, single bytes encode events, and the invariants are checked after each event. With a key the PEs
tag their states in the sessions that the manager has opened for them.
"""

from functools import cache, partial

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import NOTHING
from heronry_manager.core.vocabulary import (
    AskStatus,
    ClearElement,
    EnterPhase,
    FailElement,
    JournalTold,
    ManagerAction,
    ManagerEvent,
    OperatorSaid,
    Order,
    PlanFailed,
    PlanReady,
    RequestPlan,
    UnlockPe,
)
from heronry_tools.sim.world.planning import immediate_plan
from heronry_wire.authentication import NO_EMERGENCY, Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import (
    FIRST_MANAGER,
    GATEWAY_IDS,
    LAST_MANAGER,
    MANAGER_NODES,
    Command,
    emcy_id,
    management_id,
    state_id,
)
from heronry_wire.management import Control, ElementKind, Emergency, FaultCode, Lease, Prepare, Step, decode_command
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    Reason,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
)
from lab.fuzz.agent_stories import KEY, MOST_EVENTS
from lab.fuzz.target import Story, Target
from lab.peers import PlayedManager, ProvenStates, SteppedCore

_MS = 1_000_000
_MOST_TICKS = 200
_REASONS, _CODES, _KINDS = tuple(Reason), tuple(FaultCode), tuple(ElementKind)
_OTHER_TERM = 9


@cache
def _spec(name: str) -> Spec:
    return load(shipped_spec_path(name))


_PLANS: dict[tuple[object, ...], Plan] = {}


def _plan(spec: Spec, request: RequestPlan) -> Plan:
    """Return the plan of a manager without a solver; each different request is planned once."""
    question = (spec.digest, request.now, None if request.running is None else frozenset(request.running.items()))
    if question not in _PLANS:
        _PLANS[question] = immediate_plan(spec, request.now, request.running)
    return _PLANS[question]


class _Manager(SteppedCore[ManagerEvent, ManagerAction]):
    """One core, its time, and the PEs around it."""

    def __init__(self, name: str, key: Key | None, *, standby: bool) -> None:
        self.spec, node = _spec(name), LAST_MANAGER if standby else FIRST_MANAGER
        super().__init__(ManagerCore(self.spec, node, NOTHING, _MS, key=key, standby=standby), _MS)
        self.core: ManagerCore
        self._node, self._has_key = node, key is not None
        self._other = PlayedManager(FIRST_MANAGER + LAST_MANAGER - node, _OTHER_TERM, key)
        self._nodes = [pe.node_id for pe in self.spec.pes.values()]
        self._requests: list[RequestPlan] = []
        self._prepared = (0, 0)  # epoch and digest of the last PREPARE
        self._states = {one: ProvenStates(one, key or KEY) for one in self._nodes}

    def give(self, event: ManagerEvent | Received | Tick) -> list[ManagerAction]:
        """Process an event at the present time, and note the requests and commands that follow."""
        actions = super().give(event)
        for action in actions:
            if isinstance(action, RequestPlan):
                self._requests.append(action)
            elif isinstance(action, Send):
                self._note(action.frame)
        self.core.validate()
        return actions

    def _note(self, frame: Frame) -> None:
        message = decode_command(frame.can_id - management_id(self._node, Command.LEASE), frame.data)
        if isinstance(message, Prepare):
            self._prepared = (message.epoch, message.digest)
        elif isinstance(message, Control) and message.node in self._states:
            self._states[message.node].take(message, self._node)

    def tell(self, story: Story) -> None:
        """Make the next event of the story happen."""
        node = self._nodes[story.number(256) % len(self._nodes)]
        match story.number(16):
            case 0 | 1:
                self.pass_time(story.number(1 << 16) * 20_000, most_ticks=_MOST_TICKS)
            case 2 | 3 | 4 | 5:
                self._state(node, story)
            case 6 | 7:
                self._staged(node, story)
            case 8:
                self._reports(node, story)
            case 9 | 10 if self._requests:
                self._answer(story)
            case 11:
                self.give(OperatorSaid(1, self._order(story)))
            case 12:
                self._other_manager(node, story)
            case 13:
                drawn = story.number(1 << 16)
                nonce = KEY.nonce(node, drawn) if drawn % 2 else drawn
                self.hear(Frame(state_id(node), StatePage2(PeState.ACTIVE, PeFlags(0), nonce).encode()))
            case 14:
                self.give(JournalTold("the disk is full" if story.number(2) else None))
            case _:
                self.hear(Frame(self._known_id(story), story.bytes(story.number(9))))

    def _known_id(self, story: Story) -> int:
        node = self._nodes[story.number(256) % len(self._nodes)]
        commands = [management_id(manager, command) for manager in MANAGER_NODES for command in Command]
        known: list[int] = [state_id(node), emcy_id(node), *GATEWAY_IDS, 128, 300, *commands]
        return known[story.number(256) % len(known)]

    def _say(self, node: int, page: StatePage0 | StatePage1, emergency: bytes = NO_EMERGENCY) -> None:
        """Send page 0 or 1, with a key tagged."""
        states = self._states[node]
        if not self._has_key:
            states.beat += isinstance(page, StatePage0)
            self.hear(Frame(state_id(node), page.encode()))
        else:
            self.hear(states.prove(page, emergency))

    def _state(self, node: int, story: Story) -> None:
        """Send a page 0: of a PE that runs nothing, or that runs what was prepared last, or an arbitrary one."""
        choice, state = story.number(8), PeState(story.number(4))
        epoch, digest = ((0, 0), self._prepared, self._prepared, (story.number(5), 7))[choice % 4]
        if not epoch:
            state, digest = PeState.UNCONFIGURED, 0
        flags = PeFlags.HEARS_LEASE if choice < 7 else PeFlags(0)
        beat = self._states[node].beat
        self._say(node, StatePage0(state, flags, int(story.number(32) == 1), epoch, beat % 256, digest))
        if choice == 6:
            self.hear(Frame(state_id(node), StatePage3(state, flags, digest, story.number(9), 1).encode()))

    def _staged(self, node: int, story: Story) -> None:
        reason = _REASONS[story.number(256) % len(_REASONS)]
        epoch, digest = self._prepared if story.number(8) else (story.number(5), 7)
        load = story.number(256)
        self._say(node, StatePage1(PeState.UNCONFIGURED, PeFlags.HEARS_LEASE, epoch, digest, reason, load))

    def _reports(self, node: int, story: Story) -> None:
        """Send an EMCY, and with a key the page 0 that proves it."""
        code, kind = _CODES[story.number(256) % len(_CODES)], _KINDS[story.number(256) % len(_KINDS)]
        emergency = Emergency(code, 0x81, kind, story.number(8), story.number(1 << 16)).encode()
        self.hear(Frame(emcy_id(node), emergency))
        flags = PeFlags.HEARS_LEASE | PeFlags.FAULT_PENDING
        if self._has_key:
            self._say(node, StatePage0(PeState.UNCONFIGURED, flags, 0, 0, 0, 0), emergency)

    def _answer(self, story: Story) -> None:
        """Let the planner answer the last request, or an older one, or fail."""
        request = self._requests[-1] if story.number(8) else self._requests[0]
        if story.number(8) == 1:
            self.give(PlanFailed(request.request, "no time"))
        else:
            self.give(PlanReady(request.request, _plan(self.spec, request)))

    def _order(self, story: Story) -> Order:
        names = (*elements(self.spec), "pe:nobody", "nonsense")
        element = names[story.number(256) % len(names)]
        phases = (*self.spec.phases, "nowhere")
        orders: tuple[Order, ...] = (
            AskStatus(),
            FailElement(element),
            ClearElement(element),
            UnlockPe(element),
            EnterPhase(phases[story.number(256) % len(phases)]),
        )
        return orders[story.number(256) % len(orders)]

    def _other_manager(self, node: int, story: Story) -> None:
        """Let the other manager send, with a higher term or a lower one; with a key it has welcomed a PE before."""
        other, states = self._other, self._states[node]
        if self._has_key:
            self.hear(other.welcome(node, 5)[0])
            states.session, states.beat = other.session, 0
        is_higher = story.number(2) == 1
        term = _OTHER_TERM if is_higher or self._has_key else 1
        self.hear(*other.frames(Lease(term, story.number(4), Step(story.number(4)), 7)))


def _manager(name: str, key: Key | None, standby: bool, data: bytes) -> None:
    """Tell a story to a manager."""
    one, story = _Manager(name, key, standby=standby), Story(data)
    for _ in range(MOST_EVENTS):
        if not story:
            break
        one.tell(story)


def _mastership(pes: int) -> list[bytes]:
    """Return a story in which all PEs are heard, a plan is made and deployed, and a PE falls silent."""
    every = range(pes)
    listens, beat = bytes((0, 0, 0x20, 0)), bytes((0, 0, 4, 0))
    asks = b"".join(bytes((pe, 13, 0, 7)) for pe in every)
    lives = b"".join(bytes((pe, 2, 0, 0, 0, 0)) for pe in every)
    staged = b"".join(bytes((pe, 6, 0, 1, 0)) for pe in every)
    active = b"".join(bytes((pe, 2, 1, 3, 0, 0)) for pe in every)
    lost = bytes((0, 0, 16, 0))
    planned = bytes((0, 9, 1, 0))
    return [
        listens + asks + lives + beat + planned + staged + active + beat + active + lost + planned + staged + active
    ]


def _rival(pes: int) -> list[bytes]:
    """Return a story in which another manager is active, and falls silent."""
    listens = bytes((0, 0, 1, 0))
    speaks = b"".join(bytes((pe, 12, 1, 0, 0)) for pe in range(pes))
    receive_failed = b"".join(bytes((pe, 2, 7, 0, 0, 0)) for pe in range(pes))
    return [listens + speaks + (bytes((0, 0, 4, 0)) + receive_failed) * 12]


STORIES = (
    Target("manager", partial(_manager, "elevator_and_chute", None, False), partial(_mastership, 3)),
    Target("keyed_manager", partial(_manager, "elevator_and_chute", KEY, False), partial(_mastership, 3)),
    Target("standby", partial(_manager, "elevator_and_chute", None, True), partial(_rival, 3)),
    Target("keyed_standby", partial(_manager, "elevator_and_chute", KEY, True), partial(_rival, 3)),
    Target("radio_manager", partial(_manager, "big_blue", None, False), partial(_mastership, 9)),
)
