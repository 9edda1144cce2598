"""The judge of reloads: flights made by hand, each with one mistake, which it must find; and one without."""

from pathlib import Path

import pytest

from heronry_dg.configuration import Configuration
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import Situation
from heronry_manager.core.tables import Compiler
from heronry_tools.recording.commanded import Epoch
from heronry_tools.sim.oracles.either_spec import EitherSpecCheck
from heronry_tools.sim.oracles.exclusion import ExclusionCheck
from heronry_tools.sim.oracles.flown_spec import FlownSpec
from heronry_tools.sim.oracles.oracle import StateSaid
from heronry_tools.sim.world.planning import immediate_plan
from heronry_tools.sim.world.steps_seen import Moved
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import PeFlags, PeState, StatePage0

MS, S = 1_000_000, 1_000_000_000
CHANGED = Path(__file__).parents[1] / "scenarios" / "elevator_and_chute_changed.dg.yaml"
OLD, NEW = load(shipped_spec_path("elevator_and_chute")), load(CHANGED)
PES = frozenset(OLD.pes)
SENSOR, CONTROL, TAIL = "sensor_pe", "control_pe", "tail_pe"


def flown(spec: Spec) -> FlownSpec:
    compiler = Compiler(spec)
    return FlownSpec(spec, {pe: compiler.table(pe) for pe in spec.pes})


FLOWN = flown(OLD), flown(NEW)


def plan(spec: Spec) -> Configuration:
    return immediate_plan(spec, Situation(), None).configuration


def table(spec: Spec, pe: str) -> PeTable:
    return FLOWN[spec is NEW].tables[pe]


class Flight:
    """A flight made by hand: all PEs fly by the old spec from the beginning, and then something happens."""

    def __init__(self) -> None:
        """Let the PEs start, and a manager activate the first epoch."""
        self.check = EitherSpecCheck(*FLOWN)
        for pe in PES:
            self.check.flies(0, pe, table(OLD, pe))
            node = OLD.pes[pe].node_id
            self.check.said(StateSaid(0, "can0", node, pe, StatePage0(PeState.ACTIVE, PeFlags(0), 1, 1, 0, 0)))
        self.check.began(0)
        self.check.activated(0, self.epoch(1, OLD))
        self.now_ns = 20 * S
        self.check.alive(self.now_ns, PES)

    def epoch(self, number: int, spec: Spec) -> Epoch:
        return Epoch(number, 0, 0, 1, configuration=plan(spec))

    def activate(self, number: int, spec: Spec) -> None:
        self.check.changes(self.now_ns, spec.digest)
        self.check.activated(self.now_ns, self.epoch(number, spec))

    def switch(self, *pes: str, spec: Spec = NEW) -> None:
        for pe in pes:
            self.check.flies(self.now_ns, pe, table(spec, pe))

    def step(self, pe: str, module: str, after_ns: int = MS) -> None:
        self.now_ns += after_ns
        self.check.stepped(self.now_ns, pe, module)

    def rules(self) -> list[str]:
        return [violation.rule for violation in self.check.violations]


@pytest.fixture
def flight() -> Flight:
    return Flight()


def test_what_goes_on_is_what_is_the_same_in_both() -> None:
    old, new = FLOWN
    assert old.goes_on(new, CONTROL) >= {"elevator_control", "chute_driver", "release_driver"}
    assert not old.goes_on(new, CONTROL) & {"chute_logic", "state_estimator", "servo_monitor", "second_estimator"}


def test_a_change_of_all_pes_is_in_order(flight: Flight) -> None:
    flight.check.reload_ordered()
    flight.activate(2, NEW)
    flight.step(CONTROL, "chute_logic")  # still the old one
    flight.switch(*PES)
    flight.step(CONTROL, "second_estimator")
    flight.step(SENSOR, "chute_logic")
    flight.now_ns += 10 * S
    flight.check.alive(flight.now_ns, PES)
    flight.check.reload_over(is_given_up=False)
    assert flight.check.violations == []
    assert list(flight.check.unsettled(flight.now_ns)) == []


def test_a_pe_that_still_runs_what_another_has_begun_anew_is_a_mixture(flight: Flight) -> None:
    flight.check.reload_ordered()
    flight.activate(2, NEW)
    flight.switch(SENSOR)
    flight.step(SENSOR, "second_estimator")
    flight.step(CONTROL, "elevator_control")  # which is the same in both
    assert flight.rules() == []
    flight.step(CONTROL, "chute_logic")
    flight.step(CONTROL, "chute_logic")
    assert flight.rules() == ["mixture"]


