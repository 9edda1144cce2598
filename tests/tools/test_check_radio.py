"""The oracle of a radio finds frames that are too old, and more frames than the radio can carry."""

from collections.abc import Iterator

from heronry_dg.loader import load
from heronry_tools.sim.oracles.radio import RadioCheck
from heronry_tools.sim.world.bus import Sent
from heronry_wire.frame import Frame
from heronry_wire.gateway_report import LinkReport, LinkState

SPEC = load("tests/scenarios/ground_autopilot.dg.yaml")
MS = 1_000_000
S = 1_000 * MS
LINK_ID, DATUM_ID = 291, 1536
FRAME_BITS = 135
BUDGET_BITS_PER_S = 112_500 * 3 // 10


def datum(t_ns: int, bus: str, number: int, sender: str) -> Sent:
    return Sent(t_ns, bus, sender, Frame(DATUM_ID, number.to_bytes(8, "big")))


def report(t_ns: int, usable: int, state: LinkState = LinkState.UP) -> Sent:
    return Sent(t_ns, "can0", "comms", Frame(LINK_ID, LinkReport(93, state, 0, usable, 100, 0, 0).encode()))


def assessed(*frames: Sent, is_altered: bool = False) -> list[str]:
    check = RadioCheck(SPEC)
    if is_altered:
        check.altered()
    for sent in sorted(frames):
        if sent.frame.can_id == LINK_ID:
            check.measured(sent)
        else:
            check.published(sent)
    return [violation.story for violation in check.violations]


def reports(usable: int, from_ns: int, to_ns: int, state: LinkState = LinkState.UP) -> Iterator[Sent]:
    return (report(t_ns, usable, state) for t_ns in range(from_ns, to_ns, 200 * MS))


def flood(share: float, from_ns: int, seconds: int) -> Iterator[Sent]:
    """Data of so much of the radio's budget."""
    every_ns = round(S * FRAME_BITS / (BUDGET_BITS_PER_S * share))
    return (datum(t_ns, "radio", t_ns, "ground") for t_ns in range(from_ns, from_ns + seconds * S, every_ns))


def test_a_datum_that_crosses_at_once_is_fine_and_one_that_waited_is_not() -> None:
    fresh = (datum(10 * MS, "can0", 1, "nav"), datum(15 * MS, "radio", 1, "comms"))
    old = (datum(20 * MS, "can0", 2, "nav"), datum(480 * MS, "radio", 2, "comms"))
    assert assessed(*fresh) == []
    assert assessed(*fresh, *old) == ["comms sent datum 1536 on radio 460 ms after receiving it"]


def test_a_datum_that_is_changed_past_the_crc_may_become_what_an_old_one_was() -> None:
    old, new = datum(20 * MS, "can0", 2, "nav"), datum(470 * MS, "can0", 3, "nav")
    passed_on = datum(480 * MS, "radio", 2, "comms")
    assert len(assessed(old, new, passed_on)) == 1
    assert assessed(old, new, passed_on, is_altered=True) == []
    assert len(assessed(old, passed_on, is_altered=True)) == 1
    assert len(assessed(old, datum(470 * MS, "can0", 0x0103, "nav"), passed_on, is_altered=True)) == 1


def test_what_was_made_beyond_or_by_the_gateway_has_no_age() -> None:
    assert assessed(datum(10 * MS, "radio", 1, "ground"), datum(900 * MS, "radio", 2, "comms")) == []


def test_no_more_than_can_be_used() -> None:
    assert assessed(*reports(1000, 0, 10 * S), *flood(1.0, 0, 10)) == []
    assert assessed(*reports(500, 0, 10 * S), *flood(0.5, 0, 10)) == []
    assert assessed(*reports(1000, 0, 10 * S), *flood(1.5, 0, 10)) != []
    assert assessed(*reports(500, 0, 10 * S), *flood(1.0, 0, 10)) != []


def test_a_fall_may_take_as_long_as_patience_lasts() -> None:
    falls = (*reports(1000, 0, 2 * S), *reports(100, 2 * S, 20 * S))
    assert assessed(*falls, *flood(1.0, 0, 6)) == []
    assert assessed(*falls, *flood(1.0, 0, 12)) != []


def test_a_radio_that_is_gone_or_of_which_nothing_is_reported_is_not_verified() -> None:
    assert assessed(*flood(3.0, 0, 5)) == []
    malformed = Sent(S, "can0", "comms", Frame(LINK_ID, b"")), Sent(S, "can0", "nav", Frame(LINK_ID + 1, bytes(8)))
    assert assessed(*malformed, *flood(3.0, 0, 5)) == []
    assert assessed(*reports(0, 0, 5 * S, LinkState.GONE), *flood(3.0, 0, 5)) == []
    assert assessed(*reports(1000, 0, 1 * S), *flood(3.0, 5 * S, 5)) == []
