"""Forgers without the key on the software bus of real processes: what they silence, end and lose, and whether it shows.

    python -m lab.denial [SPEC] [--seconds 60] [--percent 1 3 9] [--kinds forged_tag ...] [--at-once 3] [--restart]

For each kind of forger (`heronry_tools.sim.faults.denial`) an aircraft with a key flies on a software bus of its own:
first without the forger, then with the forger at each share of the managers' bus. Verified, for each share:

    silence     no function that was heard without the forger is silent for longer than T_lease
    sessions    the active manager ends no session (RENEW)
    PEs         the manager loses no PE
    told        the manager's status counts more refused states, reports and commands than before

With --restart a PE that gives an output is killed in each flight and each attack, and started again. Then silences are
compared with those of the restart without the forger: no function may be silent for more than T_lease longer. And the
PE must join again.

Exit code 1 otherwise. If a function was silent for longer than T_lease without the forger, this computer is too slow:
let fewer aircraft fly at once, or give them slower heartbeats.
"""

import argparse
import multiprocessing
import os
import select
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from threading import Thread

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.vocabulary import AskStatus, ClearElement
from heronry_manager.shell.control_client import call
from heronry_tools.console.errors import UserError, exit_code
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.runtime.demo.fleet import NODE_PRIORITY
from heronry_tools.sim.faults.denial import DENIALS, Forgery
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_wire.bare_can import can
from heronry_wire.frame import Frame
from heronry_wire.frame_port import Arrival
from heronry_wire.identifiers import FIRST_MANAGER, Command, management_id
from heronry_wire.key_file import make_key
from heronry_wire.management import Control, Operation, decode_command
from heronry_wire.python_can import message_of
from heronry_wire.timing import exact_bits
from lab.benches.fleets import Aircraft, aircraft
from lab.silences import Silences
from lab.slow_spec import slow_spec

QUIET_S = 5.0  # without a forger, at the start and before each share
_SHOWN_S = 2.0  # after an attack: until the PEs have told the manager what they refused
_CATCH_UP_NS = 50_000_000  # a forger that was late sends the frames of so long a time together
_ANY_MS = float("inf")
_LOOK_S = 0.02
_DEAD_S = 0.5  # of a PE, until it is started again
_RESTARTED_S = 16.0  # a flight with a restart and without a forger: longer than a start and two hold-downs
_SEND_S = 1.0  # while the bus is full
_CONTROL = management_id(FIRST_MANAGER, Command.CONTROL)
_MS, _NS_PER_S = 1_000_000, 1_000_000_000


@dataclass(frozen=True, slots=True)
class Endured:
    """What one forger did to one aircraft at one share of its bus; a share of 0: without the forger."""

    kind: str
    percent: int
    sent_percent: float  # of the bus, in fact
    silent_ms: float
    lease_ms: float
    renewed: int
    lost: tuple[str, ...]
    refused: int
    restarted: str | None = None  # the PE that was killed and started again meanwhile
    has_joined: bool = True  # it has joined again
    usual_ms: float = 0.0  # the longest silence that such a restart takes without a forger

    def failure(self) -> str | None:
        """Return what rule 11 of the protocol forbids; None: nothing."""
        if self.silent_ms > self.usual_ms + self.lease_ms:
            limit = f"{self.lease_ms:.0f} ms" if not self.usual_ms else f"{self.usual_ms:.0f} + {self.lease_ms:.0f} ms"
            return f"a function was silent for {self.silent_ms:.0f} ms, longer than T_lease ({limit})"
        if not self.has_joined:
            return f"{self.restarted} was restarted, and has not joined again"
        if self.renewed:
            return f"the manager ended {self.renewed} sessions"
        if self.lost:
            return f"the manager lost {', '.join(self.lost)}"
        return None if self.refused or not self.percent else "the manager's status tells nothing of the forger"

    def line(self) -> str:
        """Return the figures in one line."""
        told = f"{self.kind:17} {self.percent} % (sent {self.sent_percent:.1f} %): "
        told += f"longest silence {self.silent_ms:.0f} ms, {self.renewed} sessions ended, {self.refused} refused"
        failure = self.failure()
        return told if failure is None else f"{told}  FAILURE: {failure}"


