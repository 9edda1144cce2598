"""Node services: the sessions of the vectors, as requests and answers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.canaerospace import DataType, Datum
from heronry_wire.frame import Frame, Malformed, WireError, parse_frame
from heronry_wire.identification import IdentificationService
from heronry_wire.identifiers import Use, classify
from heronry_wire.node_services import (
    Identification,
    Result,
    Service,
    ServiceMessage,
    answer,
    answer_delay_ns,
    answer_identification,
    decode_service,
    encode_service,
    read_identification,
    request,
    service_id,
)

MS = 1_000_000


def frame(text: str) -> Frame:
    parsed = parse_frame(text)
    assert isinstance(parsed, Frame)
    return parsed


def heard(text: str) -> ServiceMessage:
    message = decode_service(frame(text))
    assert isinstance(message, ServiceMessage)
    return message


def test_a_node_answers_an_identification_request() -> None:
    asked = request(Service.IDS, 42)
    assert encode_service(asked) == frame("080#2A000000")
    answered = answer_identification(heard("080#2A000000"), 42, Identification(1, 2))
    assert encode_service(answered) == frame("081#2A10000001020000")
    assert read_identification(heard("081#2A10000001020000")) == Identification(1, 2, 0, 0)


def test_on_a_low_channel_the_answer_comes_on_the_same_channel() -> None:
    asked = heard("7D2#2A000000")
    assert asked == request(Service.IDS, 42, channel=101)
    assert encode_service(answer_identification(asked, 42, Identification(1, 2))) == frame("7D3#2A10000001020000")


def test_a_broadcast_is_answered_one_node_after_the_other() -> None:
    all_nodes, one = heard("080#00000000"), heard("080#5E000000")
    assert [answer_delay_ns(all_nodes, node) for node in (92, 93, 127)] == [0, 1_000_000, 35_000_000]
    assert answer_delay_ns(one, 94) == 0


def test_a_request_that_comes_twice_has_one_answer() -> None:
    service = IdentificationService(93)
    for _ in range(2):
        assert service.asked(0, frame("080#00000000"), 0)
    assert len(service.tick(MS)) == 1


def test_time_is_given_to_all() -> None:
    message = request(Service.NSS, 0, data_type=DataType.ULONG, value=123456)
    assert encode_service(message) == frame("080#000401000001E240")


def test_a_configuration_is_stored_only_with_the_right_code() -> None:
    asked = heard("080#2A00067B")
    assert asked == request(Service.FPS, 42, message_code=123)
    assert encode_service(answer(asked, 42)) == frame("081#2A000600")
    refused = answer(asked, 42, message_code=Result.WRONG_CODE.message_code)
    assert encode_service(refused) == frame("081#2A0006FD")


def test_a_block_is_begun_and_refused() -> None:
    start = request(Service.DDS, 42, data_type=DataType.MEMID, message_code=2, value=0xDEADBEEF)
    assert encode_service(start) == frame("080#2A150202DEADBEEF")
    ready = answer(start, 42, data_type=DataType.LONG, message_code=2, value=Result.XON)
    assert encode_service(ready) == frame("081#2A03020200000001")
    refused = answer(start, 42, data_type=DataType.LONG, message_code=2, value=Result.INVALID)
    assert encode_service(refused) == frame("081#2A030202FFFFFFFE")


def test_every_channel_of_the_plan_and_no_other() -> None:
    channels = [*range(36), *range(100, 110), *range(111, 116)]
    ids = [service_id(channel, is_answer=is_answer) for channel in channels for is_answer in (False, True)]
    assert sorted(ids) == [i for i in range(2048) if classify(i).use is Use.NODE_SERVICE]
    for channel in (-1, 36, 99, 110, 116):
        with pytest.raises(WireError, match=f"service channel {channel} does not exist here"):
            service_id(channel, is_answer=False)


@given(st.integers(0, 2047), st.booleans(), st.binary(max_size=8))
def test_any_frame_is_a_service_message_or_a_reason(can_id: int, extended: bool, data: bytes) -> None:
    heard_frame = Frame(can_id, data, extended)
    message = decode_service(heard_frame)
    if isinstance(message, ServiceMessage):
        assert classify(can_id).use is Use.NODE_SERVICE
        assert service_id(message.channel, is_answer=message.is_answer) == can_id


@pytest.mark.parametrize(
    "text", ["12C#2A000000", "7E4#2A000000", "7E5#2A000000", "00000080#2A000000", "080#2A", "080#R"]
)
def test_what_is_no_service_frame_is_malformed(text: str) -> None:
    assert isinstance(decode_service(frame(text)), Malformed)


@pytest.mark.parametrize("text", ["080#2A10000001020000", "081#2A000000", "081#2A10060001020000"])
def test_what_does_not_answer_ids_is_malformed(text: str) -> None:
    assert isinstance(read_identification(heard(text)), Malformed)


def test_an_identification_made_by_hand_is_looked_at_too() -> None:
    strange = ServiceMessage(0, True, Datum(42, DataType.UCHAR4, Service.IDS, 0, None))
    assert isinstance(read_identification(strange), Malformed)


def test_a_question_that_is_none_is_told_from_one_that_is_for_others() -> None:
    service = IdentificationService(92)
    assert service.asked(0, frame("080#5D000000"), 0)
    assert not service.asked(0, frame("080#5C"), 0)
    assert service.tick(MS) == []
