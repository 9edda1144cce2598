"""Every reconfiguration of a small aircraft, with every message of it struck in every way: exhaustive, not drawn.

A *story* is what makes the aircraft reconfigure: its start, each PE's loss, return and reboot, each module that raises,
each sensor that dies, each PE and device that the operator fails, and clears again, each module that he clears after it
has failed, each phase, by his word or as a module asks for it, and, where there are two managers, the death of the one
that reigns. It is flown once undisturbed, and the frames of the management are counted, from the first one after the
story begins to the last one before its last reconfiguration is done. Then it is flown again for every *blow*:

    N lost VICTIM       the N-th frame is not received, by one node or by nobody
    N doubled VICTIM    ... or is received twice
    N late-MS VICTIM    ... or that much later, behind what was sent after it: by a driver, or by everybody
    N crash VICTIM      once it has been received the node dies, and is started again
    N death VICTIM      ... or is not (a PE; of two managers the first one)

Whatever becomes of a single message, all of the simulator's judges must be content, and the end must be the best one.
Two blows in one flight are far too many to be flown all; they are drawn.

As text a case is STORY: BLOW, BLOW    for example    crash pe:tail_a: 17 lost pe:flight, 20 crash manager
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from random import Random

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.sim.faults.fault import EVERYTHING, MANAGER, MANAGERS, Fault, possible_targets
from heronry_tools.sim.flight.end_of_flight import end_flight, ended_by
from heronry_tools.sim.flight.injections import Injections
from heronry_tools.sim.flight.outcome import KEY
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.service import Injected
from heronry_tools.sim.oracles.violation import MISSED, Violation
from heronry_tools.sim.world.bus import Sent, Tampering
from heronry_tools.sim.world.module_steps import ASKS
from heronry_tools.sim.world.node import Node
from heronry_wire.identifiers import FIRST_MANAGER, Use, classify
from heronry_wire.sansio import Received

EVERYBODY = "everybody"
KINDS = ("lost", "doubled", "late-2", "late-30", "crash", "death")

_SEATS = ("primary", "standby")
_TAKEOVER = "takeover"
_COUNTED = frozenset((Use.MANAGEMENT, Use.STATE, Use.EMCY))
_MANAGER_BACK_NS = 100 * MS
_PE_BACK_NS = 300 * MS
_AWAY_MS = 1_500  # before it returns
_REBOOT_MS = 3
_RAISES_MS = 1_400  # for long enough to be given up
_BY_THEIR_END = ("return", "clear")
_DEATHS = ("crash", "death")
_STARTED_NS = 10_000 * MS
_ADMITTED_NS = 60 * MS  # three beats
_QUIET_NS = 1_000 * MS  # without another end: the story is over
_LOOK_NS = 100 * MS
_LONGEST_NS = 4_000 * MS  # a flight, before everything is brought to its end
_BLOW = re.compile(r"(?P<number>\d{1,6}) (?P<kind>[a-z]+(-\d{1,4})?) (?P<victim>\S+)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Setup:
    """How the aircraft is flown: plans on board for so many faults (None: no plans), a key, two managers."""

    foreseen: int | None = None
    keyed: bool = False
    standby: bool = False

    def take_off(self, spec: Spec) -> Simulation:
        """Switch it on."""
        return Simulation(spec, contingencies=self.foreseen, key=KEY if self.keyed else None, standby=self.standby)

    def nodes(self, spec: Spec) -> list[str]:
        """Who may be struck."""
        return [*(_SEATS if self.standby else (MANAGER,)), *(f"pe:{pe}" for pe in spec.pes)]


PLAIN = Setup()


@dataclass(frozen=True, slots=True, order=True)
class Blow:
    """What happens to one frame, or with it."""

    number: int
    kind: str
    victim: str  # pe:NAME, manager (of two: primary, standby), or everybody

    def __str__(self) -> str:
        return f"{self.number} {self.kind} {self.victim}"


@dataclass(frozen=True, slots=True)
class Case:
    """One flight."""

    story: str
    blows: tuple[Blow, ...]
    setup: Setup = PLAIN
    named: bool = False  # by somebody, who is told what of it has not happened

    def __str__(self) -> str:
        return f"{self.story}: {', '.join(map(str, self.blows))}"


def stories(spec: Spec, setup: Setup = PLAIN) -> list[str]:
    """Everything that may make an aircraft reconfigure."""
    pes, modules = possible_targets(spec, "crash"), possible_targets(spec, "raise")
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
    """Every blow to every frame of a story, one at a time; none where nothing is reconfigured."""
    return [Case(story, (blow,), setup) for blow in _blows(setup.nodes(spec), _senders(spec, story, setup))]


def drawn_pairs(cases: list[Case], count: int, seed: int) -> Iterator[Case]:
    """Draw that many pairs of blows from those of one story each."""
    random = Random(f"pairs of {seed}")
    by_story: dict[str, list[Blow]] = {}
    for case in cases:
        by_story.setdefault(case.story, []).extend(case.blows)
    for _ in range(count if by_story else 0):
        story = random.choice(list(by_story))
        yield Case(story, tuple(sorted(random.sample(by_story[story], 2))), cases[0].setup)


def read_case(spec: Spec, text: str, setup: Setup = PLAIN) -> Case:
    """Read a case; raises UserError."""
    *told, blows = text.split(": ")
    story = ": ".join(told)
    there = stories(spec, setup)
    if story not in there:
        raise UserError(f"'{text}': there is no story '{story}'; there is {', '.join(there)}")
    victims = [EVERYBODY, *setup.nodes(spec)]
    return Case(story, tuple(_read_blow(victims, blow) for blow in blows.split(", ")), setup, named=True)


def fly_case(spec: Spec, case: Case) -> list[Violation]:
    """Fly a case; gives what must not be."""
    simulation = case.setup.take_off(spec)
    try:
        injections = begin(simulation, case.story)
        assailant = _Assailant(simulation, case.blows, injections.injected)
        _fly(simulation)
        targets = [case.story.partition(" ")[2] or MANAGER]
        targets += [blow.victim if blow.kind in _DEATHS else EVERYBODY for blow in case.blows]
        violations = end_flight(simulation, injections, targets)
        missed = assailant.missed() if case.named else ()
        return violations + [Violation(simulation.now_ns, MISSED, story) for story in missed]
    except UserError:
        raise
    except Exception as error:  # noqa: BLE001 - whatever a core dies of is what is looked for
        return ended_by(simulation, error)


def _fly(simulation: Simulation) -> None:
    """Fly until all is well, or for longer than anything critical may be silent."""
    begun_ns = simulation.now_ns
    simulation.run_for(_QUIET_NS)
    while simulation.unsettled() and simulation.now_ns - begun_ns < _LONGEST_NS:
        simulation.run_for(_LOOK_NS)


def _read_blow(victims: Sequence[str], text: str) -> Blow:
    match = _BLOW.fullmatch(text.strip())
    if match is None or match["kind"] not in KINDS:
        raise UserError(f"'{text}' is no blow; write NUMBER KIND VICTIM, with one of {', '.join(KINDS)}")
    if match["victim"] not in victims:
        raise UserError(f"'{text}': there is no '{match['victim']}'; there is {', '.join(victims)}")
    if match["kind"] in _DEATHS and match["victim"] == EVERYBODY:
        raise UserError(f"'{text}': one node dies at a time; name it: {', '.join(victims[1:])}")
    return Blow(int(match["number"]), match["kind"], match["victim"])


def _senders(spec: Spec, story: str, setup: Setup) -> list[str]:
    """Who sends the frames of a story, in order, as victims are called."""
    simulation = setup.take_off(spec)
    begin(simulation, story)
    seen: list[Sent] = []
    _tap(simulation, seen.append)
    known = len(_done_ns(simulation))
    done_ns = simulation.now_ns
    while simulation.now_ns - done_ns < _QUIET_NS or (story == "start" and not known):
        simulation.run_for(10 * MS)
        done = _done_ns(simulation)
        if len(done) > known:
            known, done_ns = len(done), done[-1]
        if simulation.now_ns > 2 * _STARTED_NS:
            break
    return [_victim(sent.sender, setup) for sent in seen if sent.end_ns <= done_ns]


def _done_ns(simulation: Simulation) -> list[int]:
    """When something came to its end: a reconfiguration, or that a PE is admitted to what runs already."""
    told = [event for kind in ("plan_unchanged", "adopted") for event in simulation.events_of(kind)]
    admitted = [event["t_ns"] + _ADMITTED_NS for event in told]
    return sorted([*admitted, *(event["t_ns"] for event in simulation.events_of("reconfigured"))])


def _blows(nodes: Sequence[str], senders: list[str]) -> Iterator[Blow]:
    for number, sender in enumerate(senders):
        receivers = [EVERYBODY, *(node for node in nodes if node != sender)]
        yield from (Blow(number, kind, victim) for kind in KINDS[:4] for victim in receivers)
        yield from (Blow(number, "crash", victim) for victim in nodes)
        yield from (Blow(number, "death", victim) for victim in nodes if victim not in (MANAGER, _SEATS[1]))


def _faults(story: str) -> tuple[Fault, ...]:
    """Give what makes the aircraft reconfigure; of some (_BY_THEIR_END) it is the end that does."""
    what, _, target = story.partition(" ")
    match what:
        case "start" | "request":
            return ()
        case "return":
            return (Fault(0, "crash", target, _AWAY_MS),)
        case "fail":
            return (Fault(0, "order_fail", target),)
        case "clear" if target.startswith("module:"):
            return Fault(0, "raise", target, _RAISES_MS), Fault(_AWAY_MS, "order_clear", EVERYTHING)
        case "clear":
            return (Fault(0, "order_fail", target, _AWAY_MS),)
        case "reboot":
            return (Fault(0, what, target, _REBOOT_MS),)
        case "phase":
            return (Fault(0, "order_phase", f"phase:{target}"),)
        case "takeover":
            return (Fault(0, "manager_crash", MANAGER),)
        case _:
            return (Fault(0, what, target),)


def begin(simulation: Simulation, story: str) -> Injections:
    """Fly to where a story begins, and let it begin as soon as time goes on."""
    while story != "start" and (not simulation.events_of("reconfigured") or simulation.unsettled()):
        simulation.run_for(50 * MS)
        if simulation.now_ns > _STARTED_NS:
            raise UserError(f"nothing can be told of this aircraft: it does not start ({simulation.unsettled()[0]})")
    injections = Injections(simulation, _faults(story), simulation.now_ns)
    what, _, target = story.partition(" ")
    if what in _BY_THEIR_END:
        simulation.run_for(_AWAY_MS * MS - 1)
    elif what == "request":
        running = (module for pe in simulation.spec.pes for module in simulation.checks.planned(pe))
        simulation.fleet.broken_modules[next(running, "")] = f"{ASKS}{target}"
    return injections


def _tap(simulation: Simulation, what: Callable[[Sent], None]) -> None:
    """Let something be done with every frame of the management on the managers' bus."""

    def tap(sent: Sent) -> None:
        if classify(sent.frame.can_id).use in _COUNTED:
            what(sent)

    simulation.wiring.buses[simulation.spec.manager.bus].taps.append(tap)


