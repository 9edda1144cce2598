"""The state diagrams of docs/protocol/ against flights and conformance tests: every transition is drawn, and happens.

Some machines are tables in the code (`TransitionTable`): their diagrams are written from these, nothing else can
happen, and here it is verified that all of it does. The others are drawn by hand, and compared here with what happens.
The state of a PE (PeState) is compared with every order of steps in tests/lab/tests/test_documents.py.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum
from functools import wraps
from pathlib import Path
from typing import Any

import pytest

from heronry_agent.core.authority import Authenticity as PeAuthenticity
from heronry_agent.core.configuration import ActiveConfiguration, Staging
from heronry_agent.core.configuration.staging import UNCONFIGURED
from heronry_agent.core.modules.phase_requests import _Watch
from heronry_agent.core.reports import Faults
from heronry_manager.core.authentication.authenticity import Authenticity
from heronry_manager.core.epochs import STAGE_TRANSITIONS
from heronry_manager.core.mastership import MASTERSHIP_TRANSITIONS
from heronry_manager.core.mastership.claim import Claim
from heronry_manager.core.membership import STANDING_TRANSITIONS
from heronry_manager.core.membership.exclusion import Exclusion
from heronry_manager.core.membership.health import Change, Health
from heronry_manager.core.membership.standing import Standing
from heronry_manager.core.memory import Memory
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.situation.radio_links import RadioLinks
from heronry_manager.core.tables.compilation import Compiler
from heronry_manager.core.transitions import TransitionTable
from heronry_manager.core.turn import Turn
from heronry_tools.sim.faults.drawing import drawn_faults
from heronry_tools.sim.flight.outcome import Scenario, play
from heronry_tools.sim.scenario.in_simulator import fly
from heronry_tools.sim.scenario.script import read_script
from heronry_wire.channel_watch import ChannelWatch
from heronry_wire.management import MAX_TERM, FaultCode
from lab.conformance.conformance_tests import conforms
from scenarios.flights import two_tails

SEEDS = range(3)
SCENARIOS = (
    "a_keyed_standby_came_too_late_to_know_the_pes",
    "big_blue_loses_two",
    "one_pe_loses_its_wire_to_a_channel",
    "the_same_manager_is_started_twice",
)
CONFORMANCE_TESTS = (
    "manager_counting.of_two_managers_the_lower_term_gives_way",
    "manager_counting.a_pe_that_answers_in_time_stays",
    "manager_counting.a_pe_that_comes_back_is_held_down",
    "manager_counting.a_manager_that_hears_no_pe_sends_nothing",
    "manager_counting.a_starting_manager_gives_way_too",
    "manager_epochs.a_change_before_activate_gives_the_number_up",
    "manager_epochs.a_silent_driver_is_given_t_lease",
    "manager_epochs.what_is_driven_breaks_before_it_makes",
    "manager_reacting.a_radio_that_is_gone_takes_the_pes_beyond",
    "manager_standing_by.a_standby_takes_over_when_the_pes_hear_no_manager",
    "pe_alone.what_rests_starts_when_it_is_named_again",
    "pe_failing.a_module_that_was_given_up_runs_again_with_the_next_epoch",
    "pe_failing.a_new_term_is_told_what_has_stopped",
    "pe_failing.a_phase_s_rule_holds_for_its_time",
    "pe_failing.what_is_cleared_is_ended_and_reported_anew",
    "pe_keyed.a_new_session_begins_with_renew_and_with_a_new_term",
    "pe_staging.a_contingency_on_board_is_called_by_its_number",
    "pe_staging.a_newer_epoch_takes_the_place_of_what_is_collected",
)
Changes = set[tuple[str, str]]
States = Mapping[Hashable, str]


@dataclass(frozen=True)
class Machine:
    """A state machine that is drawn by hand, and how its states are found: `look` reads them from their owner."""

    states: str
    owner: type
    look: Callable[[Any], States]

    @property
    def names(self) -> set[str]:
        return set(self.states.split())

    @property
    def first(self) -> str:
        """State of a thing that the owner knows nothing of."""
        return self.states.split()[0]

    def drawn(self) -> Changes:
        """Arrows of its diagram, but for those that lead back to where they come from."""
        for page in sorted(Path("docs/protocol").glob("*.md")):
            for block in re.findall(r"```mermaid\nstateDiagram-v2\n(.*?)```", page.read_text("utf-8"), re.DOTALL):
                arrows = set(re.findall(r"^ +(\w+) --> (\w+)", block, re.MULTILINE))
                if {state for arrow in arrows for state in arrow} == self.names:
                    return {(one, other) for one, other in arrows if one != other}
        raise AssertionError(f"no diagram draws {self.states}")


def staging(staging: Staging) -> States:
    if staging.collecting():
        return {"": "COLLECTING"}
    return {"": "NOTHING" if staging.staged is UNCONFIGURED else "STAGED"}


def faults(faults: Faults) -> States:
    no_fault = (FaultCode.PHASE_REQUEST, FaultCode.MODULE_RESTARTED)
    told = dict.fromkeys(faults._told, "TOLD")
    return told | {(key[1], key[2]): "PENDING" for key in faults._pending if key[0] not in no_fault}


def radios(links: RadioLinks) -> States:
    return {
        link: "GONE" if record.gone else "SETTLING" if record.settling else "FOLLOWED"
        for link, record in links.records.items()
    }


def sessions(authenticity: Authenticity) -> States:
    peers = authenticity._peers.items()
    return {pe: "OPEN" if peer.opened else "OFFERED" if peer.offers else "NO_SESSION" for pe, peer in peers}


MACHINES = (
    Machine("NOTHING COLLECTING STAGED", Staging, look=staging),
    Machine("FREE HELD", Exclusion, look=lambda x: {(pe, t): "HELD" for pe, held in x._holds.items() for t in held}),
    Machine("ATTENDED RESTING", ActiveConfiguration, look=lambda x: {"": "RESTING" if x.resting else "ATTENDED"}),
    Machine("WELL PENDING TOLD", Faults, look=faults),
    Machine("ARMED FIRED", _Watch, look=lambda x: {"": "ARMED" if x.armed else "FIRED"}),
    Machine("SETTLING FOLLOWED GONE", RadioLinks, look=radios),
    Machine("WELL LOST", ChannelWatch, look=lambda x: dict.fromkeys(x._lost, "LOST")),
    Machine("ASKING IN_SESSION", PeAuthenticity, look=lambda x: {"": "IN_SESSION" if x._states.session else "ASKING"}),
    Machine("NO_SESSION OFFERED OPEN", Authenticity, look=sessions),
)
TABLES: Mapping[str, TransitionTable[Any, Any]] = {
    "standing": STANDING_TRANSITIONS,
    "epochs": STAGE_TRANSITIONS,
    "mastership": MASTERSHIP_TRANSITIONS,
}


@contextmanager
def watched(machine: Machine, seen: Changes) -> Iterator[None]:
    """Note every change of state of every object of a machine's owner."""
    with pytest.MonkeyPatch.context() as patch:
        calls: Counter[int] = Counter()
        for name, method in list(vars(machine.owner).items()):
            if callable(method) and not name.startswith("__") and name != "forget":  # it begins anew, as a new object
                patch.setattr(machine.owner, name, noting_what_has_changed(method, machine, calls, seen))
        yield


