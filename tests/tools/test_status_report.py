"""The status of a manager as lines of text: what is wrong comes first."""

from dataclasses import replace
from typing import Any

import pytest

from heronry_manager.core.vocabulary import AskStatus, ClearElement, FailElement, OperatorSaid, Order, Reply
from heronry_tools.reports.status import report
from heronry_wire.authentication import Key
from heronry_wire.canopen_objects import MODULE_FAILURES
from heronry_wire.element_places import spec_mark
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import LinkState
from heronry_wire.identifiers import emcy_id
from heronry_wire.management import Control, ElementKind, Emergency, FaultCode, Lease, Operation, Step
from heronry_wire.standstill import StoodStill
from heronry_wire.state_frames import PeFlags, PeState, StatePage3
from lab.peers import command_frame
from manager.one_manager import MS, OneManager
from manager.test_pe_details import LEFT, Reading
from manager.test_radio_links import Flight
from manager.test_standby import standing_by


def told(manager: OneManager, *orders: Order) -> list[str]:
    """What the manager reports after these orders."""
    replies: list[Reply] = []
    for order in (*orders, AskStatus()):
        replies += [action for action in manager.give(OperatorSaid(1, order)) if isinstance(action, Reply)]
    status: Any = replies[-1].status
    return list(report(status))


@pytest.fixture
def manager() -> OneManager:
    flying = OneManager()
    flying.start()
    return flying


def test_when_all_is_well_it_says_what_runs(manager: OneManager) -> None:
    assert told(manager) == [
        "two_tails: manager 126 is active, term 1; no key: any node on the bus can command the system",
        "no phases; epoch 1 is done",
        "PEs",
        "  left         up         ACTIVE in epoch 1",
        "  middle       up         ACTIVE in epoch 1",
        "  right        up         ACTIVE in epoch 1",
        "functions, as planned",
        "  elevator         A  served, only, value 100",
        "buses, as planned",
        "  can0         0 bit/s, 0.0 %",
    ]


def test_a_standby_manager_that_lacks_the_spec_that_flies_says_what_to_type() -> None:
    standby = standing_by()
    standby.hear(command_frame(Lease(1, 0, Step.PREPARED, 0)))
    standby.hear(command_frame(Control(1, 0, Operation.HOLDS, ElementKind.SPEC, 0x3F2A)))
    assert told(standby)[2] == (
        "! another spec flies (digest 3f2a...): this manager does not take over until it has it, by 'heronry reload "
        "SPEC --standby'"
    )
    standby.hear(command_frame(Control(1, 0, Operation.HOLDS, ElementKind.SPEC, spec_mark(standby.spec.digest))))
    assert not told(standby)[2].startswith("!")


def test_what_is_wrong_comes_first(manager: OneManager) -> None:
    manager.reboot("right")
    manager.pass_time(100 * MS)
    lines = told(manager, FailElement("device:servo_left"))
    assert lines[1] == "no phases; epoch 1 is done; a plan is being made"
    assert lines[2] == "! device:servo_left counts as failed, reported by the operator (0 s ago)"
    assert lines[6].startswith("  right        returning  UNCONFIGURED: it rebooted (incarnation 2); it joins in 0.")


def test_a_pe_that_was_failed_is_not_shown_as_if_it_flew(manager: OneManager) -> None:
    told(manager, FailElement("pe:right"))
    manager.pass_time(100 * MS)
    (line,) = (line for line in told(manager) if line.startswith("  right "))
    assert line.startswith("  right        down       no plan uses it; its last report: ACTIVE in epoch 1")


def test_failures_of_modules_and_standstills_of_computers_are_shown() -> None:
    manager = Reading()
    manager.start()
    manager.objects[LEFT, MODULE_FAILURES, 1] = b"ValueError: no (control.py:3)"
    manager.emcy(FaultCode.MODULE_RESTARTED, 0, 1)
    manager.give(StoodStill(140 * MS))
    manager.counters(2, 90)
    told(manager)  # reads the counters anew
    lines = told(manager)
    assert lines[2:4] == [
        "! the computer of this manager stood still once, for up to 140 ms",
        "! module:control failed on left, 0 s ago: ValueError: no (control.py:3)",
    ]
    assert lines[5] == (
        "  left         up         ACTIVE in epoch 1; its computer stood still 30 times, for up to 200 ms"
    )


