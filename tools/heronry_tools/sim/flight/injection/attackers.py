"""Injects foreign nodes on a bus (babbling nodes, twins, attackers), and alters frames so that the CRC stays right."""

from collections.abc import Sequence
from random import Random

from heronry_tools.sim.faults.denial import DENIALS, Denier
from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.faults.forger import Forger
from heronry_tools.sim.flight.injection.inject import End, Inject
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.stranger import Stranger
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Use, classify, state_id
from heronry_wire.state_frames import PeFlags, PeState, StatePage0

_DATA = frozenset((Use.STANDARD_DATA, Use.ALLOCATED_DATA, Use.CHECKPOINT))
_COMMANDS = frozenset((Use.MANAGEMENT, Use.STATE))
_CORRUPT_SHARE = 0.2
_FORGE_SHARE = 0.02


def _babble(simulation: Simulation, fault: Fault, _: Random) -> End:
    wires = simulation.wiring.wires[fault.name]
    return _leaving([Stranger(simulation.clock, wire, Frame(fault.level, bytes(8))) for wire in wires])


def _rogue(simulation: Simulation, fault: Fault, random: Random) -> End:
    identifier = random.choice(simulation.fleet.data_identifiers)
    every_ns = random.randint(1, 20) * MS
    frame, wires = Frame(identifier, bytes(8)), simulation.wiring.wires[fault.name]
    return _leaving([Stranger(simulation.clock, wire, frame, every_ns) for wire in wires])


def _twin(simulation: Simulation, fault: Fault, random: Random) -> End | None:
    if fault.name not in simulation.fleet.running:
        return None
    pe = simulation.spec.pes[fault.name]
    page = StatePage0(PeState.UNCONFIGURED, PeFlags(0), random.randrange(256), 0, 0, 0)
    said = Frame(state_id(pe.node_id), page.encode())
    return _leaving(
        [
            Stranger(simulation.clock, wire, said, simulation.spec.buses[bus].heartbeat_ns)
            for bus in pe.buses
            for wire in simulation.wiring.wires[bus]
        ]
    )


def _attack(simulation: Simulation, fault: Fault, random: Random) -> End:
    return _leaving([Forger(simulation.clock, wire, random) for wire in simulation.wiring.wires[fault.name]])


def _deny(simulation: Simulation, fault: Fault, random: Random) -> End:
    wires = simulation.wiring.wires[fault.name]
    clock, spec = simulation.clock, simulation.spec
    return _leaving(
        [Denier(clock, one, random, spec=spec, kind=fault.kind, share_percent=fault.level) for one in wires]
    )


def _leaving(uninvited: Sequence[Stranger | Forger | Denier]) -> End:
    def leave() -> None:
        for one in uninvited:
            one.leave()

    return leave


def _alter(uses: frozenset[Use], share: float) -> Inject:
    """Return an injection that alters one byte in a share of the frames that are received on the bus of the fault.

    uses: only frames of these uses (data or commands) are altered. share: from 0 to 1.
    """

    def inject(simulation: Simulation, fault: Fault, random: Random) -> End:
        wires = simulation.wiring.wires[fault.name]
        simulation.checks.altered()

        def alter(sent: Sent) -> Frame | None:
            frame = sent.frame
            if not frame.data or classify(frame.can_id).use not in uses or random.random() >= share:
                return None
            data = bytearray(frame.data)
            data[random.randrange(len(data))] ^= random.randint(1, 255)
            return frame._replace(data=bytes(data))

        def end() -> None:
            for wire in wires:
                wire.corrupt = None

        for wire in wires:
            wire.corrupt = alter
        return end

    return inject


BY_ATTACKERS: dict[str, Inject] = {
    "babble": _babble,
    "rogue": _rogue,
    "twin": _twin,
    "attack": _attack,
    **dict.fromkeys(DENIALS, _deny),
    "corrupt": _alter(_DATA, _CORRUPT_SHARE),
    "forge": _alter(_COMMANDS, _FORGE_SHARE),
}
