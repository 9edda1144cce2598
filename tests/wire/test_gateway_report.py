"""The report of a gateway on its radio, as bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire.frame import Malformed, WireError
from heronry_wire.gateway_report import LINK, LinkReport, LinkState, decode_link, link_id
from heronry_wire.identifiers import GATEWAY_IDS, PE_NODES, Use, classify

reports = st.builds(
    LinkReport,
    node=st.sampled_from(PE_NODES),
    state=st.sampled_from(LinkState),
    sequence=st.integers(0, 63),
    usable=st.integers(0, 1000),
    delivered=st.integers(0, 100),
    queued=st.integers(0, 255),
    dropped=st.integers(0, 65535),
)


@given(reports)
def test_what_is_encoded_is_decoded(report: LinkReport) -> None:
    assert decode_link(report.encode()) == report


@given(st.binary(max_size=9))
def test_any_bytes_are_a_report_or_malformed(data: bytes) -> None:
    match decode_link(data):
        case LinkReport() as report:
            assert report.encode() == data
        case Malformed(reason):
            assert reason


@pytest.mark.parametrize(
    ("field", "value"), [("node", 91), ("node", 126), ("state", 2), ("usable", 1001), ("delivered", 101)]
)
def test_what_cannot_be_is_malformed(field: str, value: int) -> None:
    fields = {"node": 92, "state": 0, "sequence": 0, "usable": 0, "delivered": 0, "queued": 0, "dropped": 0}
    assert isinstance(decode_link(LINK.pack(*(fields | {field: value}).values())), Malformed)


def test_counters_saturate_or_go_round() -> None:
    found = decode_link(LinkReport(92, LinkState.UP, 0, 1000, 100, 300, 65_537).encode())
    assert isinstance(found, LinkReport)
    assert (found.queued, found.dropped) == (255, 1)


def test_there_is_an_identifier_for_nine_radios() -> None:
    assert [link_id(radio) for radio in range(9)] == list(GATEWAY_IDS)
    assert classify(link_id(0)).use is Use.GATEWAY
    for number in (-1, 9):
        with pytest.raises(WireError):
            link_id(number)
