"""One flight with many faults injected into partitions and agents, and the outcome of each.

A fault kills a partition (SIGKILL), stops one (SIGSTOP) or kills an agent. Its outcome is one of

    restarted     a successor of that partition lives, and its PE has reported that it builds the modules anew
    given up      a module has used up its restarts, and a plan without it runs; afterwards the operator clears it, so
                  that it flies again
    nothing ran   no module ran in the partition, so that no report is due
    around        the agent was killed: its PE was lost, its partitions have ended, a plan without the PE runs;
                  afterwards the agent is started again, has joined, and the operator clears it

or a failure when none of these is reached within PATIENCE_S. Between two faults, and during each, every process that
the fault did not hit keeps its process number. The oracle in `declared` checks the reports of the PEs meanwhile.

PEs that are lost without an injected fault are counted apart: on a busy machine heartbeats come late.
"""

import os
import signal
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from random import Random

from heronry_dg.configuration import Running
from heronry_dg.model import Spec
from heronry_manager import events
from heronry_manager.core.tables import Compiler
from heronry_manager.core.vocabulary import ClearElement
from heronry_manager.shell.control_client import call
from heronry_tools.console.errors import UserError
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet
from lab.partition_kills.declared import Declared, DeclaredOracle, Failure

PATIENCE_S = 60.0
_WAYS = ("partition killed", "partition hangs", "agent killed")
_WEIGHTS = (7, 2, 1)
_SPARES = 0.1  # share of faults injected into any partition, whether a module runs in it or not
_WARM_UP_S = 5.0
_LOOK_S = 0.05
_UNANSWERED = "unanswered"
_Partitions = dict[int, tuple[int, str]]  # by process number: name of the PE, name of the partition


