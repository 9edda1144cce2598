"""What a manager remembers over a restart: kept as records while it lives, and taken up again by the next one."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heronry_dg.loader import loads
from heronry_manager import events
from heronry_manager.core.epochs.numbering import EPOCHS_PER_TERM, EpochNumbers, NoTermError, next_term
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import EPOCHS, NOTHING, Memory, Reserved
from heronry_manager.core.turn import Turn
from heronry_manager.core.vocabulary import ClearElement, EnterPhase, FailElement, JournalTold, Keep, OperatorSaid
from heronry_wire.identifiers import MANAGER_NODES
from heronry_wire.management import ElementKind, Emergency, FaultCode, Prepare, is_newer
from heronry_wire.sansio import Send
from heronry_wire.state_frames import PeState
from manager.one_manager import BEAT_NS, MS, SPEC_TEXT, OneManager
from thoroughness import part_of

PHASES = loads(SPEC_TEXT + "phases: {climb: {}, glide: {}, land: {}}\n", "phases.dg.yaml")
FAULT = Emergency(FaultCode.REPORTED, 0x81, ElementKind.DEVICE, 0, 57)


def flown() -> OneManager:
    """A manager to which much has happened."""
    manager = OneManager(PHASES)
    manager.start()
    manager.give(OperatorSaid(1, EnterPhase("glide")))
    manager.report("left", FAULT)
    manager.give(OperatorSaid(2, FailElement("pe:right")))
    for _ in range(2):
        manager.reboot("middle")
        manager.pass_time(41 * BEAT_NS)
    manager.reboot("middle")
    return manager


def restarted(before: OneManager) -> OneManager:
    """The next one, which knows what the journal holds."""
    after = OneManager(PHASES, memory=before.memory)
    for pe in PHASES.pes:
        after.running[pe] = before.running[pe]
        after.beat(pe)
    return after


def test_phase_faults_and_quarantines_outlive_a_restart() -> None:
    before = flown()
    after = restarted(before)
    after.core.validate()
    assert after.core.status()["phase"] == "glide"
    assert [one["element"] for one in after.core.status()["latched"]] == ["device:servo_left", "pe:right"]
    assert after.core.status()["pes"]["right"]["state"] == "down"
    assert after.core.status()["pes"]["middle"]["losses"] == 3
    after.pass_time(41 * BEAT_NS)
    assert after.core.status()["pes"]["middle"]["state"] == "up"
    assert after.core.status()["pes"]["right"]["state"] == "down"
    assert after.memory.quarantined == {}


def test_what_the_operator_clears_is_not_remembered() -> None:
    manager = flown()
    for number, element in enumerate(("pe:right", "device:servo_left", "pe:middle")):
        manager.give(OperatorSaid(number, ClearElement(element)))
    assert (manager.memory.latched, manager.memory.quarantined) == ({}, {})


def test_a_restart_begins_a_higher_term_and_uses_no_epoch_again() -> None:
    before = OneManager()
    before.start()
    used = before.prepared()[0]
    after = OneManager(memory=before.memory)
    after.start(fly=False)
    after.answer()
    assert after.memory.term > before.memory.term
    assert is_newer(after.prepared()[0], before.memory.reserved[EPOCHS])
    assert before.memory.reserved[EPOCHS] >= used


def test_numbers_are_kept_before_the_first_frame_that_uses_them() -> None:
    manager = OneManager()
    for pe in manager.spec.pes:
        manager.live(pe)
    manager.pass_time(110 * MS)
    plan = manager.requests[-1]
    assert manager.memory.term == 1
    actions = []
    give = manager.core.step

    def listening(now_ns: int, event: object) -> object:
        found = give(now_ns, event)  # type: ignore[arg-type]
        actions.extend(found)
        return found

    manager.core.step = listening  # type: ignore[method-assign, assignment]
    assert plan.running is None
    manager.answer()
    reserved = next(i for i, one in enumerate(actions) if isinstance(one, Keep) and isinstance(one.record, Reserved))
    assert reserved < next(i for i, one in enumerate(actions) if isinstance(one, Send))
    assert manager.said(Prepare)[-1].epoch <= manager.memory.reserved[EPOCHS]


def test_a_journal_that_fails_is_reported_and_stops_no_manager() -> None:
    manager = OneManager()
    manager.start()
    manager.give(JournalTold("No space left on device"))
    assert manager.last(events.JournalFailed).problem == "No space left on device"
    assert manager.core.status()["manager"]["journal"] == "No space left on device"
    manager.give(JournalTold(None))
    assert manager.last(events.JournalKept).before == "No space left on device"
    assert manager.core.status()["manager"]["journal"] is None
    assert manager.stops == []


def test_a_manager_that_only_advises_remembers_nothing() -> None:
    manager = OneManager()
    manager.core = ManagerCore(manager.spec, 126, NOTHING, manager.now_ns, advise=True)
    manager.start(fly=False)
    manager.live("left", PeState.ACTIVE, epoch=3, digest=5)
    assert manager.memory == NOTHING


@given(st.sampled_from(MANAGER_NODES), st.integers(0, 4093))
def test_a_term_names_its_manager_and_only_rises(node: int, highest: int) -> None:
    term = next_term(node, highest)
    assert highest < term <= highest + 2
    assert term % 2 == (1 if node == 126 else 0)


def test_after_the_last_term_there_is_none() -> None:
    assert next_term(126, 4094) == 4095
    with pytest.raises(NoTermError, match="remove the manager's journals"):
        next_term(127, 4094)


class _TwoMasterships:
    """Two managers that are active at the same time, on two sides of a broken bus."""

    def __init__(self) -> None:
        self.turns = {node: Turn(node, 0, term=next_term(node, 0)) for node in MANAGER_NODES}
        self.numbers = {node: EpochNumbers(turn) for node, turn in self.turns.items()}
        self.given: dict[int, int] = {}
        for node in MANAGER_NODES:
            self.begin(node)

    def begin(self, node: int) -> None:
        self.numbers[node].begin(self.turns[node].term)

    def give(self, node: int, newest_seen: int) -> int:
        epoch = self.numbers[node].next(newest_seen)
        assert self.given.setdefault(epoch, node) == node
        assert not is_newer(epoch, self.turns[node].memory.reserved[EPOCHS])
        assert is_newer(epoch, newest_seen)
        return epoch

    def restart(self, node: int) -> None:
        before = self.turns[node]
        memory = Memory(before.term, before.memory.reserved)
        self.turns[node] = Turn(node, 0, term=next_term(node, before.term), memory=memory)
        self.numbers[node] = EpochNumbers(self.turns[node])
        self.begin(node)


@given(st.lists(st.tuples(st.sampled_from(MANAGER_NODES), st.sampled_from("grrsgggg")), max_size=120))
@settings(max_examples=part_of(100))
def test_no_epoch_number_is_used_twice_by_either_manager_after_any_restart(steps: list[tuple[int, str]]) -> None:
    is_active, given_by = _TwoMasterships(), dict.fromkeys(MANAGER_NODES, 0)
    numbers: set[int] = set()
    for node, what in steps:
        if what == "r":
            is_active.restart(node)
            continue
        other = next(one for one in MANAGER_NODES if one != node)
        epoch = is_active.give(node, given_by[other] if what == "s" else 0)
        assert epoch not in numbers
        numbers.add(epoch)
        given_by[node] = epoch


def test_numbers_begin_anew_after_the_last_one() -> None:
    turn = Turn(126, 0, term=1)
    numbers = EpochNumbers(turn)
    numbers.begin(1)
    assert numbers.next(65_535) == 1
    other = EpochNumbers(Turn(127, 0, term=2))
    other.begin(2)
    assert other.next(65_535) == EPOCHS_PER_TERM + 1
    assert other.next(65_519) == EPOCHS_PER_TERM + 2
