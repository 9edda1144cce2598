"""Kills of the agent with the controller, on processes: how the command jumps when the controller moves.

    python -m lab.checkpoints.live [--kills 20] [--seed 1] [--heartbeat-ms 20] [--without]

Flies `loop.dg.yaml` on the software bus, kills the agent that runs the controller, and starts it again after each kill.
Exit code 1: with the checkpoint a jump was larger than 1 % of the range, or the controller started without its state.
"""

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from random import Random

import yaml

from heronry_dg.model import Spec
from heronry_dg.traffic import identifiers
from heronry_manager import events
from heronry_manager.core.vocabulary import ClearElement
from heronry_manager.events import Event
from heronry_manager.shell.control_client import call
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import load_spec
from heronry_tools.runtime.demo.buses import choose
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet, run_folder
from heronry_wire.canaerospace import decode_data
from heronry_wire.frame import Malformed
from lab.checkpoints import LOOP, MOST_JUMP
from lab.checkpoints.images import RANGE
from lab.slow_spec import slow_spec

PATIENCE_S = 60.0
_SETTLES_S = 6.0
_TESTS = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Kill:
    """One kill; the fields are those of `kills.Flown`."""

    jump: float
    gap_ms: float
    age_ms: int | None


class Flight:
    """The loop on processes, with an observer of its bus."""

    def __init__(self, spec: Spec, fleet: Fleet, ear: Ear) -> None:
        """Start the manager and all PEs."""
        self._fleet, self._ear = fleet, ear
        self._kept = spec.modules["controller"].checkpoint is not None
        self._stream = EventStream(fleet.start_manager())
        for pe in spec.pes:
            fleet.start_pe(pe)
        self._number = identifiers(spec)["controller", "command"]
        self._nodes = {pe.node_id: pe.name for pe in spec.pes.values()}
        self._given: list[tuple[int, int, float]] = []  # time, node, command
        self.events: list[Event] = []

    def until(self, is_done: Callable[[], bool], what: str) -> None:
        """Let the flight go on until something is so; raises UserError if it takes too long."""
        end_s = time.monotonic() + PATIENCE_S
        while not is_done():
            if time.monotonic() > end_s:
                raise UserError(
                    f"in {PATIENCE_S:g} s there was no {what}; last words: {self._fleet.last_words('manager')}"
                )
            self._look()

    def rest(self, seconds: float) -> None:
        """Let the flight go on."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self._look()

    def kill(self) -> Kill:
        """Kill the agent that runs the controller, see what follows, and start the agent again."""
        home, begun = self._nodes[self._given[-1][1]], len(self.events)
        self._fleet.kill_pe(home)
        self.until(lambda: self._nodes[self._given[-1][1]] != home, "command from the other PE")
        if self._kept:
            self.until(lambda: bool(self._starts(begun)), "report of the start")
        before = [one for one in self._given if self._nodes[one[1]] == home][-1]
        after = next(one for one in self._given if one[0] > before[0] and self._nodes[one[1]] != home)
        ages = [event.age_ms for event in self._starts(begun) if isinstance(event, events.StateRestored)]
        self._fleet.start_pe(home)
        self.until(lambda: self._told(events.PeHeardAgain, home, begun), "state of the killed PE")
        call(self._fleet.control_socket(), ClearElement(f"pe:{home}"))  # its hold-down doubles with each loss
        self.until(lambda: self._told(events.PeJoined, home, begun), "return of the killed PE")
        return Kill(
            abs(after[2] - before[2]) / (2 * RANGE), (after[0] - before[0]) / 1_000_000, ages[0] if ages else None
        )

    def _starts(self, begun: int) -> list[events.StateRestored | events.StateLacking]:
        """Return what is told of the state of the controller since the event with the number `begun`."""
        outcomes = (events.StateRestored, events.StateLacking)
        told = [event for event in self.events[begun:] if isinstance(event, outcomes)]
        return [event for event in told if event.module == "controller"]

    def _told(self, kind: type[events.PeHeardAgain | events.PeJoined], pe: str, begun: int) -> bool:
        return any(isinstance(one, kind) and one.pe == pe for one in self.events[begun:])

    def flies(self) -> None:
        """Wait until the controller runs and its loop has settled."""
        self.until(lambda: bool(self._given), "command")
        self.rest(_SETTLES_S)

    def _look(self) -> None:
        self.events += self._stream.take(0.02)
        for arrival in self._ear.hear():
            if arrival.frame.can_id == self._number:
                datum = decode_data(arrival.frame)
                assert not isinstance(datum, Malformed)
                assert isinstance(datum.value, float)
                self._given.append((arrival.time_ns, datum.node_id, datum.value))


def fly(kills: int, *, seed: int, heartbeat_ms: int, kept: bool = True) -> list[Kill]:
    """Fly, and kill `kills` times; returns what each kill has led to."""
    random = Random(seed)
    os.environ["PYTHONPATH"] = os.pathsep.join((str(_TESTS), os.environ.get("PYTHONPATH", "")))  # for the partitions
    with ExitStack() as stack:
        folder = run_folder()
        file = slow_spec(str(LOOP), folder, heartbeat_ms=heartbeat_ms)
        if not kept:
            document = yaml.safe_load(file.read_text())
            for module in document["modules"].values():
                module.pop("checkpoint", None)
            file.write_text(yaml.safe_dump(document, sort_keys=False))
        spec = load_spec(str(file))
        fleet = stack.enter_context(Fleet(spec, file, folder))
        choices = choose(spec, fleet.folder, {}, None, prefer_vcan=False)
        fleet.start_buses(choices)
        ear = stack.enter_context(Ear(choices["can0"], spec.buses["can0"]))
        flight = Flight(spec, fleet, ear)
        flight.flies()
        found = []
        for _ in range(kills):
            found.append(flight.kill())
            flight.rest(random.uniform(2.0, 4.0))
        return found


def main(argv: Sequence[str] | None = None) -> int:
    """Fly; returns the exit code."""
    parser = argparse.ArgumentParser(description="Kill the agent with an integrating controller, and see the jump.")
    parser.add_argument("--kills", type=int, default=20, metavar="N", help="default 20")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default 1")
    parser.add_argument("--heartbeat-ms", type=int, default=20, metavar="MS", help="of the bus (default 20)")
    parser.add_argument("--without", action="store_true", help="take the checkpoint away")
    arguments = parser.parse_args(argv)
    kept = not arguments.without
    found = fly(arguments.kills, seed=arguments.seed, heartbeat_ms=arguments.heartbeat_ms, kept=kept)
    jumps, gaps, ages = ([getattr(one, name) for one in found] for name in ("jump", "gap_ms", "age_ms"))
    known = [age for age in ages if age is not None]
    print(
        f"{len(found)} kills {'with' if kept else 'without'} a checkpoint: jump {statistics.median(jumps):.2%} of the "
        f"range (max {max(jumps):.2%}), gap {statistics.median(gaps):.0f} ms (max {max(gaps):.0f}), "
        f"{len(known)} restored" + (f", age {statistics.median(known):.0f} ms (max {max(known)})" if known else "")
    )
    return int(kept and (max(jumps) > MOST_JUMP or len(known) < len(found)))


if __name__ == "__main__":
    sys.exit(main())
