"""A module fails, hangs, or loses its partition: it is restarted as often as allowed; no other module is affected."""

from dataclasses import replace

from agent.one_pe import (
    CONTROL,
    DEMAND_ID,
    FLYING,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_MONITOR,
    SERVO_1,
    TABLE,
    OnePe,
    emergencies,
    neighbour_state,
    sent,
    started,
)
from heronry_agent.core.step_times import HUNG_NS
from heronry_agent.core.vocabulary import (
    Action,
    Drive,
    EndPartition,
    MeasureStep,
    Note,
    PartitionEnded,
    StepFailed,
    StepMeasured,
    StepModule,
    Stepped,
)
from heronry_agent.module import Value
from heronry_wire.configuration_slice import Slice
from heronry_wire.identifiers import actuator_echo_id
from heronry_wire.management import (
    RESTART_HEARD,
    Control,
    ElementKind,
    FaultCode,
    Lease,
    Operation,
    Step,
)
from heronry_wire.pe_table import PeTable
from heronry_wire.sansio import Tick

ALL = Slice((*FLYING.modules, RUN_MONITOR), remote=FLYING.remote | {RATE: NEIGHBOUR}, publish=FLYING.publish)


def table(restarts: int = 2, **partitions: str) -> PeTable:
    """The table, with its modules in partitions (`flight` where none is named) and with restarts."""
    modules = (
        replace(module, partition=partitions.get(module.name, "flight"), restarts=restarts) for module in TABLE.modules
    )
    return replace(TABLE, modules=tuple(modules))


class Partitioned(OnePe):
    """A PE whose modules answer, except those that hang."""

    def __init__(self, table: PeTable) -> None:
        super().__init__(table)
        self.hanging: set[int] = set()
        self.spent_by_hanging_ns = HUNG_NS
        self.raising: set[int] = set()
        self.held: dict[int, int] = {}

    def answer(self, module: int, release: int) -> list[Action]:
        if module in self.hanging:
            self.held[module] = release
            return []
        if module in self.raising:
            return self.give(StepFailed(module, release, "of all things"))
        return super().answer(module, release)

    def give(self, event) -> list[Action]:
        actions = super().give(event)
        for action in list(actions):
            if isinstance(action, MeasureStep):
                actions += self.give(StepMeasured(action.module, action.release, self.spent_by_hanging_ns))
        return actions

    def codes(self, actions: list[Action]) -> list[tuple[str, int, int]]:
        """Code, index and detail of each report; modules here give nothing, and reports of that are left out."""
        return [(e.code.name, e.index, e.detail) for e in emergencies(actions) if e.code is not FaultCode.STALE]

    def heard_of(self) -> dict[tuple[str, int], int]:
        """Number of reports so far, by code and module."""
        found: dict[tuple[str, int], int] = {}
        for code, index, _ in self.codes([action for _, action in self.done]):
            found[code, index] = found.get((code, index), 0) + 1
        return found


def flying(**options) -> Partitioned:
    pe = Partitioned(table(**options))
    pe.configure(ALL, 7)
    pe.hear(neighbour_state(7))
    return pe


def fly(pe: Partitioned, duration_ns: int) -> list[Action]:
    return pe.fly(duration_ns, epoch=7, digest=1007)


def step_of(actions: list[Action], module: int) -> StepModule:
    (step,) = (a for a in actions if isinstance(a, StepModule) and a.module == module)
    return step


# Failing


def test_a_new_active_manager_gets_the_report_of_a_stopped_module_and_a_cleared_one_begins_again() -> None:
    pe = flying(restarts=0)
    pe.raising.add(CONTROL)
    fly(pe, 100 * MS)
    pe.command(Control(1, NODE, Operation.ACKNOWLEDGE, ElementKind.MODULE, CONTROL))
    assert pe.codes(fly(pe, 100 * MS)) == []
    assert pe.codes(pe.command(Lease(2, 7, Step.GO_ALL, 1007))) == [("MODULE_EXCEPTION", CONTROL, 0)]
    pe.command(Control(2, NODE, Operation.CLEAR, ElementKind.MODULE, CONTROL))
    pe.raising.clear()
    assert CONTROL not in pe.running
    assert pe.codes(pe.command(Lease(3, 7, Step.GO_ALL, 1007))) == []
    assert CONTROL in pe.running