class _Intruder(Ear):
    """A node that also sends on the bus; it does not hear its own frames."""

    def say(self, frame: Frame) -> None:
        assert isinstance(self._bus, can.BusABC), "a forger of a replicated bus is not provided"
        self._bus.send(message_of(frame), timeout=_SEND_S)


class _Attack:
    """One aircraft, and the forger on its main bus."""

    def __init__(self, flown: Aircraft, intruder: _Intruder, kind: str, seed: int) -> None:
        self._flown, self._intruder, self._kind = flown, intruder, kind
        self._bitrate = flown.spec.buses[flown.main.name].bitrate
        self._silences = Silences(flown.spec)
        self._forgery = Forgery(Random(seed), spec=flown.spec, kind=kind)
        self._events = AwaitedEvents(flown.fleet, flown.fleet.start_manager())
        flown.start_pes()
        self._events.wait(events.Reconfigured)
        self._lost: set[str] = set()
        self._joined: set[str] = set()
        self._restarted: int | None = None  # the node-ID of the PE that is restarted
        self._renewed = self._bits = 0
        self._listen(QUIET_S)

    def endure(self, seconds: float, percent: int, *, restarts: bool = False, usual_ms: float = 0.0) -> Endured:
        """Let the forger send for so long at this share of the bus, or only listen (0).

        restarts: kill a PE after a quarter of the time, and start it again.
        usual_ms: as of `Endured`.
        """
        restarted: str | None = None
        self._listen(QUIET_S)
        refused = self._refused()
        self._lost.clear()
        self._renewed = self._bits = 0
        self._silences.begin()
        self._restarted = None
        if not restarts:
            self._listen(seconds, percent)
        else:
            self._listen(seconds / 4, percent)
            self._look_whether_any_is_heard()
            self._restarted = self._silences.node
            (restarted,) = (pe.name for pe in self._flown.spec.pes.values() if pe.node_id == self._restarted)
            call(self._flown.fleet.control_socket(), ClearElement(f"pe:{restarted}"))  # the same hold-down each time
            self._flown.fleet.kill_pe(restarted)
            self._joined.discard(restarted)
            self._listen(_DEAD_S, percent)
            starter = Thread(target=self._flown.fleet.start_pe, args=(restarted,))  # it may take seconds
            starter.start()
            self._listen(3 * seconds / 4 - _DEAD_S, percent)
            starter.join()
        silent_ms, renewed = self._silences.longest_ns(time.monotonic_ns()) / _MS, self._renewed
        self._listen(_SHOWN_S)
        self._look_whether_any_is_heard()
        return Endured(
            kind=self._kind,
            percent=percent,
            sent_percent=100 * self._bits / self._bitrate / seconds,
            silent_ms=silent_ms,
            lease_ms=lease_ms(self._flown.spec),
            renewed=renewed,
            lost=tuple(sorted(self._lost - {restarted})),
            refused=self._refused() - refused,
            restarted=restarted,
            has_joined=restarted is None or restarted in self._joined,
            usual_ms=usual_ms,
        )

    def _look_whether_any_is_heard(self) -> None:
        if not self._silences.heard:
            raise UserError(f"no function of {self._flown.spec.name} is heard on {self._flown.main.name}")

    def _refused(self) -> int:
        status = call(self._flown.fleet.control_socket(), AskStatus()).status or {}
        proofs = [pe["authentic"] for pe in status["pes"].values()]
        return sum(proof["refused_states"] + proof["unproven_reports"] + proof["refused_commands"] for proof in proofs)

    def _listen(self, seconds: float, percent: int = 0) -> None:
        now_ns = time.monotonic_ns()
        end_ns, due_ns = now_ns + round(seconds * _NS_PER_S), now_ns
        while (now_ns := time.monotonic_ns()) < end_ns:
            if percent and now_ns >= due_ns:
                frame = self._forgery.next_frame()
                self._intruder.say(frame)
                self._bits += exact_bits(frame)
                due_ns = max(due_ns, now_ns - _CATCH_UP_NS) + self._forgery.pause_ns(frame, self._bitrate, percent)
            wait_s = (due_ns - now_ns) / _NS_PER_S if percent else _LOOK_S
            select.select(self._intruder.readers, [], [], min(_LOOK_S, max(0.0, wait_s)))
            for arrival in self._intruder.hear():
                self._hear(arrival)
            for told in self._events.take():
                if isinstance(told, events.PeLost):
                    self._lost.add(told.pe)
                elif isinstance(told, events.PeJoined):
                    self._joined.add(told.pe)

    def _hear(self, arrival: Arrival) -> None:
        at_ns, frame = arrival
        self._silences.see(at_ns, frame)
        self._forgery.hear(frame)
        if frame.can_id == _CONTROL:
            order = decode_command(Command.CONTROL, frame.data)
            if isinstance(order, Control) and order.operation is Operation.RENEW and order.node != self._restarted:
                self._renewed += 1


