"""Which inputs and outputs a PE reports as silent, and which not: the clocks, and what restarts them."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from agent.one_pe import (
    BEAT_NS,
    CONTROL,
    DEMAND,
    DEMAND_ID,
    FAR,
    FLYING,
    LEASE_NS,
    MONITOR,
    MS,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_CONTROL,
    RUN_MONITOR,
    RUN_SERVO_1,
    SERVO_1,
    TABLE,
    OnePe,
    emergencies,
    neighbour_state,
    rate_frame,
)
from heronry_agent.core.vocabulary import Action, NotReady
from heronry_wire.canaerospace import DataType, Datum, encode_data
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import Alive, FaultCode, Lease, Step
from heronry_wire.protocol_times import SILENCE_REPORT_NS, START_UP_WINDOW_NS
from heronry_wire.silence import Silence

LIMIT_NS = 5 * 25 * MS  # of `rate` and `demand`
IN_TIME_NS = LIMIT_NS + 2 * BEAT_NS
RATE_LEAF, DEMAND_OUT = Silence(0), Silence(1, is_output=True)


class Flight(OnePe):
    """A PE with an active manager and a neighbour; the test chooses what they send."""

    sends_rate = is_led = is_flanked = True
    gives_demand = False  # the neighbour, not this PE
    neighbours_epoch: int | None = None  # None: the same as this PE's

    def __init__(self, wanted: Slice = FLYING, epoch: int = 7) -> None:
        super().__init__()
        self.held: list[tuple[int, int]] = []  # steps that wait until code is loaded: module and number
        self.outputs = {CONTROL: {"demand": 1.0}, MONITOR: {"alarm": 0}}
        self.epoch = epoch
        self.configure(wanted, epoch)

    def cruise(self, duration_ns: int) -> list[Action]:
        actions = []
        for _ in range(duration_ns // BEAT_NS):
            if self.is_led:
                leased = Lease(1, self.epoch, Step.GO_ALL, 1000 + self.epoch)
                actions += self.command(leased, Alive(1, 0, frozenset({NEIGHBOUR, NODE})))
            if self.is_flanked:
                epoch = self.epoch if self.neighbours_epoch is None else self.neighbours_epoch
                actions += self.hear(neighbour_state(epoch, 1000 + epoch), neighbour_state(epoch, 1, FAR))
            if self.sends_rate:
                actions += self.hear(rate_frame(1.0))
            if self.gives_demand:
                actions += self.hear(encode_data(DEMAND_ID, Datum(NEIGHBOUR, DataType.FLOAT, 0x11, 0, 1.0)))
            actions += self.pass_time(BEAT_NS)
        return actions


class Loading(Flight):
    """Its partitions load their code, and hold back the steps meanwhile."""

    is_loading = True

    def answer(self, module: int, release: int) -> list[Action]:
        self.held.append((module, release))
        return super().answer(module, release) if not self.is_loading else []

    def loaded(self) -> list[Action]:
        self.is_loading = False
        return [action for step in self.held for action in self.give(NotReady(*step))]


def told(actions: list[Action]) -> list[tuple[int, Silence]]:
    """Index of the module, and what is silent, of each report in the actions."""
    return [(one.index, Silence.of(one.detail)) for one in emergencies(actions, FaultCode.STALE)]


def once(told: Sequence[tuple[int, Silence]]) -> list[tuple[int, Silence]]:
    return list(dict.fromkeys(told))


def test_nothing_is_told_while_everything_comes() -> None:
    assert told(Flight().cruise(3_000 * MS)) == []


def test_a_silent_input_is_told_in_time_and_again_and_its_end() -> None:
    pe = Flight()
    pe.cruise(500 * MS)
    pe.sends_rate = False
    assert told(pe.cruise(LIMIT_NS - BEAT_NS)) == []
    assert told(pe.cruise(13 * BEAT_NS)) == 2 * [(CONTROL, RATE_LEAF)]  # twice, in case the first is lost
    assert told(pe.cruise(SILENCE_REPORT_NS)) == [(CONTROL, RATE_LEAF)]
    pe.sends_rate = True
    assert told(pe.cruise(10 * BEAT_NS)) == 2 * [(CONTROL, replace(RATE_LEAF, is_over=True))]
    assert told(pe.cruise(2 * SILENCE_REPORT_NS)) == []


def test_an_input_that_never_came_is_told_when_its_producer_had_time_to_load() -> None:
    pe = Flight()
    pe.sends_rate = False
    assert told(pe.cruise(START_UP_WINDOW_NS + LIMIT_NS - BEAT_NS)) == []
    assert once(told(pe.cruise(4 * BEAT_NS))) == [(CONTROL, RATE_LEAF)]


def test_an_input_that_came_late_is_told_in_time_when_it_is_silent_again() -> None:
    pe = Flight()
    for pe.sends_rate in (False, True):
        assert told(pe.cruise(700 * MS)) == []
    pe.sends_rate = False
    assert once(told(pe.cruise(IN_TIME_NS))) == [(CONTROL, RATE_LEAF)]


def test_a_module_that_loads_its_code_for_seconds_makes_nobody_report_a_silence() -> None:
    """`rate` comes from another PE, `demand` from this one."""
    pe = Loading()
    pe.sends_rate = False
    assert told(pe.cruise(START_UP_WINDOW_NS)) == []
    assert {module for module, _ in pe.held} == {CONTROL}  # the servo waits for its demand
    pe.sends_rate = True
    loaded = pe.loaded()
    assert told(loaded + pe.cruise(2 * SILENCE_REPORT_NS)) == []


def test_an_initial_value_is_no_datum() -> None:
    """`alarm` has one, and its module gives none."""
    pe = Flight(Slice((RUN_MONITOR,), remote={RATE: NEIGHBOUR}))
    pe.outputs = {}
    reported = once(told(pe.cruise(START_UP_WINDOW_NS + 400 * MS)))
    assert (MONITOR, Silence(1)) in reported


@pytest.mark.parametrize("change", [{"is_flanked": False}, {"neighbours_epoch": 6}, {"is_led": False}])
def test_what_the_manager_knows_already_is_not_told(change: dict[str, object]) -> None:
    """The producer's PE is silent, or runs another epoch; or there is no manager."""
    pe = Flight()
    pe.cruise(500 * MS)
    pe.sends_rate = False
    vars(pe).update(change)
    reported = told(pe.cruise(2_000 * MS))
    assert all(module != CONTROL or silence.is_output for module, silence in reported)


