"""Exhaustive flights of a small aircraft: each reconfiguration, with each fault in each of its messages.

A *story* is one event that makes the aircraft reconfigure. There is a story for:

- the start of the aircraft
- the loss, the return and the reboot of each PE
- an exception in each module
- the failure of each sensor
- each PE and each device that the operator declares failed, or clears
- each failed module that the operator clears
- each phase that the operator or a module requests
- with two managers: the death of the active manager

With `tables` the stories are others: a node without a table takes the place of each PE (`blank`), and each PE is
retired and restored by the operator. Then the frames of SDO and the heartbeats of CANopen are numbered, too, and there
is one more frame fault, `cut`.

With `reload` there is one story, `reload`: the operator orders the change to another spec. The frames that are numbered
are those of `tables`, from the order until the next manager has adopted what runs.

Each story is flown once without a further fault. In this flight the management frames (commands, states and EMCY) are
numbered, beginning with 0. The first one comes after the story begins, the last one before the last reconfiguration of
the story is complete. Then the story is flown again for every *frame fault*:

    N lost VICTIM       one node, or every node, does not receive frame N
    N doubled VICTIM    one node, or every node, receives frame N twice
    N late-MS VICTIM    frame N reaches one node's driver, or all drivers, MS milliseconds late, and so perhaps after
                        frames that were sent later
    N crash VICTIM      a node dies when frame N has been received, and is started again
    N death VICTIM      a node dies when frame N has been received (a PE, or the first of two managers)
    N cut VICTIM        with `tables`: a PE is cut off from the bus for 300 ms when frame N has been received

Whatever happens to one message, no oracle may report a violation, and the flight must end in the best configuration.
There are too many pairs of frame faults to fly them all, so some pairs are drawn at random.

A *case* is a story with its frame faults. As text it is STORY: FAULT, FAULT. In this example PE `tail_a` crashes, PE
`flight` does not receive frame 17, and the manager dies when frame 20 has been received:

    crash pe:tail_a: 17 lost pe:flight, 20 crash manager
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from heronry_dg.model import Spec
from heronry_manager.core.vocabulary import RestoreElement, RetireElement
from heronry_manager.events import Adopted, PlanUnchanged, Reconfigured
from heronry_tools.console.errors import UserError
from heronry_tools.sim.faults.fault import EVERYTHING, MANAGER, MANAGERS, Fault, possible_targets
from heronry_tools.sim.flight.end_of_flight import end_flight, ended_by
from heronry_tools.sim.flight.injection.schedule import Injections
from heronry_tools.sim.flight.outcome import KEY
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.service import Injected
from heronry_tools.sim.oracles.violation import MISSED, Violation
from heronry_tools.sim.world.bus import Sent, Tampering
from heronry_tools.sim.world.module_steps import ASKS
from heronry_tools.sim.world.next_spec import next_spec
from heronry_tools.sim.world.node import Node
from heronry_wire.identifiers import FIRST_MANAGER, Use, classify
from heronry_wire.sansio import Received

ALL_NODES = "everybody"
KINDS = ("lost", "doubled", "late-2", "late-30", "crash", "death", "cut")

_SEATS = ("primary", "standby")
_TAKEOVER = "takeover"
_RELOAD = "reload"
_COUNTED = frozenset((Use.MANAGEMENT, Use.STATE, Use.EMCY))
_OF_TABLES = frozenset((Use.SDO_REQUEST, Use.SDO_RESPONSE, Use.HEARTBEAT))
_BROUGHT_NS = 4_000 * MS  # a table is brought, and its PE joins
_CUT_NS = 300 * MS
_MANAGER_BACK_NS = 100 * MS
_PE_BACK_NS = 300 * MS
_AWAY_MS = 1_500  # from the loss of a PE to its return
_LASTS_MS = {"reboot": 3, "blank": _AWAY_MS}
_RAISES_MS = 1_400  # long enough for the PE to give the module up
_BY_THEIR_END = ("return", "clear", "blank")
_DEATHS = ("crash", "death")
_STARTED_NS = 10_000 * MS
_ADMITTED_NS = 60 * MS  # three heartbeat periods
_QUIET_NS = 1_000 * MS  # a story is over when no reconfiguration was completed for so long
_LOOK_NS = 100 * MS
_LONGEST_NS = 4_000 * MS  # longest flight before all faults are ended
_FRAME_FAULT = re.compile(r"(?P<number>\d{1,6}) (?P<kind>[a-z]+(-\d{1,4})?) (?P<victim>\S+)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Setup:
    """How the aircraft is flown.

    foreseen: largest number of faults in a fault set for which a contingency is on board; None: no contingencies are
        made
    keyed: whether managers and PEs have a key
    standby: whether there are two managers
    tables: whether the managers bring tables; then the stories are those of tables and retirement
    reload: file of the spec to which the aircraft changes; then this change is the only story
    """

    foreseen: int | None = None
    keyed: bool = False
    standby: bool = False
    tables: bool = False
    reload: Path | None = None

    def take_off(self, spec: Spec) -> Simulation:
        """Return a new simulation of a spec in which every node is switched on."""
        return Simulation(
            spec,
            contingencies=self.foreseen,
            key=KEY if self.keyed else None,
            standby=self.standby,
            brings_tables=self.tables,
            following=None if self.reload is None else next_spec(self.reload),
        )

    @property
    def counted(self) -> frozenset[Use]:
        """The uses of identifiers whose frames are numbered."""
        return _COUNTED | _OF_TABLES if self.brings_tables else _COUNTED

    @property
    def brings_tables(self) -> bool:
        """Tell whether tables are brought in the stories."""
        return self.tables or self.reload is not None

    def nodes(self, spec: Spec) -> list[str]:
        """Return the nodes into which a frame fault can be injected."""
        return [*(_SEATS if self.standby else (MANAGER,)), *(f"pe:{pe}" for pe in spec.pes)]


PLAIN = Setup()


@dataclass(frozen=True, slots=True, order=True)
class FrameFault:
    """A fault of one management frame, or the death of a node when that frame has been received.

    number: number of the frame; 0 is the first management frame after the story begins.
    """

    number: int
    kind: str
    victim: str  # pe:NAME, manager (of two: primary, standby), or everybody

    def __str__(self) -> str:
        return f"{self.number} {self.kind} {self.victim}"


@dataclass(frozen=True, slots=True)
class Case:
    """One flight: an event that makes the aircraft reconfigure (its story), and faults of frames meanwhile."""

    story: str
    faults: tuple[FrameFault, ...]
    setup: Setup = PLAIN
    named: bool = False  # given by the user: a fault that was not injected is reported

    def __str__(self) -> str:
        return f"{self.story}: {', '.join(map(str, self.faults))}"


def stories(spec: Spec, setup: Setup = PLAIN) -> list[str]:
    """Return the text of every story: of every event that can make this aircraft reconfigure."""
    pes, modules = possible_targets(spec, "crash"), possible_targets(spec, "raise")
    if setup.reload is not None:
        return [_RELOAD]
    if setup.tables:
        return [f"{what} {pe}" for what in ("blank", "retire", "restore") for pe in pes]
    devices = [f"device:{device}" for device in spec.devices]
    there = {
        **dict.fromkeys(("crash", "return", "reboot"), pes),
        "raise": modules,
        "dead": possible_targets(spec, "dead"),
        "fail": [*pes, *devices],
        "clear": [*pes, *devices, *modules],
        "phase": list(spec.phases),
        "request": list(spec.phases),
    }
    told = [f"{what} {target}" for what, targets in there.items() for target in targets]
    return ["start", *told, *([_TAKEOVER] if setup.standby else [])]


def single_cases(spec: Spec, story: str, setup: Setup = PLAIN) -> list[Case]:
    """Return a case for every frame fault in every frame of a story; none if the story causes no reconfiguration."""
    faults = _frame_faults(setup.nodes(spec), _senders(spec, story, setup), has_cuts=setup.brings_tables)
    return [Case(story, (fault,), setup) for fault in faults]


def drawn_pairs(cases: list[Case], count: int, seed: int) -> Iterator[Case]:
    """Yield `count` random cases with two frame faults each, both from `cases` of the same story."""
    random = Random(f"pairs of {seed}")
    by_story: dict[str, list[FrameFault]] = {}
    for case in cases:
        by_story.setdefault(case.story, []).extend(case.faults)
    for _ in range(count if by_story else 0):
        story = random.choice(list(by_story))
        yield Case(story, tuple(sorted(random.sample(by_story[story], 2))), cases[0].setup)


def read_case(spec: Spec, text: str, setup: Setup = PLAIN) -> Case:
    """Read a case from its text; raises UserError if the text is no case of this spec."""
    *told, faults = text.split(": ")
    story = ": ".join(told)
    there = stories(spec, setup)
    if story not in there:
        raise UserError(
            f"'{text}': there is no story '{story}'; write 'STORY: NUMBER KIND VICTIM', where STORY is one of "
            f"{', '.join(there)}"
        )
    victims = [ALL_NODES, *setup.nodes(spec)]
    return Case(story, tuple(_read_frame_fault(victims, fault) for fault in faults.split(", ")), setup, named=True)


def fly_case(spec: Spec, case: Case) -> list[Violation]:
    """Simulate a case, and return its violations."""
    simulation = case.setup.take_off(spec)
    try:
        injections = begin(simulation, case.story)
        injector = _FrameFaultInjector(simulation, case, injections.injected)
        _fly(simulation)
        targets = [case.story.partition(" ")[2] or MANAGER]
        targets += [fault.victim if fault.kind in _DEATHS else ALL_NODES for fault in case.faults]
        violations = end_flight(simulation, injections, targets)
        missed = injector.missed() if case.named else ()
        return violations + [Violation(simulation.now_ns, MISSED, story) for story in missed]
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - an exception of a core, of any type, is a finding
        return ended_by(simulation, error)


def _fly(simulation: Simulation) -> None:
    """Simulate until no rule for the end of a flight is violated.

    This takes `_QUIET_NS` at least, and about `_LONGEST_NS` at most.
    """
    if simulation.reloads is not None:
        simulation.reloads.fly_through()
    begun_ns = simulation.now_ns
    simulation.run_for(_QUIET_NS)
    while simulation.unsettled() and simulation.now_ns - begun_ns < _LONGEST_NS:
        simulation.run_for(_LOOK_NS)


def _read_frame_fault(victims: Sequence[str], text: str) -> FrameFault:
    match = _FRAME_FAULT.fullmatch(text.strip())
    if match is None or match["kind"] not in KINDS:
        raise UserError(
            f"'{text}' is not a fault; write NUMBER KIND VICTIM: NUMBER counts the management frames of the story from "
            f"0; KIND is one of {', '.join(KINDS)}; VICTIM is one of {', '.join(victims)}"
        )
    if match["victim"] not in victims:
        raise UserError(f"'{text}': there is no node '{match['victim']}'; VICTIM is one of {', '.join(victims)}")
    if match["kind"] in _DEATHS and match["victim"] == ALL_NODES:
        raise UserError(f"'{text}': only a single node can crash; name one of {', '.join(victims[1:])}")
    return FrameFault(int(match["number"]), match["kind"], match["victim"])


def _senders(spec: Spec, story: str, setup: Setup) -> list[str]:
    """Return the sender of each management frame of a story, in order, spelt as `FrameFault.victim`."""
    simulation = setup.take_off(spec)
    begin(simulation, story)
    seen: list[Sent] = []
    _tap(simulation, setup, seen.append)
    quiet_ns = _BROUGHT_NS if story.startswith("blank") else _QUIET_NS
    known = len(_done_ns(simulation))
    if simulation.reloads is not None:
        simulation.reloads.fly_through()
    begun_ns = done_ns = simulation.now_ns
    while simulation.now_ns - done_ns < quiet_ns or (story == "start" and not known):
        simulation.run_for(10 * MS)
        done = _done_ns(simulation)
        if len(done) > known:
            known, done_ns = len(done), done[-1]
        if simulation.now_ns > begun_ns + 2 * _STARTED_NS:
            break
    return [_victim(sent.sender, setup) for sent in seen if sent.end_ns <= done_ns]


def _done_ns(simulation: Simulation) -> list[int]:
    """Return when a reconfiguration was complete, or late PEs had certainly been admitted, in ascending order."""
    told = [*simulation.events_of(PlanUnchanged), *simulation.events_of(Adopted)]
    admitted = [event.t_ns + _ADMITTED_NS for event in told]
    return sorted([*admitted, *(event.t_ns for event in simulation.events_of(Reconfigured))])


def _frame_faults(nodes: Sequence[str], senders: list[str], *, has_cuts: bool) -> Iterator[FrameFault]:
    for number, sender in enumerate(senders):
        receivers = [ALL_NODES, *(node for node in nodes if node != sender)]
        yield from (FrameFault(number, kind, victim) for kind in KINDS[:4] for victim in receivers)
        yield from (FrameFault(number, "crash", victim) for victim in nodes)
        yield from (FrameFault(number, "death", victim) for victim in nodes if victim not in (MANAGER, _SEATS[1]))
        yield from (FrameFault(number, "cut", victim) for victim in nodes if has_cuts and victim.startswith("pe:"))


def _faults(story: str) -> tuple[Fault, ...]:
    """Return the faults that cause the event of a story; none for a story that begins without one.

    The event of a story that begins with "return" or "clear" is the end of the fault. Exception: for "clear"
    and a module, the event is the last of the faults, the order of the operator to clear everything.
    """
    what, _, target = story.partition(" ")
    match what:
        case "start" | "request" | "retire" | "restore" | "reload":
            return ()
        case "return":
            return (Fault(0, "crash", target, _AWAY_MS),)
        case "fail":
            return (Fault(0, "order_fail", target),)
        case "clear" if target.startswith("module:"):
            return Fault(0, "raise", target, _RAISES_MS), Fault(_AWAY_MS, "order_clear", EVERYTHING)
        case "clear":
            return (Fault(0, "order_fail", target, _AWAY_MS),)
        case "phase":
            return (Fault(0, "order_phase", f"phase:{target}"),)
        case "takeover":
            return (Fault(0, "manager_crash", MANAGER),)
        case _:
            return (Fault(0, what, target, _LASTS_MS.get(what, 0)),)


def begin(simulation: Simulation, story: str) -> Injections:
    """Simulate up to the event of a story, and return the faults that cause it.

    The event happens as soon as the simulation continues. Raises UserError if the aircraft does not start.
    """
    while story != "start" and (not simulation.events_of(Reconfigured) or simulation.unsettled()):
        simulation.run_for(50 * MS)
        if simulation.now_ns > _STARTED_NS:
            why = next((one.story for one in simulation.unsettled()), "no configuration runs")
            remedy = "'heronry demo SPEC' shows the failures of its modules"
            raise UserError(f"no story can be flown, since this aircraft does not start ({why}); {remedy}")
    injections = Injections(simulation, _faults(story), simulation.now_ns)
    what, _, target = story.partition(" ")
    if what in _BY_THEIR_END:
        simulation.run_for(_AWAY_MS * MS - 1)
    elif what in ("retire", "restore"):
        _retire(simulation, target, is_over=what == "restore")
    elif what == _RELOAD:
        assert simulation.reloads is not None
        simulation.reloads.order()
    elif what == "request":
        running = (module for pe in simulation.spec.pes for module in simulation.checks.planned(pe))
        simulation.fleet.broken_modules[next(running, "")] = f"{ASKS}{target}"
    return injections


def _retire(simulation: Simulation, pe: str, *, is_over: bool) -> None:
    """Let the operator retire a PE as soon as the simulation continues; or retire it now, and restore it then."""
    order = RestoreElement(pe) if is_over else RetireElement(pe)
    if is_over:
        simulation.operator.say(RetireElement(pe))
        simulation.run_for(_QUIET_NS)

    def give() -> None:
        simulation.operator.say(order)

    simulation.at(simulation.now_ns, give)


def _tap(simulation: Simulation, setup: Setup, what: Callable[[Sent], None]) -> None:
    """Call `what` with every frame on the managers' bus that is numbered."""

    def tap(sent: Sent) -> None:
        if classify(sent.frame.can_id).use in setup.counted:
            what(sent)

    simulation.wiring.buses[simulation.spec.manager.bus].taps.append(tap)