def test_a_partition_that_ended_is_told_with_the_modules_that_ended_with_it() -> None:
    pe = flying(restarts=0)
    told = [
        action.text for action in pe.give(PartitionEnded("flight", "exit code 1", CONTROL)) if isinstance(action, Note)
    ]
    assert told == ["module control is stopped: partition flight, with control, servo_1, monitor, ended: exit code 1"]


def test_a_module_that_was_cleared_and_waits_for_go_begins_with_it() -> None:
    pe = flying(restarts=0)
    pe.configure(FLYING, 8, step=Step.BREAK)
    pe.raising.add(CONTROL)
    fly(pe, 100 * MS)
    pe.command(Control(1, NODE, Operation.CLEAR, ElementKind.MODULE, CONTROL))
    pe.raising.clear()
    pe.command(Lease(2, 8, Step.BREAK, 1008))
    assert CONTROL not in pe.running
    pe.command(Lease(2, 8, Step.GO_ALL, 1008))
    assert CONTROL in pe.running


def test_an_acknowledged_restart_is_told_no_more_and_leaves_no_error() -> None:
    pe = flying()
    pe.raising.add(CONTROL)
    pe.pass_time(0)
    pe.raising.clear()
    pe.command(Control(1, NODE, Operation.ACKNOWLEDGE, ElementKind.MODULE | RESTART_HEARD, CONTROL))
    pe.done.clear()
    fly(pe, 100 * MS)
    assert pe.heard_of() == {}
    assert pe.core.modules.faults.register == 0
    assert CONTROL in pe.running


def test_a_configuration_that_stops_a_module_ends_its_wait() -> None:
    pe = flying()
    pe.raising.add(CONTROL)
    pe.pass_time(50 * MS)
    assert pe.core.modules.restarts.waiting == {CONTROL}
    pe.configure(Slice((RUN_MONITOR,), remote={RATE: NEIGHBOUR}), 8)
    assert started(pe.pass_time(200 * MS)) == []
    assert pe.running == {MONITOR: 0}


# Hanging


def test_one_that_could_not_run_is_not_accused() -> None:
    pe = flying()
    pe.hanging.add(CONTROL)
    pe.spent_by_hanging_ns = 1 * MS
    actions = fly(pe, 500 * MS)
    assert [a for a in actions if isinstance(a, EndPartition)] == []
    assert pe.heard_of() == {}
    assert len([a for a in actions if isinstance(a, MeasureStep)]) > 2


# Partitions that end


# Outputs


def test_an_answer_that_comes_after_a_pause_drives_nothing_that_may_not_be_driven() -> None:
    pe = flying()
    pe.hanging.add(SERVO_1)
    pe.pass_time(0)
    pe.now_ns += 500 * MS  # this process stood still, and no frame was heard since
    actions = pe.give(Stepped(SERVO_1, pe.held[SERVO_1], {}, (1.5,)))
    assert [a for a in actions if isinstance(a, Drive)] == []
    assert sent(actions, actuator_echo_id(NODE)) == []
    assert pe.core.counts["write held", SERVO_1] == 1


def test_a_branch_may_drive_as_long_as_another_node_was_heard_and_no_longer() -> None:
    pe = flying()
    heard_ns = pe.now_ns
    pe.hanging.add(SERVO_1)
    step = step_of(pe.pass_time(0), SERVO_1)
    assert step.until_ns == heard_ns + pe.core.lease_ns


# Modes


def test_a_chain_over_two_partitions_hands_on_within_the_instant() -> None:
    pe = flying(servo_1="servos")
    outputs: dict[str, Value] = {"demand": 0.25}
    pe.outputs[CONTROL] = outputs
    pe.hanging.add(CONTROL)
    actions = pe.give(Tick())
    assert [a.module for a in actions if isinstance(a, StepModule)] == [CONTROL, MONITOR]
    pe.hanging.clear()
    pe.now_ns += 2 * MS
    pe.give(Stepped(CONTROL, pe.held[CONTROL], outputs))
    assert pe.seen[SERVO_1] == {"": 0.25}
    assert FaultCode.MODULE_OVERRUN.name not in {code for code, _ in pe.heard_of()}
    assert DEMAND_ID in {frame.can_id for frame in sent([a for _, a in pe.done], DEMAND_ID)}
