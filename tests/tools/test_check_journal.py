"""The oracle of the journal: on the simulated disk the journal must agree with the frames, after any fault."""

from random import Random

import pytest

from heronry_manager import events
from heronry_manager.core.memory import (
    EPOCHS,
    NOTHING,
    Cleared,
    Latched,
    Memory,
    PhaseEntered,
    Record,
    Reserved,
    Runs,
    TermBegun,
    as_json,
)
from heronry_manager.shell.journal import recovered, whole_journal, written
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.oracles.journal import JournalCheck
from heronry_tools.sim.world.disk import SYNCED_AFTER_NS, Disk
from heronry_wire.management import (
    Control,
    ElementKind,
    Lease,
    ManagementMessage,
    Operation,
    Ping,
    Prepare,
    SliceHead,
    Step,
)
from scenarios.flights import MS, big_blue, two_tails

PHASES = list(big_blue().phases)
MODULES = list(big_blue().modules)
WHOLE = (
    TermBegun(3),
    Reserved(EPOCHS, 48),
    Runs(33, 7, "00"),
    PhaseEntered(PHASES[1]),
    Latched(f"module:{MODULES[2]}", "nav", "REPORTED", 0),
)


def memory(*records: Record) -> Memory:
    known = NOTHING
    for record in records:
        known = known.after(record)
    return known


def assessed(*said: ManagementMessage, records: tuple[Record, ...] = WHOLE, died: bool = False) -> list[str]:
    """Violations of a manager that sends these messages, with these records on its disk."""
    data = whole_journal(big_blue(), memory(*records))
    check = JournalCheck(big_blue(), lambda _: data)
    for message in said:
        check.commanded(0, "manager 126", message)
    if died:
        check.manager_died(1, "manager 126")
    assert {violation.rule for violation in check.violations} <= {"journal"}
    return [violation.story for violation in check.violations]


def test_a_manager_that_sends_what_it_has_written_breaks_nothing() -> None:
    said = (
        Lease(3, 0, Step.PREPARED, 0),
        Prepare(3, 33, 7),
        SliceHead(92, 33, 0, 0),
        Ping(3, 92, 0),
        Lease(3, 33, Step.BREAK, 7),
        Lease(3, 33, Step.GO_ALL, 7),
        Control(3, 0, Operation.HOLDS, ElementKind.PHASE, 1),
        Control(3, 0, Operation.HOLDS, ElementKind.MODULE, 2),
        Control(3, 0, Operation.CLEAR, ElementKind.MODULE, 1),
        Control(3, 92, Operation.ACKNOWLEDGE, ElementKind.MODULE, 5),
    )
    assert assessed(*said, died=True) == []
    assert assessed(Control(3, 0, Operation.HOLDS, ElementKind.PHASE, 0), records=(TermBegun(3),)) == []


def test_a_manager_may_prepare_what_it_has_adopted_for_a_pe_that_is_late() -> None:
    adopted = (TermBegun(3), Reserved(EPOCHS, 48), Runs(60, 7, "00"))
    said = Lease(3, 60, Step.GO_ALL, 7), Prepare(3, 60, 7)
    assert assessed(*said, records=adopted) == []
    beyond = "manager 126 has prepared epoch 61, but the highest reserved is 48"
    assert assessed(*said, Prepare(3, 61, 7), records=adopted) == [beyond]


def test_a_frame_that_waited_while_another_epoch_was_activated_is_no_contradiction() -> None:
    assert assessed(Lease(3, 32, Step.GO_ALL, 9)) == []


def test_a_phase_that_changes_while_its_frame_waits_is_no_contradiction_until_it_is_sent_again() -> None:
    before, after = (whole_journal(big_blue(), memory(*WHOLE, PhaseEntered(PHASES[i]))) for i in (0, 1))
    disks = iter((before, after, after))
    check = JournalCheck(big_blue(), lambda _: next(disks))
    holds = Control(3, 0, Operation.HOLDS, ElementKind.PHASE, 0)
    check.commanded(0, "manager 126", holds)
    check.commanded(1, "manager 126", holds)
    assert check.violations == []
    check.commanded(2, "manager 126", holds)
    assert f"sends phase {PHASES[0]}" in check.violations[0].story


def test_the_first_phase_may_wait_in_a_frame_for_a_while_though_nothing_records_it() -> None:
    known = memory(*(one for one in WHOLE if not isinstance(one, PhaseEntered)))
    before = whole_journal(big_blue(), known)
    after = before + written(len(known.records()) + 1, as_json(PhaseEntered(PHASES[1])))
    for waited_ns, is_told in ((999_999_999, False), (1_000_000_000, True)):
        disks = iter((before, after, after))
        check = JournalCheck(big_blue(), lambda _, disks=disks: next(disks))  # type: ignore[misc]
        first, second = (Control(3, 0, Operation.HOLDS, ElementKind.PHASE, i) for i in (0, 1))
        for t_ns, holds in ((5, first), (6, second), (5 + waited_ns, first)):
            check.commanded(t_ns, "manager 126", holds)
        assert bool(check.violations) is is_told


