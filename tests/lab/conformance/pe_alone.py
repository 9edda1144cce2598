"""A PE without a manager (protocol rule 7): it keeps its modules, or stops the expendable ones."""

from dataclasses import replace

from heronry_wire.management import RESTART_HEARD, Control, ElementKind, Lease, Operation, Step
from heronry_wire.state_frames import PeFlags, PeState
from lab.conformance import puppets
from lab.conformance.pe_under_test import (
    EVERYTHING,
    HEIGHT_ID,
    HELP_ID,
    HELPER,
    LAMP,
    LEASE_NS,
    NODE,
    PERIOD_NS,
    TABLE,
    PeUnderTest,
)
from lab.conformance.player import MS, demand, equal

_EPOCH, _DIGEST = 17, 0x111111
_PART = replace(EVERYTHING, expendable=frozenset((HELPER,)))


def _flying() -> PeUnderTest:
    pe = PeUnderTest(replace(TABLE, without_manager="safe_mode")).attended()
    puppets.behave_normally()
    pe.flies(_PART)
    pe.run_until(pe.now_ns // PERIOD_NS * PERIOD_NS + 5 * MS)
    return pe


def it_keeps_what_it_runs() -> None:
    """With `keep` no module stops, however long no manager is active; the state reports that no LEASE is heard."""
    pe = PeUnderTest().attended()
    puppets.behave_normally()
    pe.flies()
    pe.lease = pe.alive = None
    began_ns = pe.run(1000)
    for identifier in (HEIGHT_ID, HELP_ID):
        demand(bool(pe.data(identifier, began_ns + 900 * MS)), f"without a manager nothing is sent under {identifier}")
    page = pe.page_0()
    equal((page.state, page.flags), (PeState.ACTIVE, PeFlags(0)), "without a manager it says")


def what_is_expendable_rests_after_t_lease() -> None:
    """Expendable modules stop after T_lease and not earlier; the PE reports the same state, and another load."""
    pe = _flying()
    leased_ns = pe.now_ns // PERIOD_NS * PERIOD_NS
    pe.lease = pe.alive = None
    pe.run_until(leased_ns + 500 * MS)
    last_ns = pe.data(HELP_ID, -1)[-1][0]
    demand(75 * MS < last_ns - leased_ns < LEASE_NS + 3 * MS, f"it rests {(last_ns - leased_ns) / MS} ms after LEASE")
    demand(bool(pe.data(HEIGHT_ID, leased_ns + 450 * MS)), "what is not expendable rests")
    page = pe.page_0()
    equal((page.state, page.epoch, page.digest), (PeState.ACTIVE, _EPOCH, _DIGEST), "while a part rests it says")
    equal(pe.page_1().load, 80, "load while a part rests")
    told_ns = [t_ns for t_ns, one in pe.pages_1(leased_ns) if one.load == 80]
    demand(told_ns[0] < leased_ns + LEASE_NS + 3 * MS, "that a part rests is not reported immediately")


def what_rests_starts_when_it_is_named_again() -> None:
    """Stopped modules start with a LEASE of any term that names this very configuration, and with no other LEASE."""
    pe = _flying()
    pe.lease = pe.alive = None
    began_ns = pe.run(300)
    for lease, starts in (
        (Lease(5, 0, Step.PREPARED, 0), False),
        (Lease(5, _EPOCH, Step.GO_ALL, _DIGEST + 1), False),
        (Lease(7, _EPOCH, Step.GO_ALL, _DIGEST), True),
    ):
        pe.lease = lease
        pe.run(45)
        began_ns = pe.run(50)
        equal(bool(pe.data(HELP_ID, began_ns)), starts, f"what rests runs after {lease}")
    told = [one for one in pe.pages_1(began_ns - 45 * MS) if one[1].load == 100]
    demand(bool(told) and told[0][0] - began_ns < 0, "that everything runs again is not reported immediately")
    pe.run(200)
    equal(pe.page_1().load, 100, "load when everything runs again")


def what_was_cleared_rests_with_the_others() -> None:
    """A module that failed and was cleared is still expendable: a new term that names no configuration starts none."""
    pe = PeUnderTest(replace(TABLE, without_manager="safe_mode")).attended()
    puppets.behave_normally()
    pe.flies(replace(EVERYTHING, expendable=frozenset((HELPER, LAMP))))
    helps, puppets.BEHAVIOUR["helper"] = puppets.BEHAVIOUR["helper"], puppets.raising
    pe.run(800)
    puppets.BEHAVIOUR["helper"] = helps
    for operation, kind in (
        (Operation.ACKNOWLEDGE, ElementKind.MODULE),
        (Operation.ACKNOWLEDGE, ElementKind.MODULE | RESTART_HEARD),
        (Operation.CLEAR, ElementKind.MODULE),
    ):
        pe.main.command(Control(pe.term, NODE, operation, kind, HELPER))
        pe.run(5)
    pe.lease = pe.alive = None
    pe.run(400)
    for lease, starts in (
        (Lease(pe.term + 2, 0, Step.PREPARED, 0), False),
        (Lease(pe.term + 2, _EPOCH, Step.GO_ALL, _DIGEST), True),
    ):
        pe.lease = lease
        began_ns = pe.run(300)
        equal(bool(pe.data(HELP_ID, began_ns)), starts, f"what was cleared runs after {lease}")


def a_new_configuration_starts_what_it_wants() -> None:
    """A new configuration also starts modules that stopped because no manager was active."""
    pe = _flying()
    kept = pe.lease, pe.alive
    pe.lease = pe.alive = None
    pe.run(300)
    pe.lease, pe.alive = Lease(5, 0, Step.PREPARED, 0), kept[1]
    pe.run(45)
    pe.flies(_PART, _EPOCH + 1, _DIGEST + 1)
    began_ns = pe.run(50)
    demand(bool(pe.data(HELP_ID, began_ns)), "a new configuration does not start what rested")


def it_rests_again() -> None:
    """Expendable modules stop again, each time that the manager is lost."""
    pe = _flying()
    lease = pe.lease
    for _ in range(2):
        pe.lease = None
        pe.run(200)
        began_ns = pe.run(50)
        equal(pe.data(HELP_ID, began_ns), [], "data of what rests")
        pe.lease = lease
        pe.run(45)
        began_ns = pe.run(50)
        demand(bool(pe.data(HELP_ID, began_ns)), "what rested does not run")
