"""Faults that a PE reports until they are acknowledged: EMCY, emergency events, quiet, CLEAR; modules that overrun."""

from dataclasses import replace

from agent.one_pe import (
    BEAT_NS,
    CONTROL,
    GATEWAY_TABLE,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_MONITOR,
    TABLE,
    OnePe,
    emergencies,
    sent,
)
from heronry_agent.core.modules.schedule import OVERRUNS_IN_A_ROW, Schedule
from heronry_agent.core.reports import Faults
from heronry_wire.configuration_slice import Slice
from heronry_wire.frame import Frame
from heronry_wire.identifiers import emergency_event_id
from heronry_wire.management import (
    RESTART_HEARD,
    Control,
    ElementKind,
    FaultCode,
    Lease,
    Operation,
    Step,
)

LEFT = 1  # the servo, as a device of the table
CRITICAL = replace(TABLE, flight_critical=("device:left",))
WATCHING = Slice((RUN_MONITOR,), remote={RATE: NEIGHBOUR})
ABOUT_LEFT = (ElementKind.DEVICE, LEFT)


def watching(*, reports: bool = True) -> OnePe:
    pe = OnePe(CRITICAL)
    pe.configure(WATCHING, 7)
    pe.reports[MONITOR] = (("device:left", 57),) if reports else ()
    return pe


def test_clearing_twice_what_was_never_told_or_for_another_pe_says_nothing() -> None:
    pe = watching(reports=False)
    assert pe.command(Control(1, 0, Operation.CLEAR, *ABOUT_LEFT)) == []
    pe.reports[MONITOR] = (("device:left", 57),)
    pe.pass_time(2 * BEAT_NS)
    pe.reports[MONITOR] = ()
    assert pe.command(Control(1, NEIGHBOUR, Operation.CLEAR, *ABOUT_LEFT)) == []
    assert len(emergencies(pe.command(Control(1, 0, Operation.CLEAR, *ABOUT_LEFT)))) == 1
    assert pe.command(Control(1, 0, Operation.CLEAR, *ABOUT_LEFT)) == []
    assert emergencies(pe.pass_time(3 * BEAT_NS)) == []


def test_a_gateway_passes_the_emergency_events_of_nodes_beyond_toward_the_manager() -> None:
    pe = OnePe(GATEWAY_TABLE)
    event = Frame(emergency_event_id(94), bytes(8))
    assert sent(pe.hear(event, port=1), emergency_event_id(94), port=0) == [event]
    assert pe.hear(event, port=0) == []


def test_a_step_in_time_forgives_those_before_it() -> None:
    schedule = Schedule()
    schedule.start(CONTROL, 40_000, 0)

    def step(took_ns: int) -> bool:
        release = schedule.begin(CONTROL, 0)
        assert schedule.end(CONTROL, release, took_ns)
        return schedule.overruns_now(CONTROL)

    for _ in range(3):
        assert not any(step(26 * MS) for _ in range(OVERRUNS_IN_A_ROW - 1))
        assert not step(25 * MS)
    assert [step(26 * MS) for _ in range(OVERRUNS_IN_A_ROW)] == [False] * (OVERRUNS_IN_A_ROW - 1) + [True]


def test_a_new_mastership_is_told_what_still_stands_also_of_what_runs_here_no_more() -> None:
    pe = watching()
    pe.pass_time(BEAT_NS)
    pe.command(Control(1, NODE, Operation.ACKNOWLEDGE, *ABOUT_LEFT))
    pe.reports.clear()
    pe.configure(Slice(()), 8)
    assert not emergencies(pe.fly(5 * BEAT_NS, epoch=8, digest=1008))
    (told,) = emergencies(pe.command(Lease(2, 8, Step.GO_ALL, 1008)))
    assert (told.kind, told.index) == ABOUT_LEFT
    pe.command(Control(2, NODE, Operation.ACKNOWLEDGE, *ABOUT_LEFT), Control(2, NODE, Operation.CLEAR, *ABOUT_LEFT))
    assert not emergencies(pe.command(Lease(3, 8, Step.GO_ALL, 1008)))


def test_that_a_restart_was_heard_makes_no_fault_younger() -> None:
    """It was found, and acknowledged, before this PE was alone: the PE may have missed the CLEAR."""
    faults = Faults(NODE, BEAT_NS)
    faults.found(FaultCode.MODULE_EXCEPTION, ElementKind.MODULE, MONITOR, 0, 0)
    faults.acknowledge(ElementKind.MODULE, MONITOR, MS)
    faults.found(FaultCode.MODULE_RESTARTED, ElementKind.MODULE, MONITOR, 1, 20 * MS)
    assert faults.acknowledge(ElementKind.MODULE | RESTART_HEARD, MONITOR, 21 * MS)
    assert faults.tell_all_again(10 * MS, 30 * MS) == []
    assert len(faults.tell_all_again(MS, 30 * MS)) == 1