@contextmanager
def taken(transitions: set[tuple[Enum, Enum]]) -> Iterator[None]:
    """Note every transition that is looked up in a table: the state before, and the event."""

    def after(table: TransitionTable[Any, Any], state: Enum, event: Enum) -> Enum:
        transitions.add((state, event))
        return found(table, state, event)

    found = TransitionTable.after
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TransitionTable, "after", after)
        yield


def noting_what_has_changed(
    method: Callable[..., Any], machine: Machine, calls: Counter[int], seen: Changes
) -> Callable[..., Any]:
    """A method that looks at its object before and after, unless another one has called it."""

    @wraps(method)
    def call(self: Any, *given: Any, **named: Any) -> Any:
        if calls[id(self)]:
            return method(self, *given, **named)
        calls[id(self)] += 1
        before = machine.look(self)
        try:
            return method(self, *given, **named)
        finally:
            after = machine.look(self)
            changes = ((before.get(x, machine.first), after.get(x, machine.first)) for x in {*before, *after})
            seen.update((one, other) for one, other in changes if one != other)
            calls[id(self)] -= 1

    return call


def rare() -> None:
    """Make the transitions that none of the flights and conformance tests comes to."""
    spec = two_tails()
    first, second, *_ = spec.pes
    known = Health(spec, 0, 10**9)
    known.bar(first, "failed", 0)
    for pe in (first, second):
        known.quarantine(pe, 2)
    known.heard(second, 1, 1)
    assert [change.change for change in known.inherited([second], 1)] == [Change.JOINED]
    known.fail(second, "failed", 2)
    known.heard(second, 1, 2)
    for _ in range(2):
        known.await_again([second], 3, 10**9)
    known.tick(10**9)
    assert known.standing(second) is Standing.DOWN
    memory = Memory(term=MAX_TERM)
    assert not Claim(
        ManagerSettings(spec, Compiler(spec), 126), Turn(126, 0, term=MAX_TERM, memory=memory)
    ).begin_term()


def test_what_happens_is_drawn_and_what_is_drawn_happens() -> None:
    seen: dict[str, Changes] = defaultdict(set)
    found: set[tuple[Enum, Enum]] = set()
    with ExitStack() as stack:
        stack.enter_context(taken(found))
        for machine in MACHINES:
            stack.enter_context(watched(machine, seen[machine.states]))
        for seed in SEEDS:
            scenario = Scenario(seed, 6.0, drawn_faults(two_tails(), seed, 6.0), drawn=True)
            assert play(two_tails(), scenario).violations == ()
        for name in SCENARIOS:
            assert fly(read_script(Path(f"tests/scenarios/{name}.scenario"))).holds
        for name in CONFORMANCE_TESTS:
            assert conforms(name)[0] is None
        rare()
    for machine in MACHINES:
        drawn, happened = machine.drawn(), seen[machine.states]
        assert (happened - drawn, drawn - happened) == (set(), set()), f"not drawn, and not seen, of {machine.states}"
    for name, table in TABLES.items():
        never = [f"{before.name} {event.name}" for before, event, _, _ in table.rows if (before, event) not in found]
        assert never == [], f"never taken, of the table of {name}"
