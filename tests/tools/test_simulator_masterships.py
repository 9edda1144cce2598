"""Each oracle of masterships finds the violations that it is for, and no others."""

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.cli import main
from heronry_tools.sim.oracles.oracle import StateSaid
from heronry_tools.sim.oracles.orphans import OrphanCheck
from heronry_tools.sim.oracles.terms import TermCheck
from heronry_wire.management import Activate, Lease, Ping, Prepare, SliceHead, Step
from heronry_wire.state_frames import PeFlags, PeState, StatePage0

SPEC = load(shipped_spec_path("elevator_and_chute"))
NODE = 94
MS = 1_000_000


def running(epoch: int, *, incarnation: int = 1, hears: bool = False, state: PeState = PeState.ACTIVE) -> StatePage0:
    return StatePage0(state, PeFlags.HEARS_LEASE if hears else PeFlags(0), incarnation, epoch, 0, 7)


def terms() -> TermCheck:
    """Manager 126 has prepared epoch 1 in term 1, and 127 epoch 17 in term 2."""
    check = TermCheck(SPEC)
    check.follow_command(0, 126, Prepare(1, 1, 7), "manager 126")
    check.follow_command(1, 126, SliceHead(NODE, 1, 0, 0), "manager 126")
    check.follow_command(2, 127, Prepare(2, 17, 7), "manager 127")
    return check


def test_managers_that_keep_to_their_terms_are_well() -> None:
    check = terms()
    for epoch in (1, 17, 17):
        check.said(StateSaid(3, "can0", NODE, "", running(epoch)))
    check.follow_command(4, 127, Lease(2, 17, Step.GO_ALL, 7), "manager 127")
    check.follow_command(5, 126, Lease(3, 17, Step.GO_ALL, 7), "manager 126")
    check.said(StateSaid(6, "can0", NODE, "", running(5)))  # prepared before anybody watched
    assert check.violations == []


def test_an_epoch_that_a_later_mastership_adopts_is_of_that_one() -> None:
    for digest, is_seen in ((7, False), (8, True)):
        check = terms()
        check.follow_command(3, 126, Lease(3, 1, Step.GO_ALL, digest), "manager 126")
        check.said(StateSaid(4, "can0", NODE, "", running(17)))
        check.said(StateSaid(5, "can0", NODE, "", running(1)))
        assert bool(check.violations) is is_seen


def test_a_manager_that_adopts_an_epoch_does_not_bind_a_pe_that_runs_it_and_has_not_heard_of_that() -> None:
    check = terms()
    check.follow_command(3, 126, Lease(3, 1, Step.GO_ALL, 7), "manager 126")
    check.said(StateSaid(4, "can0", NODE, "", running(1)))
    check.said(StateSaid(5, "can0", NODE, "", running(17)))
    assert check.violations == []


def test_two_managers_in_one_term_are_seen() -> None:
    check = terms()
    check.follow_command(9, 126, Ping(2, NODE, 0), "manager 126")
    assert [violation.rule for violation in check.violations] == ["mastership"]


def test_a_manager_that_goes_back_to_an_older_term_is_seen() -> None:
    check = terms()
    check.follow_command(8, 126, Lease(5, 0, Step.PREPARED, 0), "manager 126")
    check.follow_command(9, 126, Activate(3, 1, Step.GO_ALL, 7), "manager 126")
    assert "went back from term 5 to 3" in check.violations[0].story


def test_a_lease_that_goes_back_to_an_older_epoch_in_its_term_is_seen() -> None:
    check = terms()
    for epoch in (17, 18, 0, 18, 19):
        check.follow_command(3, 127, Lease(2, epoch, Step.GO_ALL, 7), "manager 127")
    check.follow_command(4, 127, Prepare(2, 17, 7), "manager 127")
    check.follow_command(5, 127, Activate(2, 17, Step.GO_ALL, 7), "manager 127")
    check.follow_command(6, 127, Lease(4, 1, Step.GO_ALL, 7), "manager 127")
    assert check.violations == []
    check.follow_command(7, 127, Lease(4, 49, Step.GO_ALL, 7), "manager 127")
    check.follow_command(8, 127, Lease(4, 48, Step.GO_ALL, 9), "manager 127")
    check.manager_died(8, "manager 127")
    check.follow_command(9, 127, Lease(4, 33, Step.GO_ALL, 9), "manager 127")
    check.follow_command(9, 127, Lease(4, 32, Step.GO_ALL, 9), "manager 127")
    assert [violation.story for violation in check.violations] == [
        "manager 127 goes back from epoch 49 to 48 in term 4",
        "manager 127 goes back from epoch 33 to 32 in term 4",
    ]


def test_a_number_that_two_terms_prepare_is_seen() -> None:
    check = terms()
    check.follow_command(9, 127, Prepare(2, 1, 9), "manager 127")
    assert "epoch 1 is prepared with one digest in term 2" in check.violations[0].story