def lease_ms(spec: Spec) -> float:
    """Return T_lease of the slowest bus, in ms."""
    return LEASE_PERIODS * max(bus.heartbeat_ns for bus in spec.buses.values()) / _MS


@dataclass(frozen=True, slots=True)
class _Plan:
    """What flies, and what it endures: a spec, the key of all nodes, and the forger's times and shares of the bus."""

    file: Path
    key: Path
    seconds: float
    percents: Sequence[int]
    seed: int
    restarts: bool


def _endured(plan: _Plan, kind: str) -> list[Endured]:
    """Fly an aircraft without the forger, and then with the forger at each share of the bus."""
    with suppress(PermissionError):  # the forger is a computer of its own, as the nodes are
        os.setpriority(os.PRIO_PROCESS, 0, NODE_PRIORITY)
    with (
        aircraft(str(plan.file), key=plan.key) as flown,
        _Intruder(flown.main, flown.spec.buses[flown.main.name]) as intruder,
    ):
        attack = _Attack(flown, intruder, kind, plan.seed)
        if not plan.restarts:
            return [attack.endure(QUIET_S, 0), *(attack.endure(plan.seconds, percent) for percent in plan.percents)]
        usual = attack.endure(_RESTARTED_S, 0, restarts=True, usual_ms=_ANY_MS)
        attacks = (attack.endure(plan.seconds, n, restarts=True, usual_ms=usual.silent_ms) for n in plan.percents)
        return [usual, *attacks]


def _flights(arguments: argparse.Namespace, folder: Path) -> Iterator[list[Endured]]:
    """Fly one aircraft for each kind of forger, some of them at once."""
    file, key = slow_spec(arguments.spec, folder, heartbeat_ms=arguments.heartbeat_ms), folder / "fleet.key"
    make_key(key)
    plan = _Plan(file, key, arguments.seconds, arguments.percent, arguments.seed, arguments.restart)
    with ProcessPoolExecutor(arguments.at_once, multiprocessing.get_context("spawn")) as pool:
        for flight in as_completed([pool.submit(_endured, plan, kind) for kind in arguments.kinds]):
            yield flight.result()


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; gives the exit code."""
    parser = argparse.ArgumentParser(description="Let forgers without the key deny service to real processes.")
    parser.add_argument("spec", nargs="?", default="dg_specs/examples/demux_actuators.dg.yaml", metavar="SPEC")
    parser.add_argument("--seconds", type=float, default=60, metavar="S", help="under each forger (default 60)")
    parser.add_argument("--percent", type=int, nargs="+", default=[1, 3, 9], metavar="N", help="default 1 3 9")
    parser.add_argument("--kinds", nargs="+", choices=DENIALS, default=[*DENIALS], metavar="KIND", help="default: all")
    parser.add_argument("--at-once", type=int, default=3, metavar="N", help="aircraft that fly at once (default 3)")
    parser.add_argument("--heartbeat-ms", type=int, default=100, metavar="MS", help="of every bus (default 100)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of what the forgers draw")
    parser.add_argument("--restart", action="store_true", help="kill a PE in each flight, and start it again")
    arguments = parser.parse_args(argv)
    failures = 0
    with TemporaryDirectory() as folder:
        for flight in _flights(arguments, Path(folder)):
            for one in flight:
                failures += one.failure() is not None
                print(one.line(), flush=True)
    print("no forger denied anything" if not failures else f"{failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(exit_code(main, "denial"))
