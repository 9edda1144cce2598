"""The witness uses frames alone: functions that are heard, functions that fell silent, modules that drive together."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_agent.core.modules.publishing import Publisher
from heronry_agent.core.table_index import TableIndex
from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_manager.core.tables.compilation import Compiler
from heronry_tools.runtime.witness import Outage, Output, Witness
from heronry_wire.canaerospace import DataType, Datum, encode_data
from heronry_wire.frame import Frame
from heronry_wire.identifiers import actuator_echo_id

MS = 1_000_000
ELEVATOR = load(Path("dg_specs/elevator_and_chute.dg.yaml"))
BIG_BLUE = load(Path("dg_specs/big_blue.dg.yaml"))
PATIENCE = 175 * MS  # of the elevator: three periods at 40 Hz and 100 ms
TAIL, CONTROL = 94, 93


def echo(spec: Spec, device: str, value: float = 1.5) -> Frame:
    """What an agent sends when a module writes to an actuator: FLOAT, with the device's index in byte 2."""
    node = spec.pes[spec.devices[device].pe].node_id
    datum = Datum(node, DataType.FLOAT, list(spec.devices).index(device), 7, value)
    return encode_data(actuator_echo_id(node), datum)


def output_echo(spec: Spec, module: str, pe: str) -> Frame:
    """What an agent sends when an output without an actuator has run: ULONG, the module's index."""
    node = spec.pes[pe].node_id
    return encode_data(actuator_echo_id(node), Datum(node, DataType.ULONG, 0, 7, list(spec.modules).index(module)))


@pytest.fixture
def witness() -> Witness:
    return Witness(ELEVATOR)


def fly(witness: Witness, device: str, start_ms: int, end_ms: int) -> None:
    """An actuator is written to every 25 ms."""
    for now_ms in range(start_ms, end_ms + 1, 25):
        assert witness.see(now_ms * MS, echo(ELEVATOR, device)) is not None


def test_a_function_is_served_while_its_actuator_is_commanded(witness: Witness) -> None:
    assert not witness.served("elevator", 0)
    assert witness.last_output("elevator") is None
    fly(witness, "elevator_servo_1", 0, 1000)
    assert witness.served("elevator", 1000 * MS + PATIENCE)
    assert not witness.served("elevator", 1000 * MS + PATIENCE + 1)
    assert not witness.served("parachute", 1000 * MS)
    assert witness.last_output("elevator") == Output(1000 * MS, "servo_driver_1", TAIL, 1.5)


def test_a_slower_function_is_given_more_patience(witness: Witness) -> None:
    assert witness.see(0, echo(ELEVATOR, "chute_solenoid")) == Output(0, "chute_driver", CONTROL, 1.5)
    assert witness.served("parachute", 400 * MS)  # three periods at 10 Hz and 100 ms
    assert not witness.served("parachute", 400 * MS + 1)


def test_an_output_without_an_actuator_is_heard_by_its_number(witness: Witness) -> None:
    seen = witness.see(5, output_echo(ELEVATOR, "servo_monitor", "control_pe"))
    assert seen == Output(5, "servo_monitor", CONTROL, None)
    assert witness.served("servo_monitoring", 10)


def test_a_silence_is_an_outage_from_the_last_frame_to_the_next(witness: Witness) -> None:
    fly(witness, "elevator_servo_1", 0, 500)
    assert witness.outages(500 * MS + PATIENCE) == []
    assert witness.outages(700 * MS) == [Outage("elevator", 500 * MS, None)]
    fly(witness, "elevator_servo_2", 800, 1000)
    assert witness.outages(1000 * MS) == [Outage("elevator", 500 * MS, 800 * MS)]
    assert witness.outages(2000 * MS)[1:] == [Outage("elevator", 1000 * MS, None)]


def test_a_witness_of_days_forgets_what_is_over(witness: Witness) -> None:
    fly(witness, "elevator_servo_1", 0, 500)
    fly(witness, "elevator_servo_2", 800, 1000)
    witness.forget()
    assert witness.outages(1000 * MS) == []
    assert witness.outages(2000 * MS) == [Outage("elevator", 1000 * MS, None)]