def test_of_two_copies_of_a_journal_each_counts_for_itself_and_with_what_it_has_used() -> None:
    check = TermCheck(SPEC)
    check.manager_copied("manager 126", "manager 126 again")
    check.follow_command(0, 126, Prepare(1, 1, 7), "manager 126 again")
    check.follow_command(1, 126, Prepare(2, 1, 8), "manager 126")
    check.manager_copied("manager 126", "manager 126 again")
    check.follow_command(2, 126, Prepare(2, 2, 7), "manager 126 again")
    check.manager_copied("manager 126", "manager 126 again")
    check.follow_command(3, 126, Prepare(3, 2, 8), "manager 126 again")
    check.said(StateSaid(4, "can0", NODE, "", running(1)))
    check.said(StateSaid(4, "can0", NODE, "", running(2)))
    assert check.violations == []
    check.follow_command(5, 126, Prepare(4, 2, 9), "manager 126 again")
    check.follow_command(6, 127, Prepare(5, 1, 9), "manager 127")
    assert [violation.story for violation in check.violations] == [
        "epoch 2 is prepared with one digest in term 4, another in 3",
        "epoch 1 is prepared with one digest in term 5, another in 2",
    ]


def test_a_pe_that_takes_up_what_a_deposed_manager_prepared_is_seen() -> None:
    check = terms()
    check.said(StateSaid(8, "can0", NODE, "", running(17)))
    check.said(StateSaid(9, "can0", NODE, "", running(1, incarnation=2)))
    assert check.violations == []
    check.said(StateSaid(10, "can0", NODE, "", running(17, incarnation=2)))
    check.said(StateSaid(11, "can0", NODE, "", running(1, incarnation=2)))
    assert [violation.rule for violation in check.violations] == ["term"]


def orphans(*said: tuple[int, StatePage0], keeps: bool = True) -> list[str]:
    """What is seen of a PE that says this, at these times, after the last word of a manager at 0."""
    spec = SPEC
    check = OrphanCheck(spec)
    check._keeps = keeps
    check.manager_heard(0)
    for t_ms, page in said:
        check.state_sent(t_ms * MS, NODE, page.encode())
    assert {violation.rule for violation in check.violations} <= {"policy"}
    return [violation.story for violation in check.violations]


def test_a_pe_that_keeps_what_it_runs_is_well() -> None:
    assert orphans((100, running(1, hears=True)), (160, running(1)), (900, running(1))) == []


def test_a_pe_that_hears_a_manager_where_there_is_none_is_seen() -> None:
    assert orphans((230, running(1, hears=True))) == []  # true when it was queued, and sent when a wire was mended
    assert "no manager was on the bus" in orphans((250, running(1, hears=True)))[0]


def test_a_pe_that_changes_without_a_manager_is_seen() -> None:
    assert "from ACTIVE in epoch 1 to ACTIVE in 2" in orphans((160, running(1)), (180, running(2)))[0]
    assert orphans((160, running(1)), (180, running(2)), keeps=False) == []


def test_a_pe_that_stood_still_takes_up_first_what_it_was_told() -> None:
    paused = (20, running(1, hears=True)), (400, running(1, state=PeState.BROKEN)), (401, running(1))
    assert orphans(*paused) == []
    assert "from ACTIVE in epoch 1 to ACTIVE in 2" in orphans(*paused, (421, running(1)), (441, running(2)))[0]


def test_a_pe_that_restarts_without_a_manager_is_well() -> None:
    assert orphans((160, running(1)), (180, running(0, incarnation=2, state=PeState.UNCONFIGURED))) == []


def test_what_is_no_page_0_says_nothing() -> None:
    check = OrphanCheck(SPEC)
    check.state_sent(900 * MS, NODE, running(1, hears=True).encode())  # no manager has ever been heard
    check.manager_heard(0)
    check.state_sent(900 * MS, NODE, b"\xff")
    check.state_sent(900 * MS, 99, running(1, hears=True).encode())
    assert check.violations == []


def test_two_that_were_given_one_number_each_have_terms_of_their_own() -> None:
    check = terms()
    check.follow_command(5, 126, Lease(5, 17, Step.GO_ALL, 7), "manager 126 again")
    check.follow_command(6, 126, Lease(3, 17, Step.GO_ALL, 7), "manager 126")
    assert check.violations == []
    check.follow_command(7, 126, Lease(3, 17, Step.GO_ALL, 7), "manager 126 again")
    assert [violation.story for violation in check.violations] == ["manager 126 went back from term 5 to 3"]


def test_an_epoch_that_a_deposed_manager_still_activates_is_not_the_one_that_runs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    flight = ["sim", "dg_specs/examples/radio_link.dg.yaml", "--seed", "20", "--standby", "--keyed"]
    assert main(flight) == 0, capsys.readouterr().out