def test_a_fault_that_is_cleared_while_its_frame_waits_is_no_contradiction_and_one_that_never_was_is_one() -> None:
    """The fault is latched and cleared within an instant: the oracle has not read the journal in between."""
    element = f"module:{MODULES[2]}"
    holds = Control(3, 0, Operation.HOLDS, ElementKind.MODULE, 2)
    started = whole_journal(big_blue(), memory(*WHOLE))
    number = len(memory(*WHOLE).records()) + 1
    records = (Cleared(element), *(Cleared(f"module:{MODULES[3]}") for _ in range(6)))
    cleared = started + b"".join(written(number + n, as_json(record)) for n, record in enumerate(records))
    check = JournalCheck(big_blue(), lambda _: cleared)
    check.commanded(0, "manager 126", holds)
    assert check.violations == []
    check.commanded(1, "manager 126", Control(3, 0, Operation.HOLDS, ElementKind.MODULE, 3))
    assert "sends HOLDS of module:" in check.violations[0].story


def test_a_phase_that_another_command_has_shown_to_be_over_may_wait_in_a_frame() -> None:
    """The oracle has read the journal since; what was the phase a few records ago may still be told."""
    started = whole_journal(big_blue(), memory(*WHOLE, PhaseEntered(PHASES[0])))
    number = len(memory(*WHOLE, PhaseEntered(PHASES[0])).records()) + 1
    after = started + written(number, as_json(PhaseEntered(PHASES[1])))
    check = JournalCheck(big_blue(), lambda _: after)
    check.commanded(0, "manager 126", Lease(3, 33, Step.GO_ALL, 7))
    check.commanded(1, "manager 126", Control(3, 0, Operation.HOLDS, ElementKind.PHASE, 0))
    assert check.violations == []
    check.commanded(2, "manager 126", Control(3, 0, Operation.HOLDS, ElementKind.PHASE, 2))
    assert f"sends phase {PHASES[2]}" in check.violations[0].story


@pytest.mark.parametrize(
    ("message", "lacks", "story"),
    [
        (Lease(3, 0, Step.PREPARED, 0), TermBegun, "has used term 3, but its journal has 0"),
        (Prepare(3, 33, 7), Reserved, "has prepared epoch 33, but the highest reserved is None"),
        (Lease(3, 33, Step.BREAK, 7), Runs, "sends that epoch 33 runs, but its journal has None"),
        (Control(3, 0, Operation.HOLDS, ElementKind.MODULE, 2), Latched, "sends HOLDS of module:"),
    ],
)
def test_what_is_sent_and_not_written_is_found(message: ManagementMessage, lacks: type, story: str) -> None:
    assert assessed(message) == []
    (found,) = assessed(message, records=tuple(record for record in WHOLE if not isinstance(record, lacks)))
    assert story in found


def test_what_is_written_and_not_so_is_found() -> None:
    assert "its journal has Runs(epoch=33, digest=7" in assessed(Lease(3, 33, Step.GO_ALL, 8))[0]
    assert f"sends phase {PHASES[2]}" in assessed(Control(3, 0, Operation.HOLDS, ElementKind.PHASE, 2))[0]
    assert "sends CLEAR of module:" in assessed(Control(3, 0, Operation.CLEAR, ElementKind.MODULE, 2))[0]


def test_numbers_that_are_gone_when_a_manager_dies_are_found_and_facts_may_go() -> None:
    data = [whole_journal(big_blue(), memory(*WHOLE))]
    check = JournalCheck(big_blue(), lambda _: data[0])
    for message in (Lease(3, 33, Step.GO_ALL, 7), Prepare(3, 40, 9)):
        check.commanded(0, "manager 126", message)
    data[0] = whole_journal(big_blue(), memory(*WHOLE[:2]))
    check.manager_died(1, "manager 126")
    check.manager_died(1, "manager 127")  # has never sent anything
    assert check.violations == []
    data[0] = whole_journal(big_blue(), memory(TermBegun(1), Reserved(EPOCHS, 32)))
    check.manager_died(2, "manager 126")
    assert [violation.story.split(",")[0] for violation in check.violations] == [
        "manager 126 has used term 3",
        "manager 126 has prepared epoch 40",
    ]