def test_outages_are_in_the_order_in_which_they_began(witness: Witness) -> None:
    witness.see(0, echo(ELEVATOR, "chute_solenoid"))
    fly(witness, "elevator_servo_1", 0, 500)
    assert [outage.function for outage in witness.outages(2000 * MS)] == ["parachute", "elevator"]


def test_what_was_never_heard_is_no_outage(witness: Witness) -> None:
    assert witness.outages(10_000 * MS) == []


def test_one_branch_after_the_other_is_no_rivalry(witness: Witness) -> None:
    fly(witness, "elevator_servo_1", 0, 500)
    fly(witness, "elevator_servo_2", 525, 1000)
    fly(witness, "elevator_servo_1", 1025, 1500)
    assert witness.rivals == []


def test_two_branches_in_turn_are_rivals(witness: Witness) -> None:
    fly(witness, "elevator_servo_1", 0, 500)
    witness.see(510 * MS, echo(ELEVATOR, "elevator_servo_2"))
    assert witness.rivals == []
    witness.see(525 * MS, echo(ELEVATOR, "elevator_servo_1"))
    ((one, other),) = witness.rivals
    assert (one.module, one.t_ns) == ("servo_driver_2", 510 * MS)
    assert (other.module, other.t_ns) == ("servo_driver_1", 525 * MS)


def test_a_branch_that_comes_back_after_a_pause_is_no_rival(witness: Witness) -> None:
    witness.see(0, echo(ELEVATOR, "elevator_servo_1"))
    fly(witness, "elevator_servo_2", 25, 150)
    witness.see(PATIENCE + 1, echo(ELEVATOR, "elevator_servo_1"))
    assert witness.rivals == []


@pytest.mark.parametrize(
    "frame",
    [
        echo(ELEVATOR, "elevator_servo_1")._replace(extended=True),
        echo(ELEVATOR, "elevator_servo_1")._replace(can_id=322),
        echo(ELEVATOR, "elevator_servo_1")._replace(can_id=actuator_echo_id(CONTROL)),
        echo(ELEVATOR, "elevator_servo_1")._replace(remote=True, data=b""),
        echo(ELEVATOR, "elevator_servo_1")._replace(error=True),
        echo(ELEVATOR, "elevator_servo_1")._replace(data=b"\x5e\x02\x03\x07\0\0"),
        encode_data(actuator_echo_id(CONTROL), Datum(CONTROL, DataType.FLOAT, 3, 7, 1.5)),  # a servo of another PE
        encode_data(actuator_echo_id(TAIL), Datum(TAIL, DataType.FLOAT, 200, 7, 1.5)),
        encode_data(actuator_echo_id(TAIL), Datum(TAIL, DataType.ULONG, 0, 7, 200)),
        encode_data(actuator_echo_id(TAIL), Datum(TAIL, DataType.SHORT, 3, 7, 1)),
    ],
)
def test_what_is_no_output_serves_nothing(witness: Witness, frame: Frame) -> None:
    assert witness.see(0, frame) is None
    assert not any(witness.served(name, 0) for name in ELEVATOR.functions)


@given(st.integers(0, 0x7FF) | st.sampled_from([actuator_echo_id(n) for n in (93, 94)]), st.binary(max_size=8))
def test_any_frame_is_an_output_or_none(can_id: int, data: bytes) -> None:
    witness = Witness(ELEVATOR)
    seen = witness.see(0, Frame(can_id, data))
    assert seen is None or seen.module in ELEVATOR.modules


@pytest.mark.parametrize("spec", [ELEVATOR, BIG_BLUE], ids=lambda spec: spec.name)
def test_whatever_an_agent_echoes_is_understood(spec: Spec) -> None:
    understood, compiler = set(), Compiler(spec)
    for pe in spec.pes:
        table = compiler.table(pe)
        publisher, witness = Publisher(TableIndex(table)), Witness(spec)
        for module in table.modules:
            actuator = module.device is not None and spec.devices[module.device].kind == "actuator"
            if actuator and module.device is not None:
                frame = publisher.echo(module.device, 0.25)
            elif module.silent_output:
                frame = publisher.output_echo(module.index, 0)
            else:
                continue
            assert frame is not None
            assert witness.see(1, frame) == Output(1, module.name, table.node_id, 0.25 if actuator else None)
            understood.add(module.name)
    assert {name for function in spec.functions.values() for name in function.outputs} <= understood
