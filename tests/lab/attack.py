"""Attacks on a PE with a key: a great many commands that a true manager did not send, and what the PE does with each.

    forged      bytes and a tag made up without the key, or a true pair with bits changed
    replayed    a true command and its TAG, sent before
    reordered   a true command that arrives after a later one
    truncated   a true command cut short, with its TAG
    foreign     a command tagged with the key of another fleet

The PE is the core that flies. A true manager commands it between the attacks, and the PE must accept these commands,
since a PE that accepts no command would pass every attack. After every attack everything that a command could change is
compared with its value before (`_Watch`): what the PE does and sends, not what its verifier of tags concludes.

    python -m lab.attack --count 1000000 --seed 1

Acceptance is not all that an attacker may want. With --denial every kind of forger of the simulator (`denial`) is on
the bus for so many seconds, at 1, 3 and 9 per cent of it, and the program prints the longest silence of any function,
beside that of a flight without a forger, and how many sessions ended.

    python -m lab.attack demux_actuators.dg.yaml --count 1000 --denial 10

`lab.denial` does the same to real processes on the software bus.

The program also prints the cost of the tags: the share of each bus that commands take, without and with a key.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from random import Random

from heronry_agent.core.agent import AgentCore
from heronry_agent.core.authority import Secret
from heronry_agent.core.vocabulary import Action, Event
from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.tables import Compiler
from heronry_tools.console.errors import exit_code
from heronry_tools.console.progress import Progress
from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.faults.denial import DENIALS, Denier
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.stranger import STRANGER
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER, Command, Use, classify, management_id
from heronry_wire.management import (
    Activate,
    Alive,
    Control,
    Lease,
    Operation,
    Ping,
    Prepare,
    SliceBody,
    SliceHead,
    Step,
    decode_command,
)
from heronry_wire.sansio import Send
from heronry_wire.state_frames import StatePage2, decode_state
from heronry_wire.timing import exact_bits
from lab.peers import PlayedManager, SteppedCore
from lab.silences import Silences

_MS = 1_000_000
_NS_PER_S = 1_000_000_000
_TERM = 3
_LED_EVERY = 64  # attacks between two beats of the true manager
_REMEMBERED = 4096
_BEAT_NS = 101 * _MS  # longer than a command waits for its TAG
_COMMANDS = tuple(command for command in Command if command is not Command.TAG)
_SETTLED_NS, _MEASURED_NS = 3 * _NS_PER_S, 10 * _NS_PER_S

Pair = tuple[Frame, Frame]


class _Watch:
    """Everything in a PE that a command could change."""

    def __init__(self, core: AgentCore) -> None:
        self._core = core

    def seen(self) -> tuple[object, ...]:
        """Return the present values."""
        core = self._core
        assert core.authenticity is not None
        running, staged = core.active_configuration.running, core.staging.staged
        return (
            (core.followed_manager.manager, core.followed_manager.term, core.followed_manager.hears_lease(0)),
            (running, core.active_configuration.state, staged, core.staging.collecting()),
            core.authenticity.is_open,
            (core.output_authorization.allows(0), core.modules.faults.pending),
        )


class Attacked:
    """One PE, its true manager, and the attacker."""

    def __init__(self, spec: Spec, seed: int) -> None:
        """Send commands to the first PE of a spec until it accepts the manager."""
        self._random = Random(seed)
        self.accepted: Counter[str] = Counter()
        self.attacks: Counter[str] = Counter()
        key = Key(self._random.randbytes(KEY_BYTES))
        table = Compiler(spec).table(next(iter(spec.pes)))
        self._node = table.node_id
        self._core = AgentCore(table, 1, _NS_PER_S, secret=Secret(key, self._random.randbytes(16)))
        self._pe = SteppedCore[Event, Action](self._core, _NS_PER_S)
        self._watch = _Watch(self._core)
        self._manager = PlayedManager(FIRST_MANAGER, _TERM, key)
        foreign = Key(self._random.randbytes(KEY_BYTES))
        self._foreign = [PlayedManager(node, _TERM + 1, foreign) for node in (FIRST_MANAGER, LAST_MANAGER)]
        self._said: list[Pair] = []
        self._waiting: set[Frame] = set()  # commands received since the last beat, accepted or not
        self._kinds: dict[str, Callable[[], list[Frame]]] = {
            "forged": self._forged,
            "replayed": self._replayed,
            "reordered": self._reordered,
            "truncated": self._truncated,
            "foreign": self._foreigner,
        }
        self._meet()

    @property
    def refused(self) -> int:
        """Frames that the PE has refused and counted."""
        assert self._core.authenticity is not None
        return self._core.authenticity.refused.total() + self._core.counts.total()

    @property
    def kinds(self) -> list[str]:
        """Every kind of attack."""
        return list(self._kinds)

    def attack(self, kind: str) -> None:
        """Attack once, and count the attack as accepted if the PE has changed or has not counted a refusal."""
        if self.attacks.total() % _LED_EVERY == 0:
            self._lead()
        frames = self._kinds[kind]()
        self._waiting.update(frames)
        before, refused = self._watch.seen(), self.refused
        actions = self._pe.hear(*frames)
        said = [action for action in actions if not self._is_question(action)]
        self.attacks[kind] += 1
        if said or self._watch.seen() != before or self.refused == refused:
            self.accepted[kind] += 1

    def _meet(self) -> None:
        """Let the PE send its nonce, and answer it."""
        nonces: list[int] = []
        while not nonces:
            nonces = self._pe.nonces(_MS, self._node)
        self._pe.hear(*self._manager.welcome(self._node, nonces[0]))
        self._lead()
        assert self._core.followed_manager.term == _TERM, "the PE does not accept the true manager"

    def _lead(self) -> None:
        """Send a beat of the true manager, which the PE must accept."""
        self._waiting.clear()
        self._pe.pass_time(_BEAT_NS)
        for pair in (self._true(Command.LEASE), self._true(Command.ALIVE)):
            self._say(pair)
        ping = self._true(Command.PING)
        assert self._pe.hear(*ping), "the PE does not answer a true PING"

    def _say(self, pair: Pair) -> list[Action]:
        self._said.append(pair)
        if len(self._said) > _REMEMBERED:
            self._said[self._random.randrange(_REMEMBERED)] = self._said.pop()
        return self._pe.hear(*pair)

    def _is_question(self, action: Action) -> bool:
        """Tell whether an action sends a nonce, which asks for a new session: an attack may cause that without harm."""
        return isinstance(action, Send) and isinstance(decode_state(action.frame.data), StatePage2)

    # Commands

    def _payload(self, command: Command, term: int = _TERM) -> bytes:
        """Return a command that would change the PE if it were accepted."""
        draw, node = self._random.randrange, self._node
        match command:
            case Command.LEASE:
                return Lease(term, 0, Step.PREPARED, draw(1 << 24)).encode()
            case Command.ALIVE:
                return Alive(term, draw(256), frozenset({node})).encode()
            case Command.PREPARE:
                return Prepare(term, 1 + draw(0xFFFF), draw(1 << 24)).encode()
            case Command.SLICE if draw(2):
                return SliceHead(node, draw(256), draw(64), draw(1 << 24)).encode()
            case Command.SLICE:
                return SliceBody(node, draw(256), 1 + draw(20), self._random.randbytes(5)).encode()
            case Command.ACTIVATE:
                return Activate(term, 1 + draw(0xFFFF), Step.GO_ALL, draw(1 << 24)).encode()
            case Command.PING:
                return Ping(term, node, draw(256)).encode()
            case _:
                operations = (Operation.UNLOCK, Operation.RENEW, Operation.CLEAR, Operation.WELCOME)
                return Control(term, node, self._random.choice(operations), draw(1 << 16), draw(1 << 16)).encode()

    def _frame(self, term: int = _TERM, manager: int = FIRST_MANAGER) -> Frame:
        """Return a command that is not waiting for its TAG: with a true TAG such a command would be a true one."""
        while True:
            command = self._random.choice(_COMMANDS)
            frame = Frame(management_id(manager, command), self._payload(command, term))
            if frame not in self._waiting:
                return frame

    def _true(self, command: Command) -> Pair:
        return self._tagged(self._manager, Frame(management_id(FIRST_MANAGER, command), self._payload(command)))

    def _tagged(self, manager: PlayedManager, frame: Frame) -> Pair:
        command, tag = manager.tagged(frame)
        return command, tag

    # Attacks

    def _forged(self) -> list[Frame]:
        frame = self._frame(self._random.choice((_TERM, _TERM, _TERM + 1, 4095)))
        tag_id = management_id(FIRST_MANAGER, Command.TAG)
        if self._random.randrange(2):
            return [frame, Frame(tag_id, self._random.randbytes(8))]
        pair = list(self._tagged(self._manager, frame))
        spoilt = self._random.randrange(2)
        data = bytearray(pair[spoilt].data)
        data[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
        pair[spoilt] = pair[spoilt]._replace(data=bytes(data))
        return pair

    def _replayed(self) -> list[Frame]:
        return list(self._random.choice(self._said))

    def _reordered(self) -> list[Frame]:
        early = self._tagged(self._manager, self._frame())
        self._say(self._true(Command.LEASE))
        return list(early)

    def _truncated(self) -> list[Frame]:
        frame, tag = self._tagged(self._manager, self._frame())
        return [frame._replace(data=frame.data[: self._random.randrange(len(frame.data))]), tag]

    def _foreigner(self) -> list[Frame]:
        manager = self._random.choice(self._foreign)
        return list(self._tagged(manager, self._frame(_TERM + 1, manager.node)))


def management_load(spec: Spec, key: Key | None) -> dict[str, float]:
    """Return the share of each bus that commands take in steady flight, for ten seconds after the first deployment."""
    simulation = Simulation(spec, 1, key=key)
    bits: Counter[str] = Counter()

    def tap(sent: Sent) -> None:
        if not sent.frame.extended and classify(sent.frame.can_id).use is Use.MANAGEMENT:
            bits[sent.bus] += exact_bits(sent.frame)

    while not simulation.events_of(events.Reconfigured):
        simulation.run_for(_NS_PER_S)
    simulation.run_for(_SETTLED_NS)
    for bus in simulation.wiring.buses.values():
        bus.taps.append(tap)
    simulation.run_for(_MEASURED_NS)
    return {name: bits[name] * _NS_PER_S / _MEASURED_NS / bus.bitrate for name, bus in spec.buses.items()}


def denied(spec: Spec, seed: int, seconds: float, kind: str | None, percent: int = 0) -> tuple[float, int]:
    """Fly under a kind of forger (None: without one); gives the longest silence in ms, and the sessions that ended."""
    flight = Simulation(spec, seed, key=Key(bytes(KEY_BYTES)))
    silences, renewed = Silences(spec), [0]
    flight.wiring.tap(spec.manager.bus, lambda sent: silences.see(sent.end_ns, sent.frame))
    while not flight.events_of(events.Reconfigured):
        flight.run_for(_NS_PER_S)
    flight.run_for(_SETTLED_NS)
    silences.begin()

    def count(sent: Sent) -> None:
        if sent.frame.can_id == management_id(FIRST_MANAGER, Command.CONTROL) and not sent.sender.startswith(STRANGER):
            order = decode_command(Command.CONTROL, sent.frame.data)
            renewed[0] += isinstance(order, Control) and order.operation is Operation.RENEW

    flight.wiring.tap(spec.manager.bus, count)
    if kind is not None:
        wire = flight.wiring.buses[spec.manager.bus]
        Denier(flight.clock, wire, Random(seed), spec=spec, kind=kind, share_percent=percent)
    flight.run_for(round(seconds * _NS_PER_S))
    return silences.longest_ns(flight.clock.now_ns) / _MS, renewed[0]


def print_denials(spec: Spec, seed: int, seconds: float) -> bool:
    """Print what each kind of forger denies; tells whether any of them denied anything."""
    quiet_ms, _ = denied(spec, seed, seconds, None)
    print(f"no forger        longest silence {quiet_ms:.0f} ms")
    lease_ms = LEASE_PERIODS * max(bus.heartbeat_ns for bus in spec.buses.values()) / _MS
    is_denied = False
    for kind in DENIALS:
        for percent in (1, 3, 9):
            silent_ms, ended = denied(spec, seed, seconds, kind, percent)
            is_denied |= silent_ms > quiet_ms + lease_ms or ended > 0
            print(f"{kind:15} {percent} %: longest silence {silent_ms:.0f} ms, {ended} sessions ended")
    return is_denied


def main(argv: Sequence[str] | None = None) -> int:
    """Attack, and print the figures; returns 1 if the PE accepted an attack, did not count it, or fell silent."""
    parser = argparse.ArgumentParser(prog="python -m lab.attack", description="Attack a PE with a key.")
    parser.add_argument("spec", nargs="?", default="big_blue", metavar="SPEC", help="default: big_blue")
    parser.add_argument("--count", type=int, default=100_000, metavar="N", help="attacks of all kinds together")
    parser.add_argument("--seed", type=int, default=1, metavar="NUMBER", help="the same one attacks in the same way")
    parser.add_argument("--denial", type=float, default=0, metavar="SECONDS", help="fly that long under each forger")
    arguments = parser.parse_args(argv)
    spec = load_spec(arguments.spec)
    began_s = time.process_time()
    attacked = Attacked(spec, arguments.seed)
    with Progress() as progress:
        progress.begin("attacks", arguments.count)
        for number in range(arguments.count):
            attacked.attack(attacked.kinds[number % len(attacked.kinds)])
            progress.step()
    spent_s = time.process_time() - began_s
    for kind in attacked.kinds:
        print(f"{kind:10} {attacked.attacks[kind]:9} attacks, {attacked.accepted[kind]} accepted or not counted")
    print(f"{attacked.refused} refused and counted in {spent_s:.1f} s of CPU")
    plain, tagged = management_load(spec, None), management_load(spec, Key(bytes(KEY_BYTES)))
    for bus in spec.buses:
        print(f"{bus}: commands take {100 * plain[bus]:.2f} % of it without a key, {100 * tagged[bus]:.2f} % with one")
    is_denied = arguments.denial > 0 and print_denials(spec, arguments.seed, arguments.denial)
    return 1 if attacked.accepted.total() or is_denied else 0


if __name__ == "__main__":
    sys.exit(exit_code(main, "attack"))