def test_of_a_disk_that_takes_nothing_nothing_is_promised() -> None:
    check = JournalCheck(big_blue(), lambda _: None)
    check.commanded(0, "manager 126", Lease(3, 33, Step.GO_ALL, 7))
    check.manager_died(1, "manager 126")
    assert check.violations == []


def test_a_twin_answers_for_its_copy_and_for_no_disk_that_it_had_before() -> None:
    fresh = whole_journal(big_blue(), memory(TermBegun(3), Reserved(EPOCHS, 16)))
    disks = {"manager 126": fresh, "manager 126 again": whole_journal(big_blue(), memory(*WHOLE))}
    check = JournalCheck(big_blue(), disks.__getitem__)
    check.manager_copied("manager 126", "manager 126 again")
    check.commanded(0, "manager 126 again", Prepare(3, 40, 9))
    check.manager_died(1, "manager 126 again")
    check.commanded(2, "manager 126", Prepare(3, 5, 9))
    disks["manager 126 again"] = fresh
    check.manager_copied("manager 126", "manager 126 again")
    check.commanded(3, "manager 126 again", Lease(3, 0, Step.PREPARED, 0))
    check.commanded(3, "manager 126 again", Prepare(3, 40, 9))  # for a PE that is late: it has adopted that epoch
    check.manager_died(4, "manager 126 again")
    assert check.violations == []
    disks["manager 126 again"] = whole_journal(big_blue(), memory(TermBegun(1)))  # less than it was given
    check.manager_died(5, "manager 126 again")
    assert [violation.story for violation in check.violations] == [
        "manager 126 again has used term 3, but its journal has 1",
        "manager 126 again has prepared epoch 5, but the highest reserved is None",
    ]


# The disk


def test_a_power_cut_takes_what_was_not_synced_and_no_number() -> None:
    for seed in range(200):
        disk, random = Disk(two_tails()), Random(seed)
        disk.opened()
        for n, record in enumerate(WHOLE):
            disk.write(record, n * MS)
        disk.torn(random, 5 * MS)
        left = disk.opened()
        assert (left.term, left.reserved) == (3, {EPOCHS: 48})
        assert left in [memory(*WHOLE[:n]) for n in range(2, 6)]
    assert disk.data == whole_journal(two_tails(), left)


def test_the_power_may_go_again_before_the_disk_takes_anything() -> None:
    for seed in range(50):
        disk, random = Disk(two_tails()), Random(seed)
        disk.opened()
        for record in WHOLE:
            disk.write(record, 0)
        disk.refuses = True
        disk.torn(random, 0)
        left = disk.data
        disk.opened()
        disk.torn(random, SYNCED_AFTER_NS)
        assert disk.data == left


def test_what_was_synced_stays() -> None:
    disk = Disk(two_tails())
    disk.opened()
    for record in WHOLE:
        disk.write(record, 0)
    disk.torn(Random(1), SYNCED_AFTER_NS)
    assert disk.opened() == memory(*WHOLE)


def test_a_disk_that_takes_nothing_reports_that_and_gets_the_whole_journal_when_it_can() -> None:
    disk = Disk(two_tails())
    disk.opened()
    disk.write(WHOLE[0], 0)
    disk.refuses = True
    disk.write(WHOLE[1], 1)
    disk.write(WHOLE[2], 2)
    assert disk.problem is not None
    assert recovered(disk.data)[0] == memory(WHOLE[0])
    disk.refuses = False
    disk.write(WHOLE[3], 3)
    assert disk.problem is None
    assert recovered(disk.data)[0] == memory(*WHOLE[:4])


def test_a_manager_that_starts_on_a_disk_that_takes_nothing_knows_what_is_there_and_reports_that() -> None:
    simulation = Simulation(two_tails(), 1)
    simulation.managers.disks[126].refuses = True
    simulation.run_for(2_000 * MS)
    assert len(simulation.events_of(events.JournalFailed)) == 1
    simulation.managers.disks[126].refuses = False
    simulation.fleet.kill("tail_pe")
    simulation.run_for(500 * MS)
    assert len(simulation.events_of(events.JournalKept)) == 1
    assert simulation.settle() == []


# A manager that does not keep what it should


@pytest.mark.parametrize("lost", [TermBegun, Reserved, Runs])
def test_a_journal_that_loses_records_is_found_in_flight(lost: type, monkeypatch: pytest.MonkeyPatch) -> None:
    keep = Disk.write

    def forgetful(disk: Disk, record: Record, now_ns: int) -> None:
        if not isinstance(record, lost):
            keep(disk, record, now_ns)

    monkeypatch.setattr(Disk, "write", forgetful)
    simulation = Simulation(two_tails(), 1)
    simulation.run_for(2_000 * MS)
    assert {violation.rule for violation in simulation.broken()} == {"journal"}