def test_a_pe_that_is_lost_may_run_on(flight: Flight) -> None:
    flight.check.reload_ordered()
    flight.activate(2, NEW)
    flight.check.alive(flight.now_ns, PES - {CONTROL})
    flight.switch(SENSOR, TAIL)
    flight.step(SENSOR, "second_estimator")
    flight.step(CONTROL, "chute_logic")
    assert flight.rules() == []


def test_pes_that_fly_by_two_specs_for_too_long_are_a_mixture(flight: Flight) -> None:
    flight.check.reload_ordered()
    flight.activate(2, NEW)
    flight.switch(SENSOR, TAIL)
    flight.check.alive(flight.now_ns + S, PES)
    assert flight.rules() == []
    assert [violation.rule for violation in flight.check.unsettled(flight.now_ns)] == ["mixture"]
    flight.check.alive(flight.now_ns + 5 * S, PES)
    assert flight.rules() == ["mixture"]


def test_back_to_the_old_spec_is_in_order_too(flight: Flight) -> None:
    flight.check.reload_ordered()
    flight.activate(2, NEW)
    flight.switch(SENSOR)
    flight.check.began(flight.now_ns)
    flight.activate(3, OLD)
    flight.switch(SENSOR, spec=OLD)
    flight.step(SENSOR, "chute_logic")
    flight.step(CONTROL, "chute_logic")
    assert flight.rules() == []
    assert list(flight.check.unsettled(flight.now_ns)) == []


def test_a_change_that_was_given_up_changes_nothing(flight: Flight) -> None:
    flight.activate(2, NEW)
    assert flight.rules() == ["given_up"]  # nobody has ordered it
    flight = Flight()
    flight.check.reload_ordered()
    flight.check.reload_over(is_given_up=True)
    flight.activate(2, NEW)
    assert flight.rules() == ["given_up"]
    flight = Flight()
    flight.check.reload_ordered()
    flight.check.began(flight.now_ns)  # the next manager does not know of the order
    flight.activate(2, NEW)
    assert flight.rules() == ["given_up"]


def test_a_table_that_is_not_whole_is_found(flight: Flight) -> None:
    flight.check.flies(flight.now_ns, SENSOR, table(NEW, TAIL))
    assert flight.rules() == ["whole"]


def test_a_step_that_is_missed_while_the_specs_change_is_found(flight: Flight) -> None:
    module = "elevator_control"
    pe = plan(OLD).modules[module].pe
    assert plan(NEW).modules[module].pe == pe
    flight.check.reload_ordered()
    flight.step(pe, module)
    flight.step(pe, module, 25 * MS)
    flight.activate(2, NEW)
    flight.switch(*PES)
    flight.step(pe, module, 26 * MS)
    assert flight.check.missed_steps([]) == []
    flight.step(pe, module, 50 * MS)
    assert [violation.rule for violation in flight.check.missed_steps(["lost"])] == []
    assert [violation.rule for violation in flight.check.missed_steps(["crash"])] == ["missed"]
    flight.check.gone(pe)
    flight.step(pe, module, 500 * MS)
    assert len(flight.check.missed_steps([])) == 1


def test_two_drivers_of_one_actuator_are_found_though_they_are_of_two_specs() -> None:
    check = ExclusionCheck(OLD, NEW)
    for t_ns, module in enumerate(("servo_driver_1", "servo_driver_2", "servo_driver_1")):
        check.moved(Moved(t_ns, TAIL, module))
    assert [violation.rule for violation in check.violations] == ["exclusion"]


def test_a_branch_of_a_demux_may_be_held_back_where_no_alive_names_its_pe(flight: Flight) -> None:
    flight.check.reload_ordered()
    flight.step(TAIL, "servo_driver_1")
    for _ in range(4):
        flight.now_ns += 20 * MS
        flight.check.alive(flight.now_ns, PES)
    flight.step(TAIL, "servo_driver_1")
    for _ in range(8):
        flight.now_ns += 20 * MS
        flight.check.alive(flight.now_ns, PES)
    assert len(flight.check.missed_steps([])) == 1
    assert flight.check.missed_steps(["deaf"]) == []
    flight.step(TAIL, "servo_driver_1", 150 * MS)
    flight.check.alive(flight.now_ns, PES)
    assert len(flight.check.missed_steps([])) == 1
