"""Random kills of modules and agents, on real processes: each stays where it happened, and something comes of it.

    python -m heronry_tools.partition_kills [--spec elevator_and_chute] [--kills 1000] [--seed 1] [--rest 0.5]

Flies the spec on the software bus. Again and again it kills a partition (SIGKILL), lets one hang (SIGSTOP) or kills an
agent, and waits until somebody has said what became of it:

    restarted     the PE has begun the modules of that partition again
    nothing ran   a spare one, of which nothing is to be said
    given up      a module of it has used up its restarts; the operator clears it afterwards, so that it flies again
    around        the agent was killed: its PE was lost and planned around; the agent is started again afterwards

It counts as a failure when a lost PE is not noticed or does not come back, when a partition outlives its agent or its
own failure, when an agent ends that was not killed, and when a partition ends that was not struck: those of other PEs
and the other ones of this PE keep their processes. PEs that are lost although nobody killed them are counted apart: on
a starved machine heartbeats come late. Exit code 1 on failure.
"""

import argparse
import json
import os
import re
import select
import signal
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from random import Random
from typing import IO, Any

from heronry_dg.model import Spec
from heronry_manager.compilation import Compiler
from heronry_manager.control_client import call
from heronry_manager.vocabulary import ClearElement
from heronry_tools.demo.buses import choose
from heronry_tools.demo.fleet import Fleet, run_folder
from heronry_tools.errors import UserError
from heronry_tools.progress import Progress
from heronry_tools.spec_argument import load_spec, spec_path

PATIENCE_S = 15.0
_WAYS = ("partition killed", "partition hangs", "agent killed")
_WEIGHTS = (7, 2, 1)
_WARM_UP_S = 5.0


