"""The frames of a PE: data, and the echoes of its outputs."""

from agent.one_pe import CONTROL, NODE, RATE, TABLE
from heronry_agent.core.modules.publishing import Publisher
from heronry_agent.core.table_index import TableIndex
from heronry_wire.canaerospace import DataType, Datum, decode_data
from heronry_wire.identifiers import actuator_echo_id


def publisher() -> Publisher:
    return Publisher(TableIndex(TABLE))


def test_an_actuator_shows_what_it_was_told() -> None:
    device = TABLE.devices[0].name
    frame = publisher().echo(device, 2.5)
    assert frame is not None
    assert frame.can_id == actuator_echo_id(NODE)
    assert decode_data(frame) == Datum(NODE, DataType.FLOAT, 0, 0, 2.5)


def test_what_no_number_in_one_frame_tells_has_no_echo() -> None:
    device = TABLE.devices[0].name
    assert publisher().echo("nothing", 2.5) is None
    assert publisher().echo(device, "words") is None
    assert publisher().echo(device, 1e300) is None


def test_an_output_without_an_actuator_shows_that_it_runs_and_each_frame_has_the_next_code() -> None:
    one = publisher()
    told = [decode_data(one.output_echo(CONTROL, 1)) for _ in range(2)]
    assert told == [Datum(NODE, DataType.ULONG, 1, code, CONTROL) for code in (0, 1)]


def test_a_datum_has_the_next_code_once_one_has_been_sent() -> None:
    one = publisher()
    first = one.datum(RATE, 1, 2.5)
    assert one.datum(RATE, 1, 2.5) == first
    one.sent(first)
    second = decode_data(one.datum(RATE, 1, 2.5))
    assert isinstance(second, Datum)
    assert second.message_code == 1