@pytest.mark.parametrize("gives_demand", [True, False])
def test_another_datum_of_a_thinned_neighbour_shows_that_it_lives(gives_demand: bool) -> None:
    """This PE receives few states that say nothing new: here none, after the first ones."""
    pe = Flight(Slice((RUN_SERVO_1, RUN_MONITOR), remote={RATE: NEIGHBOUR, DEMAND: NEIGHBOUR}))
    pe.gives_demand = True
    pe.cruise(500 * MS)
    pe.gives_demand, pe.is_flanked, pe.sends_rate = gives_demand, False, False
    assert once(told(pe.cruise(2 * LIMIT_NS))) == ([(MONITOR, RATE_LEAF)] if gives_demand else [])


def test_a_pause_of_the_process_blames_nobody() -> None:
    pe = Flight()
    pe.cruise(500 * MS)
    pe.now_ns += 700 * MS
    assert told(pe.cruise(LIMIT_NS)) == []
    pe.sends_rate = False
    assert once(told(pe.cruise(IN_TIME_NS))) == [(CONTROL, RATE_LEAF)]


def test_a_source_that_moves_has_a_new_clock_and_ends_the_silence_without_a_report() -> None:
    pe = Flight()
    pe.cruise(500 * MS)
    pe.sends_rate = False
    assert once(told(pe.cruise(IN_TIME_NS + BEAT_NS))) == [(CONTROL, RATE_LEAF)]
    pe.epoch = 8
    pe.configure(replace(FLYING, remote={RATE: FAR}), 8)
    assert told(pe.cruise(START_UP_WINDOW_NS + LIMIT_NS)) == []
    assert once(told(pe.cruise(3 * BEAT_NS))) == [(CONTROL, RATE_LEAF)]