class Campaign:
    """One flight, and the faults injected into it."""

    def __init__(self, spec: Spec, fleet: Fleet, stream: EventStream, random: Random) -> None:
        self._fleet, self._stream, self._random = fleet, stream, random
        self._agents = {pe: fleet.start_pe(pe) for pe in spec.pes}
        entries = [entry for pe in spec.pes for entry in Compiler(spec).table(pe).modules]
        self._declared = {entry.name: Declared(entry.partition, entry.restarts) for entry in entries}
        self._oracle = DeclaredOracle(self._declared)
        self._plan: Mapping[str, Running] = {}  # the modules that run
        self._planned: Mapping[str, Running] = {}
        self._available: set[str] = set()
        self._killed: str | None = None
        self._failed: set[str] = set()  # elements
        self._living: _Partitions = {}
        self._own_failures: list[str] = []
        self.became: Counter[tuple[str, str]] = Counter()
        self.lost_unkilled = 0

    @property
    def failures(self) -> list[str]:
        """Return the outcomes that the spec does not declare, as sentences."""
        return self._own_failures + self._oracle.failures

    def begin(self) -> None:
        """Wait until the aircraft flies, and its partitions have loaded their modules."""
        end_s = time.monotonic() + PATIENCE_S
        while not self._plan and time.monotonic() < end_s:
            self._take_events()
        if not self._plan:
            raise UserError(
                f"the aircraft does not start; last output of the manager: {self._fleet.last_words('manager')}"
            )
        self.rest(_WARM_UP_S)
        self.lost_unkilled = 0
        self._living = self._partitions()

    def inject(self) -> None:
        """Inject one drawn fault, and wait for its outcome."""
        before = self._partitions()
        self._report_ended(self._living, before, set(), "between two faults")
        way = self._random.choices(_WAYS, _WEIGHTS)[0]
        pe = self._random.choice(sorted(self._available) or sorted(self._agents))
        own = {pid for pid, (agent, _) in before.items() if agent == self._agents[pe]}
        if way == "agent killed" or not own:
            way, injected = "agent killed", own
            self.became[way, self._kill_agent(pe)] += 1
        else:
            working = {pid for pid in own if self._works(pe, before[pid][1])}
            spare = self._random.random() < _SPARES or not working
            victim = self._random.choice(sorted(own if spare else working))
            injected = {victim}
            signal_number = signal.SIGKILL if way == "partition killed" else signal.SIGSTOP
            self.became[way, self._kill_partition(victim, pe, before[victim][1], signal_number)] += 1
        after = self._partitions()
        self._report_ended(before, after, injected, f"{way} on {pe}")
        self._living = {pid: partition for pid, partition in after.items() if pid not in injected}
        words = self._fleet.ended()
        if words is not None:
            raise UserError(words)

    def rest(self, seconds: float) -> None:
        """Let the aircraft fly; the operator clears modules that were given up."""
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0:
            self._take_events(left_s)
        around = {element for element in self._failed if element.removeprefix("module:") not in self._plan}
        for element in sorted(around):
            call(self._fleet.control_socket(), ClearElement(element))
        self._failed -= around

    def _report_ended(self, before: _Partitions, after: _Partitions, injected: set[int], when: str) -> None:
        """Report processes that ended without an injected fault."""
        pe_of = {agent: pe for pe, agent in self._agents.items()}
        for agent, name in (before[pid] for pid in before.keys() - after.keys() - injected):
            pe = pe_of.get(agent, "?")
            last = self._fleet.last_words(pe)
            self._own_failures.append(
                f"{when}: partition {name} of {pe} ended without an injected fault; its last output: {last}"
            )

    def _kill_partition(self, victim: int, pe: str, name: str, signal_number: int) -> str:
        self._oracle.injected(pe, name, time.monotonic())
        with suppress(ProcessLookupError):
            os.kill(victim, signal_number)
        end_s = time.monotonic() + PATIENCE_S
        told: set[type[events.Event]] = set()
        while time.monotonic() < end_s:
            told |= self._told_of(pe, name, self._take_events())
            became = self._became_of(victim, pe, name, told)
            if became is not None:
                return became
        kinds = sorted(kind.KIND for kind in told)
        self._own_failures.append(
            f"no outcome of the fault in partition {name} of {pe}: reported {', '.join(kinds) or 'nothing'}"
        )
        return _UNANSWERED

    def _told_of(self, pe: str, name: str, come: list[events.Event]) -> set[type[events.Event]]:
        """Return the kinds of a PE's events about the modules of a partition."""
        return {
            type(event)
            for event in come
            if isinstance(event, Failure) and event.by == pe
            if (declared := self._declared.get(event.element.partition(":")[2])) and declared.partition == name
        }

    def _became_of(self, victim: int, pe: str, name: str, told: set[type[events.Event]]) -> str | None:
        """Return the outcome of a fault in a partition; None while there is no outcome yet."""
        if not told:
            if self._works(pe, name) and pe in self._available:
                return None
            with suppress(ProcessLookupError):
                os.kill(victim, signal.SIGCONT)
            return "nothing ran"
        living = self._partitions()
        if victim in living:
            return None
        if events.FaultReported in told:
            given_up = {element.removeprefix("module:") for element in self._failed}
            return None if given_up & self._plan.keys() else "given up"
        follows = (self._agents[pe], name) in living.values() or not self._works(pe, name)
        return "restarted" if follows else None

    def _works(self, pe: str, name: str) -> bool:
        """Tell whether a partition of a PE has modules that run in the manager's plan."""
        return any(one.pe == pe and self._declared[module].partition == name for module, one in self._plan.items())

    def _kill_agent(self, pe: str) -> str:
        self._killed = pe
        agent = self._agents[pe]
        self._oracle.agent_killed(pe)
        self._fleet.kill_pe(pe)
        gone = self._comes_true(lambda: pe not in self._available and all(m.pe != pe for m in self._plan.values()))
        alone = self._comes_true(lambda: agent not in {owner for owner, _ in self._partitions().values()})
        self._agents[pe] = self._fleet.start_pe(pe)
        back = gone and self._comes_true(lambda: pe in self._available)
        self._killed = None
        call(
            self._fleet.control_socket(), ClearElement(f"pe:{pe}")
        )  # otherwise each hold-down is longer than the one before
        if not alone:
            self._own_failures.append(f"the agent of {pe} was killed, and partitions outlived it")
        if not back:
            what = "it did not join again" if gone else "the manager made no plan without it"
            self._own_failures.append(f"the agent of {pe} was killed: {what}")
            return _UNANSWERED
        return "around"

    def _comes_true(self, condition: Callable[[], bool]) -> bool:
        end_s = time.monotonic() + PATIENCE_S
        while not condition() and time.monotonic() < end_s:
            self._take_events()
        return condition()

    def _take_events(self, wait_s: float = _LOOK_S) -> list[events.Event]:
        """Note and give the events that have come."""
        come = self._stream.take(wait_s)
        for event in come:
            self._note(event)
        return come

    def _note(self, event: events.Event) -> None:
        match event:
            case events.FaultReported(element=element):
                self._oracle.heard(event, time.monotonic())
                self._failed.add(element)
            case events.ModuleRestarted():
                self._oracle.heard(event, time.monotonic())
            case events.PeLost(pe=pe):
                self.lost_unkilled += pe != self._killed
                self._available.discard(pe)
            case events.PeJoined(pe=pe):
                self._available.add(pe)
            case events.PlanReady(plan=plan):
                self._planned = plan.modules
            case events.Reconfigured() | events.PlanUnchanged():
                self._plan = self._planned
            case _:
                pass

    def _partitions(self) -> _Partitions:
        """Return every living partition."""
        agents = set(self._agents.values())
        found = {}
        for folder in Path("/proc").iterdir():
            with suppress(OSError, ValueError, IndexError):
                words = (folder / "cmdline").read_bytes().split(b"\0")
                if words[2] == b"heronry_agent.shell.partition" and int(words[3]) in agents:
                    found[int(folder.name)] = int(words[3]), words[4].decode()
        return found