class Campaign:
    """One flight, and what was done to it."""

    def __init__(self, spec: Spec, fleet: Fleet, stream: IO[bytes], random: Random) -> None:
        self._fleet, self._stream, self._random = fleet, stream, random
        self._agents = {pe: fleet.start_pe(pe) for pe in spec.pes}
        tables = [Compiler(spec).table(pe) for pe in spec.pes]
        self._partition_of = {module.name: module.partition for table in tables for module in table.modules}
        self._plan: dict[str, Any] = {}  # the modules that run
        self._planned: dict[str, Any] = {}
        self._unread = b""
        self._counted_on: set[str] = set()
        self._killed: set[str] = set()
        self._failed: set[str] = set()
        self.became: Counter[tuple[str, str]] = Counter()
        self.lost_unkilled = 0
        self.failures: list[str] = []

    def begin(self) -> None:
        """Wait until it flies, and its partitions are warm."""
        if not self._wait_for("reconfigured"):
            raise UserError(f"it does not fly: {self._fleet.last_words('manager')}")
        self.rest(_WARM_UP_S)
        self.lost_unkilled = 0

    def strike(self) -> None:
        """Do something bad, and see what becomes of it."""
        way = self._random.choices(_WAYS, _WEIGHTS)[0]
        pe = self._random.choice(sorted(self._counted_on) or sorted(self._agents))
        before = self._partitions()
        own = sorted(pid for pid, (agent, _) in before.items() if agent == self._agents[pe])
        if way == "agent killed":
            self.became[way, self._kill_agent(pe)] += 1
        elif own:
            victim = self._random.choice(own)
            with suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL if way == "partition killed" else signal.SIGSTOP)
            became = self._watch(victim, pe, before[victim][1])
            self.became[way, became] += 1
            hurt = before.keys() - self._partitions().keys() - {victim}
            if hurt:
                self.failures.append(f"{way} on {pe}: {len(hurt)} other partitions ended, too")
        words = self._fleet.ended()
        if words is not None:
            raise UserError(words)

    def rest(self, seconds: float) -> None:
        """Let it fly; the operator clears what was given up."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            for event in self._events(left):
                self._note(event)
        around = {element for element in self._failed if element.removeprefix("module:") not in self._plan}
        for element in sorted(around):
            call(self._fleet.control_socket(), ClearElement(element))
        self._failed -= around

    def _watch(self, victim: int, pe: str, name: str) -> str:
        """Wait for what is said of a partition that was struck; one that is idle says nothing."""
        end = time.monotonic() + PATIENCE_S
        told = "nothing"
        while time.monotonic() < end:
            for event in self._events(0.05):
                self._note(event)
                told = {"module_restarted": "restarted", "fault_reported": "given up"}.get(event["event"], told)
            if victim not in self._partitions() and told != "nothing":
                return told
            if told == "nothing" and (not self._works(pe, name) or pe not in self._counted_on):
                with suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGCONT)
                return "nothing ran in it"
        self.failures.append(f"partition {name} of {pe} was struck: {told}")
        return "unanswered"

    def _works(self, pe: str, name: str) -> bool:
        """Tell whether a partition of a PE has modules that run, as the manager knows."""
        return any(one["pe"] == pe and self._partition_of[module] == name for module, one in self._plan.items())

    def _kill_agent(self, pe: str) -> str:
        self._killed = {pe}
        self._fleet.kill_pe(pe)
        said = self._wait_for("pe_lost", pe)
        left = [pid for pid, (agent, _) in self._partitions().items() if agent == self._agents[pe]]
        if left:
            self.failures.append(f"the agent of {pe} was killed, and {len(left)} of its partitions live")
        self._agents[pe] = self._fleet.start_pe(pe)
        back = self._wait_for("pe_joined", pe)
        self._killed = set()
        if not (said and back):
            self.failures.append(f"the agent of {pe} was killed: {'not back' if said else 'not noticed'}")
            return "unanswered"
        return "around"

    def _wait_for(self, kind: str, pe: str | None = None) -> bool:
        end, found = time.monotonic() + 4 * PATIENCE_S, False
        while time.monotonic() < end:
            for event in self._events(0.1):
                if event["event"] == kind and event.get("pe") == pe:
                    found = True
                self._note(event)
            if found:
                return True
        return False

    def _note(self, event: dict[str, Any]) -> None:
        if event["event"] == "fault_reported":
            self._failed.add(event["element"])
        elif event["event"] == "pe_lost":
            self.lost_unkilled += event["pe"] not in self._killed
            self._counted_on.discard(event["pe"])
        elif event["event"] == "pe_joined":
            self._counted_on.add(event["pe"])
        elif event["event"] == "plan_ready":
            self._planned = event["plan"]["modules"]
        elif event["event"] == "reconfigured":
            self._plan = self._planned

    def _events(self, wait_s: float) -> list[dict[str, Any]]:
        if not select.select([self._stream], [], [], wait_s)[0]:
            return []
        *lines, self._unread = (self._unread + self._stream.read1(65536)).split(b"\n")  # type: ignore[attr-defined]
        return [json.loads(line) for line in lines]

    def _partitions(self) -> dict[int, tuple[int, str]]:
        """Every partition that lives: its agent and its name."""
        agents = set(self._agents.values())
        found = {}
        for folder in Path("/proc").iterdir():
            with suppress(OSError, ValueError, IndexError):
                words = (folder / "cmdline").read_bytes().split(b"\0")
                if words[2] == b"heronry_agent.partition" and int(words[3]) in agents:
                    found[int(folder.name)] = int(words[3]), words[4].decode()
        return found


def _slower(text: str, heartbeat_ms: int) -> str:
    """The spec with other heartbeat periods: a busy machine is then not taken for a lost PE."""
    text = re.sub(r", heartbeat_ms: \d+", "", text)
    return re.sub(r"(bitrate: \d+)", rf"\1, heartbeat_ms: {heartbeat_ms}", text)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign; gives the exit code."""
    parser = argparse.ArgumentParser(description="Kill modules and agents at random, and see what becomes of it.")
    parser.add_argument("--spec", default="elevator_and_chute", metavar="SPEC", help="default elevator_and_chute")
    parser.add_argument("--kills", type=int, default=1000, metavar="N", help="default 1000")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default 1")
    parser.add_argument("--heartbeat-ms", type=int, default=100, metavar="MS", help="of every bus (default 100)")
    parser.add_argument("--rest", type=float, default=0.5, metavar="SECONDS", help="between two (default 0.5)")
    arguments = parser.parse_args(argv)
    with ExitStack() as stack:
        folder = run_folder()
        file = folder / "slower.dg.yaml"
        file.write_text(_slower(spec_path(arguments.spec).read_text(), arguments.heartbeat_ms))
        spec = load_spec(str(file))
        fleet = stack.enter_context(Fleet(spec, file, folder))
        fleet.start_buses(choose(spec, fleet.folder, {}, None))
        stream = fleet.start_manager()
        campaign = Campaign(spec, fleet, stream, Random(arguments.seed))
        progress = stack.enter_context(Progress())
        campaign.begin()
        progress.begin("kills", arguments.kills)
        for _ in range(arguments.kills):
            campaign.strike()
            campaign.rest(arguments.rest)
            progress.step()
    for (way, became), times in sorted(campaign.became.items()):
        print(f"{times:6} {way}: {became}")
    print(f"{campaign.lost_unkilled:6} PEs lost that nobody killed (their heartbeats came late)")
    for failure in campaign.failures:
        print(f"FAILURE: {failure}")
    return 1 if campaign.failures else 0


if __name__ == "__main__":
    sys.exit(main())