def test_a_silence_goes_on_in_a_new_epoch_with_the_same_wire() -> None:
    pe = Flight()
    pe.cruise(500 * MS)
    pe.sends_rate = False
    pe.cruise(400 * MS)
    pe.epoch = 8
    pe.configure(replace(FLYING, modules=(RUN_CONTROL,)), 8)
    assert once(told(pe.cruise(SILENCE_REPORT_NS))) == [(CONTROL, RATE_LEAF)]
    pe.sends_rate = True
    assert once(told(pe.cruise(5 * BEAT_NS))) == [(CONTROL, replace(RATE_LEAF, is_over=True))]


def test_an_output_that_a_module_leaves_out_is_told_with_the_input_of_its_reader() -> None:
    pe = Flight()
    pe.cruise(500 * MS)
    pe.outputs = {}
    reported = told(pe.cruise(IN_TIME_NS + 3 * BEAT_NS))
    assert once(reported) == [(CONTROL, DEMAND_OUT), (SERVO_1, Silence(0))]
    pe.outputs = {CONTROL: {"demand": 1.0}}
    reported = told(pe.cruise(10 * BEAT_NS))
    assert set(reported) == {(SERVO_1, Silence(0, is_over=True)), (CONTROL, replace(DEMAND_OUT, is_over=True))}


def test_a_module_without_its_inputs_is_not_told_for_its_output() -> None:
    pe = Flight()
    pe.cruise(500 * MS)
    pe.sends_rate, pe.outputs = False, {}
    reported = told(pe.cruise(2_000 * MS))
    assert (CONTROL, RATE_LEAF) in reported
    assert (CONTROL, DEMAND_OUT) not in reported


def test_a_silent_output_is_over_even_if_an_input_was_missing_meanwhile() -> None:
    pe = Flight(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}))
    pe.outputs = {}
    pe.cruise(400 * MS)
    pe.sends_rate = False
    pe.cruise(400 * MS)
    pe.sends_rate, pe.outputs = True, {CONTROL: {"demand": 1.0}}
    assert (CONTROL, replace(DEMAND_OUT, is_over=True)) in told(pe.cruise(400 * MS))


def test_a_module_that_has_just_started_has_time() -> None:
    pe = Flight()
    pe.outputs = {}
    assert all(module != CONTROL for module, _ in told(pe.cruise(LIMIT_NS)))


def test_many_silences_take_turns_and_all_are_told() -> None:
    pe = Flight(Slice((RUN_CONTROL, RUN_SERVO_1, RUN_MONITOR), remote={RATE: NEIGHBOUR}))
    pe.cruise(500 * MS)
    pe.sends_rate, pe.outputs = False, {}
    silent = {(CONTROL, Silence(0)), (MONITOR, Silence(0)), (MONITOR, Silence(1)), (SERVO_1, Silence(0))}
    before = pe.cruise(1_000 * MS)
    assert {one for one in told(before) if not one[1].is_output} == silent
    for _ in range(3):
        assert {one for one in told(pe.cruise(SILENCE_REPORT_NS)) if not one[1].is_output} == silent


def test_with_a_heartbeat_as_long_as_a_second_one_silence_is_kept_at_a_time() -> None:
    slow = replace(TABLE, ports=(replace(TABLE.ports[0], heartbeat_ns=SILENCE_REPORT_NS),))
    reports = OnePe(slow).core.modules.silences._reports
    reports.begun(CONTROL, RATE_LEAF, 0)
    assert reports.is_full
    reports.begun(MONITOR, RATE_LEAF, 0)
    assert reports.silent() == [(CONTROL, RATE_LEAF)]
    assert LEASE_NS < LIMIT_NS