def _victim(sender: str, setup: Setup) -> str:
    if not sender.startswith(MANAGER):
        return f"pe:{sender}"
    return next(seat for seat in _SEATS if sender.endswith(str(MANAGERS[seat]))) if setup.standby else MANAGER


class _FrameFaultInjector:
    """Counts the management frames of a flight, and injects each frame fault when the frame with its number comes."""

    def __init__(self, simulation: Simulation, case: Case, injected: list[Injected]) -> None:
        """Begin to count frames, and inject the faults of `case` from now on.

        injected: gets an entry when a fault is injected; the oracle `service` reads this list.
        """
        self._simulation, self._frame_faults, self._injected = simulation, case.faults, injected
        self._counted = case.setup.counted
        self._count = -1
        self._done: set[FrameFault] = set()
        self._bus = simulation.wiring.buses[simulation.spec.manager.bus]
        self._bus.tamper = self._tamper

    def missed(self) -> list[str]:
        """Return sentences on the frame faults that were not injected."""
        why = f"there was no such frame, or the node did not run; {self._count + 1} frames were sent in this flight"
        return [f"'{fault}' was not injected: {why}" for fault in self._frame_faults if fault not in self._done]

    def _tamper(self, sent: Sent) -> Tampering | None:
        """Count the frame `sent` if it is a management frame, and inject each fault whose number is the frame's count.

        No node has received the frame yet. Returns how the bus must deliver the frame; None: as usual.
        """
        if classify(sent.frame.can_id).use not in self._counted:
            return None
        self._count += 1
        tampering = None
        for fault in self._frame_faults:
            if fault.number == self._count:
                tampering = self._inject(fault, sent) or tampering
        return tampering

    def _inject(self, fault: FrameFault, sent: Sent) -> Tampering | None:
        now_ns = self._simulation.now_ns
        if self._nodes(fault.victim) and (fault.kind in _DEATHS or self._station_name(fault.victim) != sent.sender):
            self._done.add(fault)
        if fault.kind == "cut":
            self._simulation.at(now_ns, lambda: self._cut(fault.victim))
            return None
        if fault.kind not in _DEATHS:
            self._injected.append(Injected(None, now_ns, now_ns))
        if fault.kind in ("lost", "doubled"):
            receiver = None if fault.victim == ALL_NODES else self._station_name(fault.victim)
            return Tampering(0 if fault.kind == "lost" else 2, receiver)
        if fault.kind.startswith("late-"):
            delay_ns = int(fault.kind.partition("-")[2]) * MS
            for node in self._nodes(fault.victim):
                self._hold_back(node, delay_ns)
        else:
            self._simulation.at(now_ns, lambda: self._crash(fault))
        return None

    def _nodes(self, victim: str) -> list[Node]:
        managers = self._simulation.managers
        fleet = self._simulation.fleet
        nodes: dict[str, Node] = {f"pe:{pe}": node for pe, node in (*fleet.running.items(), *fleet.blanks.items())}
        names = {FIRST_MANAGER: MANAGER} if not managers.are_two else {MANAGERS[one]: one for one in _SEATS}
        nodes |= {names[seat]: manager for seat, manager in managers.running.items()}
        return list(nodes.values()) if victim == ALL_NODES else [nodes[victim]] if victim in nodes else []

    def _station_name(self, victim: str) -> str:
        """Return the name of a victim's station; empty if the victim is ALL_NODES, or a manager that does not run."""
        if victim == ALL_NODES:
            return ""
        if victim.startswith("pe:"):
            return victim.removeprefix("pe:")
        nodes = self._nodes(victim)
        return nodes[0].stations[0][1].name if nodes else ""

    def _hold_back(self, node: Node, delay_ns: int) -> None:
        """Make a node's driver deliver the next frame of the bus `delay_ns` late."""
        for bus, station in node.stations:
            if bus is self._bus:
                listener, simulation = station.listener, self._simulation

                def hold(event: Received) -> None:
                    station.listener = listener  # noqa: B023 - one station of a node is on the bus
                    simulation.at(simulation.now_ns + delay_ns, lambda: listener(event) if node.running else None)  # noqa: B023

                station.listener = hold

    def _cut(self, victim: str) -> None:
        """Cut a PE off from its buses for a while."""
        simulation, pe, now_ns = self._simulation, victim.removeprefix("pe:"), self._simulation.now_ns
        simulation.fleet.cut(pe)
        self._injected.append(Injected(victim, now_ns, now_ns + _CUT_NS))
        simulation.at(now_ns + _CUT_NS, lambda: simulation.fleet.mend(pe))

    def _crash(self, fault: FrameFault) -> None:
        """Kill the victim of a fault, if it runs; if the kind of the fault is "crash", restart the victim later."""
        simulation, returns = self._simulation, fault.kind == "crash"
        now_ns = simulation.now_ns
        if fault.victim in MANAGERS:
            seat, back_ns = MANAGERS[fault.victim] or FIRST_MANAGER, now_ns + _MANAGER_BACK_NS
            if seat in simulation.managers.running:
                simulation.managers.kill(seat)
                self._injected.append(Injected(None, now_ns, back_ns if returns else now_ns))
                if returns:
                    simulation.at(back_ns, lambda: self._manager_back(seat))
            return
        pe, back_ns = fault.victim.removeprefix("pe:"), now_ns + _PE_BACK_NS
        if pe in simulation.fleet.running or pe in simulation.fleet.blanks:
            simulation.fleet.kill(pe)
            self._injected.append(Injected(fault.victim, now_ns, back_ns if returns else None))
            if returns:
                simulation.at(back_ns, lambda: simulation.fleet.restore(pe))

    def _manager_back(self, seat: int) -> None:
        if seat not in self._simulation.managers.running:
            self._simulation.managers.start(seat)
