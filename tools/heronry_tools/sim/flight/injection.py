"""Acts carried out: what each kind of fault does to a simulation, and how it is taken back.

What was struck, and when, is kept for who judges the flight (`struck`).

Every act draws from a generator of its own, seeded by the run's seed and the act's text, so that leaving one act out of
a list changes nothing about the others: a failing list can be made shorter.

A strike gives what ends it, or None where nothing was struck (a PE that is dead cannot be paused). What was ended once
is not ended again; what a fault had done to a PE that has died since died with it.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random

from heronry_manager.core.vocabulary import EnterPhase, FailElement
from heronry_tools.sim.faults.fault import KINDS, MANAGERS, WAITS_MS, Act, replicated_bus
from heronry_tools.sim.faults.forger import Forger
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.oracles.service import Struck
from heronry_tools.sim.oracles.waivers import REPORTS, Waiver
from heronry_tools.sim.world.bus import Sent, SimulatedBus
from heronry_tools.sim.world.node import Node
from heronry_tools.sim.world.nodes import SimulatedManager, SimulatedPe
from heronry_tools.sim.world.stranger import Stranger
from heronry_wire.frame import Frame
from heronry_wire.identifiers import MANAGER_NODES, Use, classify, state_id
from heronry_wire.state_frames import PeFlags, PeState, StatePage0

End = Callable[[], None]

_OF_ONE_ELEMENT = ("element", "pe", "gateway", "module", "device", "channel", "twin_pe")
_OF_WHO_COUNTS_AGAIN = frozenset(("silence",))  # whom PEs with a key take for somebody who replays
_INTO_STATE_NS = (0, 100_000, 500_000, 2 * MS)
_DATA = frozenset((Use.STANDARD_DATA, Use.ALLOCATED_DATA))
_COMMANDS = frozenset((Use.MANAGEMENT, Use.STATE))
_BIAS = 40.0
_CORRUPT_SHARE = 0.2
_FORGE_SHARE = 0.02
_PLUGS = ((True, False), (False, True), (True, True), (False, False))  # mute, deaf
_PLUG_HOLDS_MS = (6, 40, 200)  # at most, so or so


class Strikes:
    """Carries out the acts of one run; `hits` counts them by kind and by the state in which they struck."""

    def __init__(self, simulation: Simulation, acts: tuple[Act, ...], start_ns: int) -> None:
        """Schedule the acts, counted from `start_ns`."""
        self.hits: Counter[tuple[str, str]] = Counter()
        self.struck: list[Struck] = []
        self.state_of: dict[Act, str] = {}  # in which each act has struck
        self._simulation = simulation
        self._ends: dict[Act, End] = {}
        self._begun: dict[Act, int] = {}
        self._waivers: dict[Act, Waiver] = {}
        self._healed = False
        for act in acts:
            self._schedule(act, start_ns + act.at_ms * MS)

    def heal(self) -> None:
        """End whatever can be ended; nothing strikes any more."""
        self._healed = True
        for act in list(self._ends):
            self._end(act)
        self._simulation.operator.insist()

    def _schedule(self, act: Act, at_ns: int) -> None:
        simulation = self._simulation
        if not act.during:
            simulation.at(at_ns, lambda: self._strike(act))
            return
        self._wait(act, at_ns, self._random(act))
        simulation.at(at_ns + WAITS_MS * MS, lambda: self._strike(act))

    def _wait(self, act: Act, not_before_ns: int, random: Random) -> None:
        """Strike a moment after its state has begun; where that is over by then, the next time."""
        simulation = self._simulation

        def strike() -> None:
            if simulation.protocol.now == act.during:
                self._strike(act)
            elif act not in self._begun:
                self._wait(act, simulation.now_ns, random)

        delay_ns = random.choice(_INTO_STATE_NS)
        simulation.protocol.when(act.during, not_before_ns, lambda: simulation.at(simulation.now_ns + delay_ns, strike))

    def _strike(self, act: Act) -> None:
        if self._healed or act in self._begun:
            return
        self._begun[act] = self._simulation.now_ns
        state = self._simulation.protocol.now
        end = _DO[act.kind](self._simulation, act, self._random(act))
        if end is None:
            return
        self._simulation.see_who_reigns()
        self.hits[act.kind, state] += 1
        self.state_of[act] = state
        self._waivers[act] = self._simulation.waivers.begin(self._unpromised(act), self._begun[act])
        if act.lasts_ms:
            self._ends[act] = end
            self._simulation.at(self._simulation.now_ns + act.lasts_ms * MS, lambda: self._end(act))
        else:
            self._note(act, None)

    def _end(self, act: Act) -> None:
        end = self._ends.pop(act, None)
        if end is not None:
            end()
            self._simulation.see_who_reigns()
            self._note(act, self._simulation.now_ns)

    def _note(self, act: Act, to_ns: int | None) -> None:
        """Keep what was done for whoever judges the flight; a fault in an instant leaves nothing behind."""
        kind = KINDS[act.kind]
        of_one = kind.strikes in _OF_ONE_ELEMENT and not kind.excuses
        from_ns = self._begun[act]
        if to_ns is None and not kind.for_good:
            to_ns = from_ns
        if not kind.lasting:
            self._waivers[act].to_ns = to_ns
        self.struck.append(Struck(self._element(act) if of_one else None, from_ns, to_ns))

    def _unpromised(self, act: Act) -> frozenset[str]:
        """Rules that nobody can promise while an act is around."""
        kind = KINDS[act.kind]
        if kind.promised_with_key and self._simulation.key is not None:
            return frozenset()
        return kind.unpromised | ({REPORTS} if kind.excuses else frozenset())

    def _element(self, act: Act) -> str:
        """What is as good as down; who has one channel alone is as well served as everybody would be with that one."""
        bus = replicated_bus(self._simulation.spec, act.name) if KINDS[act.kind].strikes == "twin_pe" else None
        return act.target if bus is None else f"channel:{bus}.{act.level}"

    def _random(self, act: Act) -> Random:
        return Random(f"{self._simulation.seed} {act}")


def _nothing() -> None:
    """What ends a fault that needs no end."""


def _crash(simulation: Simulation, act: Act, _: Random) -> End | None:
    if act.name not in simulation.pes:
        return None
    simulation.kill(act.name)
    return lambda: simulation.restore(act.name)


def _brownout(simulation: Simulation, act: Act, random: Random) -> End | None:
    if act.name not in simulation.pes:
        return None
    over = False

    def turn() -> None:
        if over:
            return
        if act.name in simulation.pes:
            simulation.kill(act.name)
        else:
            simulation.restore(act.name)
        simulation.at(simulation.now_ns + random.randint(5, 200) * MS, turn)

    def end() -> None:
        nonlocal over
        over = True
        simulation.restore(act.name)

    turn()
    return end


def _on_pe(do: Callable[[SimulatedPe, Act, Random], End]) -> "_Do":
    """Strike a PE that lives; what ends it is done to that very incarnation."""

    def strike(simulation: Simulation, act: Act, random: Random) -> End | None:
        pe = simulation.pes.get(act.name)
        if pe is None:
            return None
        end = do(pe, act, random)
        return lambda: end() if pe.running else None

    return strike


def _mute(pe: SimulatedPe, _act: Act, _random: Random) -> End:
    pe.wire(mute=True)
    return lambda: pe.wire(mute=False)


def _deaf(pe: SimulatedPe, _act: Act, _random: Random) -> End:
    pe.wire(deaf=True)
    return lambda: pe.wire(deaf=False)


def _loose(simulation: Simulation, node: Node, random: Random) -> End:
    """What one direction does, the other may do a moment later: within a beat, or some beats apart."""
    over = False

    def turn() -> None:
        if not over and node.running:
            mute, deaf = random.choice(_PLUGS)
            node.wire(mute=mute, deaf=deaf)
            simulation.at(simulation.now_ns + random.randint(1, random.choice(_PLUG_HOLDS_MS)) * MS, turn)

    def end() -> None:
        nonlocal over
        over = True
        if node.running:
            node.wire(mute=False, deaf=False)

    turn()
    return end


def _loose_pe(simulation: Simulation, act: Act, random: Random) -> End | None:
    pe = simulation.pes.get(act.name)
    return None if pe is None else _loose(simulation, pe, random)


def _loose_manager(simulation: Simulation, act: Act, random: Random) -> End | None:
    struck = _struck_manager(simulation, act)
    return None if struck is None else _loose(simulation, struck[1], random)


def _cut(simulation: Simulation, act: Act, _: Random) -> End | None:
    if act.name not in simulation.pes:
        return None
    simulation.cut(act.name)
    return lambda: simulation.mend(act.name)


def _half_cut(simulation: Simulation, act: Act, _: Random) -> End | None:
    pe, name = simulation.pes.get(act.name), replicated_bus(simulation.spec, act.name)
    if pe is None or name is None:
        return None
    wire = simulation.wires[name][act.level - 1]
    station = next(station for bus, station in pe.stations if bus is wire)
    wire.wire(station, cut_off=True)
    return lambda: wire.wire(station, cut_off=False) if station.present else None


def _channel_loss(simulation: Simulation, act: Act, _: Random) -> End:
    simulation.break_channel(act.name)
    return lambda: simulation.mend_channel(act.name)


def _pause(pe: SimulatedPe, act: Act, _random: Random) -> End:
    pe.pause(act.lasts_ms * MS)
    return _nothing


def _slow(pe: SimulatedPe, _act: Act, random: Random) -> End:
    pe.slow = random

    def end() -> None:
        pe.slow = None

    return end


def _late(pe: SimulatedPe, act: Act, random: Random) -> End:
    pe.delays = lambda: random.randrange(act.level * MS)

    def end() -> None:
        pe.delays = None

    return end


def _stuck(simulation: Simulation, act: Act, _random: Random) -> End | None:
    pe = simulation.pes.get(act.name)
    if pe is None:
        return None
    pe.stuck = True
    for module in pe.modules:
        simulation.excuse(module)
    return pe.unstick


def _inspect(simulation: Simulation, act: Act, _random: Random) -> End | None:
    if act.name not in simulation.pes:
        return None
    technician = simulation.inspect(act.name)

    def end() -> None:
        if not technician.is_done and act.lasts_ms >= KINDS[act.kind].lasts_ms[0]:
            simulation.checks.wrong(simulation.now_ns, f"{act.name}: the inspection has not come to its end")
        technician.leave()

    return end


def _clock_jump(pe: SimulatedPe, act: Act, _random: Random) -> End:
    pe.jump(act.level * MS)
    return _nothing


def _bus_off(pe: SimulatedPe, _act: Act, _random: Random) -> End:
    for bus, station in pe.stations:
        bus.turn_off(station)
    return _nothing


def _bad_transmitter(pe: SimulatedPe, _act: Act, _random: Random) -> End:
    for _, station in pe.stations:
        station.fails = True

    def end() -> None:
        for _, station in pe.stations:
            station.fails = False

    return end


def _struck_manager(simulation: Simulation, act: Act) -> tuple[int, SimulatedManager] | None:
    """Give the manager that an act means, with its seat, if it runs."""
    node = MANAGERS[act.target]
    reigns = simulation.manager
    for number, one in simulation.managers.items():
        if one.running and (number == node or (node is None and one is reigns)):
            return number, one
    return None


def _manager_dies(simulation: Simulation, act: Act, torn: Random | None) -> End | None:
    struck = _struck_manager(simulation, act)
    if struck is None:
        return None
    seat, manager = struck
    if manager.disk.problem is not None and simulation.key is not None:
        simulation.waivers.begin(_OF_WHO_COUNTS_AGAIN, simulation.now_ns)
    simulation.kill_manager(seat, torn=torn)
    return lambda: simulation.start_manager(seat) if seat > 0 and seat not in simulation.managers else None


def _manager_crash(simulation: Simulation, act: Act, _random: Random) -> End | None:
    return _manager_dies(simulation, act, None)


def _manager_power(simulation: Simulation, act: Act, random: Random) -> End | None:
    return _manager_dies(simulation, act, random)


def _manager_pause(simulation: Simulation, act: Act, _: Random) -> End | None:
    struck = _struck_manager(simulation, act)
    if struck is None:
        return None
    struck[1].pause(act.lasts_ms * MS)
    return _nothing


def _manager_clock_jump(simulation: Simulation, act: Act, _: Random) -> End | None:
    struck = _struck_manager(simulation, act)
    if struck is None:
        return None
    struck[1].jump(act.level * MS)
    return _nothing


def _manager_wire(direction: str) -> "_Do":
    """Break the wires of a manager, in one direction or in both."""

    def strike(simulation: Simulation, act: Act, _: Random) -> End | None:
        struck = _struck_manager(simulation, act)
        if struck is None:
            return None
        manager = struck[1]
        manager.wire(**{direction: True})
        return lambda: manager.wire(**{direction: False}) if manager.running else None

    return strike


def _manager_double(simulation: Simulation, act: Act, _: Random) -> End | None:
    struck = _struck_manager(simulation, act)
    if struck is None or struck[0] < 0 or -struck[0] in simulation.managers:
        return None
    seat, _manager = struck
    simulation.double_manager(seat, standby=act.level == 0)
    return lambda: simulation.kill_manager(-seat)


def _disk_full(simulation: Simulation, act: Act, _: Random) -> End | None:
    struck = _struck_manager(simulation, act)
    if struck is None:
        return None
    disk = struck[1].disk
    disk.refuses = True
    simulation.checks.phases.may_forget()
    simulation.checks.may_count_again()

    def end() -> None:
        disk.refuses = False

    return end


def _stale_table(simulation: Simulation, act: Act, _: Random) -> End | None:
    """A PE is restarted with the table of another spec, and at the end with the right one."""
    if act.name not in simulation.pes:
        return None

    def restart() -> None:
        simulation.kill(act.name)
        simulation.restore(act.name)

    def end() -> None:
        simulation.make_fresh(act.name)
        if act.name in simulation.pes:
            restart()

    simulation.make_stale(act.name)
    restart()
    return end


def _bus_split(simulation: Simulation, act: Act, random: Random) -> End:
    """Break a bus in the middle: the managers are on two sides, and each PE is on one of them."""
    managers = [f"manager {node}" for node in random.sample(MANAGER_NODES, 2)]
    beyond = {managers[0], *(pe for pe in simulation.spec.pes if random.randrange(2))}
    wires, one_way = simulation.wires[act.name], act.level == 1

    def apart(sender: str, receiver: str) -> bool:
        return (sender in beyond) > (receiver in beyond) or (not one_way and (receiver in beyond) > (sender in beyond))

    def end() -> None:
        for wire in wires:
            wire.apart = None
        simulation.checks.bus_split(simulation.now_ns, act.name, False)

    for wire in wires:
        wire.apart = apart
    simulation.checks.bus_split(simulation.now_ns, act.name, True)
    return end


def _share(field: str) -> "_Do":
    """Set one of the probabilities of a bus."""

    def strike(simulation: Simulation, act: Act, _: Random) -> End:
        wires, before = simulation.wires[act.name], getattr(simulation.faults, field)
        for wire in wires:
            wire.faults = replace(wire.faults, **{field: act.level / 1000})

        def end() -> None:
            for wire in wires:
                wire.faults = replace(wire.faults, **{field: before})

        return end

    return strike


def _burst(simulation: Simulation, act: Act, _: Random) -> End:
    wires = simulation.wires[act.name]
    for wire in wires:
        wire.noisy += 1

    def end() -> None:
        for wire in wires:
            wire.noisy -= 1

    return end


def _collapse(simulation: Simulation, act: Act, _: Random) -> End:
    wires = simulation.wires[act.name]
    for wire in wires:
        wire.slowdown = act.level

    def end() -> None:
        for wire in wires:
            wire.slowdown = 1

    return end


def _link(direction: str) -> "_Do":
    """Break the link of every gateway of a far bus, in one direction or in both."""

    def strike(simulation: Simulation, act: Act, _: Random) -> End | None:
        gateways = [pe for pe in simulation.pes.values() if len({bus.name for bus, _ in pe.stations}) > 1]
        wires = [wire for pe in gateways for wire in pe.stations if wire[0].name == act.name]
        for bus, station in wires:
            bus.wire(station, **{direction: True})

        def end() -> None:
            for bus, station in wires:
                bus.wire(station, **{direction: False})

        return end if wires else None

    return strike


def _babble(simulation: Simulation, act: Act, _: Random) -> End:
    return _leaving([Stranger(simulation.clock, w, Frame(act.level, bytes(8))) for w in simulation.wires[act.name]])


def _rogue(simulation: Simulation, act: Act, random: Random) -> End:
    identifier = random.choice(simulation.data_identifiers)
    every_ns = random.randint(1, 20) * MS
    frame, wires = Frame(identifier, bytes(8)), simulation.wires[act.name]
    return _leaving([Stranger(simulation.clock, wire, frame, every_ns) for wire in wires])


def _twin(simulation: Simulation, act: Act, random: Random) -> End | None:
    if act.name not in simulation.pes:
        return None
    pe = simulation.spec.pes[act.name]
    page = StatePage0(PeState.UNCONFIGURED, PeFlags(0), random.randrange(256), 0, 0, 0)
    said = Frame(state_id(pe.node_id), page.encode())
    return _leaving(
        [
            Stranger(simulation.clock, wire, said, simulation.spec.buses[bus].heartbeat_ns)
            for bus in pe.buses
            for wire in simulation.wires[bus]
        ]
    )


def _attack(simulation: Simulation, act: Act, random: Random) -> End:
    return _leaving([Forger(simulation.clock, wire, random) for wire in simulation.wires[act.name]])


def _leaving(uninvited: Sequence[Stranger | Forger]) -> End:
    def leave() -> None:
        for one in uninvited:
            one.leave()

    return leave


def _alter(uses: frozenset[Use], share: float) -> "_Do":
    """Change what is received, one frame in so many."""

    def strike(simulation: Simulation, act: Act, random: Random) -> End:
        wires = simulation.wires[act.name]
        simulation.checks.altered()

        def alter(sent: Sent) -> Frame | None:
            frame = sent.frame
            if not frame.data or classify(frame.can_id).use not in uses or random.random() >= share:
                return None
            data = bytearray(frame.data)
            data[random.randrange(len(data))] ^= random.randint(1, 255)
            return frame._replace(data=bytes(data))

        for wire in wires:
            wire.corrupt = alter
        return lambda: _stop_altering(wires)

    return strike


def _stop_altering(wires: Sequence[SimulatedBus]) -> None:
    for wire in wires:
        wire.corrupt = None


def _module(simulation: Simulation, act: Act, _: Random) -> End:
    simulation.broken_modules[act.name] = act.kind
    simulation.excuse(act.name)

    def end() -> None:
        simulation.broken_modules.pop(act.name, None)

    return end


def _dead(simulation: Simulation, act: Act, _: Random) -> End:
    simulation.fail_device(act.name, "dead")
    return _nothing


def _bias(simulation: Simulation, act: Act, _: Random) -> End:
    simulation.fail_device(act.name, "bias", _BIAS)
    return _nothing


def _order_fail(simulation: Simulation, act: Act, _: Random) -> End | None:
    if act.target in simulation.operator.failed:
        return None
    reply = simulation.operator.say(FailElement(act.target))
    return (lambda: simulation.operator.clear(act.target)) if reply is not None and reply.done else None


def _order_clear(simulation: Simulation, _act: Act, _: Random) -> End | None:
    latched = simulation.operator.latched()
    for element in latched:
        simulation.operator.clear(element)
    return _nothing if latched else None


def _order_phase(simulation: Simulation, act: Act, _: Random) -> End | None:
    reply = simulation.operator.say(EnterPhase(act.name))
    return _nothing if reply is not None and reply.done else None


_Do = Callable[[Simulation, Act, Random], End | None]

_DO: dict[str, _Do] = {
    "crash": _crash,
    "reboot": _crash,
    "brownout": _brownout,
    "mute": _on_pe(_mute),
    "deaf": _on_pe(_deaf),
    "cut": _cut,
    "loose": _loose_pe,
    "half_cut": _half_cut,
    "channel_loss": _channel_loss,
    "pause": _on_pe(_pause),
    "slow": _on_pe(_slow),
    "stuck": _stuck,
    "clock_jump": _on_pe(_clock_jump),
    "bus_off": _on_pe(_bus_off),
    "bad_transmitter": _on_pe(_bad_transmitter),
    "late": _on_pe(_late),
    "inspect": _inspect,
    "manager_crash": _manager_crash,
    "manager_pause": _manager_pause,
    "manager_cut": _manager_wire("cut_off"),
    "manager_mute": _manager_wire("mute"),
    "manager_deaf": _manager_wire("deaf"),
    "manager_loose": _loose_manager,
    "manager_power": _manager_power,
    "manager_clock_jump": _manager_clock_jump,
    "manager_double": _manager_double,
    "disk_full": _disk_full,
    "stale_table": _stale_table,
    "bus_split": _bus_split,
    "loss": _share("loss"),
    "omission": _share("omission"),
    "doubled": _share("doubled"),
    "burst": _burst,
    "collapse": _collapse,
    "link_cut": _link("cut_off"),
    "link_up_only": _link("mute"),
    "link_down_only": _link("deaf"),
    "babble": _babble,
    "rogue": _rogue,
    "twin": _twin,
    "corrupt": _alter(_DATA, _CORRUPT_SHARE),
    "attack": _attack,
    "forge": _alter(_COMMANDS, _FORGE_SHARE),
    "raise": _module,
    "unfit": _module,
    "wrong": _module,
    "overrun": _module,
    "dead": _dead,
    "bias": _bias,
    "order_fail": _order_fail,
    "order_clear": _order_clear,
    "order_phase": _order_phase,
}