def _victim(sender: str, setup: Setup) -> str:
    if not sender.startswith(MANAGER):
        return f"pe:{sender}"
    return next(seat for seat in _SEATS if sender.endswith(str(MANAGERS[seat]))) if setup.standby else MANAGER


class _Assailant:
    """Counts the frames of a flight, and strikes."""

    def __init__(self, simulation: Simulation, blows: tuple[Blow, ...], injected: list[Injected]) -> None:
        """Note in `struck` what is done, for who judges silences."""
        self._simulation, self._blows, self._injected = simulation, blows, injected
        self._count = -1
        self._landed: set[Blow] = set()
        self._bus = simulation.wiring.buses[simulation.spec.manager.bus]
        self._bus.tamper = self._tamper

    def missed(self) -> list[str]:
        """Say which blows have struck nobody."""
        why = f"there was no such frame, or nobody to strike with it; {self._count + 1} were sent in this flight"
        return [f"'{blow}' did not strike: {why}" for blow in self._blows if blow not in self._landed]

    def _tamper(self, sent: Sent) -> Tampering | None:
        """Say what becomes of a frame that has just been sent, and nobody has received yet."""
        if classify(sent.frame.can_id).use not in _COUNTED:
            return None
        self._count += 1
        tampering = None
        for blow in self._blows:
            if blow.number == self._count:
                tampering = self._inject(blow, sent) or tampering
        return tampering

    def _inject(self, blow: Blow, sent: Sent) -> Tampering | None:
        now_ns = self._simulation.now_ns
        if self._nodes(blow.victim) and (blow.kind in _DEATHS or self._station_name(blow.victim) != sent.sender):
            self._landed.add(blow)
        if blow.kind not in _DEATHS:
            self._injected.append(Injected(None, now_ns, now_ns))
        if blow.kind in ("lost", "doubled"):
            receiver = None if blow.victim == EVERYBODY else self._station_name(blow.victim)
            return Tampering(0 if blow.kind == "lost" else 2, receiver)
        if blow.kind.startswith("late-"):
            delay_ns = int(blow.kind.partition("-")[2]) * MS
            for node in self._nodes(blow.victim):
                self._hold_back(node, delay_ns)
        else:
            self._simulation.at(now_ns, lambda: self._crash(blow))
        return None

    def _nodes(self, victim: str) -> list[Node]:
        managers = self._simulation.managers
        nodes: dict[str, Node] = {f"pe:{pe}": node for pe, node in self._simulation.fleet.running.items()}
        names = {FIRST_MANAGER: MANAGER} if not managers.are_two else {MANAGERS[one]: one for one in _SEATS}
        nodes |= {names[seat]: manager for seat, manager in managers.running.items()}
        return list(nodes.values()) if victim == EVERYBODY else [nodes[victim]] if victim in nodes else []

    def _station_name(self, victim: str) -> str:
        """Name of a victim's station; empty where it does not run, or is everybody."""
        if victim == EVERYBODY:
            return ""
        if victim.startswith("pe:"):
            return victim.removeprefix("pe:")
        nodes = self._nodes(victim)
        return nodes[0].stations[0][1].name if nodes else ""

    def _hold_back(self, node: Node, delay_ns: int) -> None:
        """Let a node's driver hand over the next frame of the bus late."""
        for bus, station in node.stations:
            if bus is self._bus:
                listener, simulation = station.listener, self._simulation

                def hold(event: Received) -> None:
                    station.listener = listener  # noqa: B023 - one station of a node is on the bus
                    simulation.at(simulation.now_ns + delay_ns, lambda: listener(event) if node.running else None)  # noqa: B023

                station.listener = hold

    def _crash(self, blow: Blow) -> None:
        """Let a node die, and come back; of two managers the death of one is an instant: the other one reigns."""
        simulation, returns = self._simulation, blow.kind == "crash"
        now_ns = simulation.now_ns
        if blow.victim in MANAGERS:
            seat, back_ns = MANAGERS[blow.victim] or FIRST_MANAGER, now_ns + _MANAGER_BACK_NS
            if seat in simulation.managers.running:
                simulation.managers.kill(seat)
                self._injected.append(Injected(None, now_ns, back_ns if returns else now_ns))
                if returns:
                    simulation.at(back_ns, lambda: self._manager_back(seat))
            return
        pe, back_ns = blow.victim.removeprefix("pe:"), now_ns + _PE_BACK_NS
        if pe in simulation.fleet.running:
            simulation.fleet.kill(pe)
            self._injected.append(Injected(blow.victim, now_ns, back_ns if returns else None))
            if returns:
                simulation.at(back_ns, lambda: simulation.fleet.restore(pe))

    def _manager_back(self, seat: int) -> None:
        if seat not in self._simulation.managers.running:
            self._simulation.managers.start(seat)