def test_a_pe_s_line_ends_with_what_it_costs_its_computer() -> None:
    manager = Reading()
    manager.start()
    manager.costs(310, 74, 15, 2_350)
    told(manager)  # reads the cost
    assert told(manager)[3].endswith(
        "ACTIVE in epoch 1; 310 wake-ups/s, 7.4 % of a core, its modules 1.5 %, longest turn 2.35 ms"
    )


def test_a_latched_fault_is_told_in_words_with_the_reason_that_its_pe_gives() -> None:
    manager = Reading()
    manager.start()
    manager.objects[LEFT, MODULE_FAILURES, 1] = b"cannot import nomod: no module of that name"
    manager.emcy(FaultCode.MODULE_MISSING, 0)
    lines = [line for line in told(manager) if line.startswith("! module:")]
    why = "its code cannot be run there: cannot import nomod: no module of that name"
    assert lines == [f"! module:control@left counts as failed, reported by left, 0 s ago: {why}"]
    del manager.objects[LEFT, MODULE_FAILURES, 1]
    other = Reading()
    other.start()
    other.emcy(FaultCode.REPORTED, 0, 7)
    (line,) = (line for line in told(other) if line.startswith("! module:"))
    assert line.endswith("reported by left, 0 s ago: a module there reports that it has failed, detail 7")


def test_a_failure_whose_fault_was_cleared_is_told_and_is_no_trouble() -> None:
    manager = Reading()
    manager.start()
    manager.objects[LEFT, MODULE_FAILURES, 1] = b"ValueError: no (control.py:3)"
    manager.emcy(FaultCode.MODULE_EXCEPTION, 0)
    manager.pass_time(3_000 * MS)
    lines = told(manager, ClearElement("module:control@left"))
    assert "mended: module:control failed on left, 3 s ago: ValueError: no (control.py:3)" in lines
    assert not [line for line in lines if line.startswith("!")]


def test_what_a_pe_holds_back_is_shown_with_its_cause(manager: OneManager) -> None:
    page = manager.running["left"]
    manager.running["left"] = replace(page, flags=PeFlags.HEARS_LEASE | PeFlags.OUTPUT_HELD)
    manager.pass_time(200 * MS)
    (line,) = (line for line in told(manager) if line.startswith("  left "))
    assert "; OUTPUTS HELD BACK for 0.2 s (drive_left): it heard no node for longer than T_lease" in line


def test_a_standby_manager_knows_no_plan_and_names_the_active_one() -> None:
    manager = standing_by()
    manager.pass_time(200 * MS)
    lines = told(manager)
    assert "manager 127 is standby" in lines[0]
    assert lines[-1] == "only the active manager knows which functions are served"


def test_before_anything_runs_nothing_is_served() -> None:
    lines = told(OneManager())
    assert lines[0].startswith("two_tails: manager 126 is listening, term 1; ")
    assert "no epoch yet" in lines[1]
    assert lines[-1] == "  elevator         A  NOT SERVED: nothing runs yet"


def test_with_a_key_it_tells_which_and_what_was_refused() -> None:
    manager = OneManager(key=Key(b"k" * 32))
    refused = StatePage3(PeState.UNCONFIGURED, PeFlags(0), 0, 3, 3)
    manager.hear(Frame(manager.state_id("left"), refused.encode()))
    lines = told(manager)
    assert lines[0].endswith(f"key {Key(b'k' * 32).fingerprint}")
    assert "its states carry no valid proof; it refused 6 commands" in lines[3]
    for detail in range(66):  # of these the manager keeps 64, in case that a state proves them
        manager.hear(Frame(emcy_id(LEFT), Emergency(FaultCode.REPORTED, 0, ElementKind.PE, 1, detail).encode()))
    assert "proof; 2 reports in its name were never proven; it refused" in told(manager)[3]


def test_a_radio_that_is_not_whole_is_a_trouble() -> None:
    flight = Flight()
    flight.report(1000)
    assert not any("bus:radio" in line for line in told(flight))
    flight.report(100, times=2)
    assert "! bus:radio has 8 % of its bandwidth; 100 % of frames arrive" in told(flight)
    flight.report(0, LinkState.GONE)
    assert "! bus:radio is gone: no frame comes from beyond it" in told(flight)


def test_what_a_manager_does_not_know_it_does_not_call_unserved() -> None:
    manager = OneManager()
    for pe in manager.spec.pes:
        manager.live(pe, PeState.ACTIVE, epoch=7, digest=5)
    lines = told(manager)
    assert lines[1] == "no phases; epoch 7 runs, which this manager does not know"
    assert lines[-1] == "  elevator         A  not known"
