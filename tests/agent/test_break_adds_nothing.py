"""BREAK removes and GO adds: between the two no datum is on a bus that was not there before."""

from agent.one_pe import (
    ALARM,
    DEMAND,
    FAR,
    FLYING,
    GATEWAY_TABLE,
    NEIGHBOUR,
    RATE,
    RATE_ID,
    RUN_CONTROL,
    RUN_SERVO_1,
    OnePe,
    rate_frame,
    sent,
    slice_messages,
)
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import Activate, Step

SILENT = Slice((RUN_CONTROL, RUN_SERVO_1), remote={RATE: NEIGHBOUR})
CARRYING = Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}, forward={RATE: (NEIGHBOUR, 0b10)})
CARRYING_FOR_ANOTHER = Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}, forward={RATE: (FAR, 0b11)})


def test_a_gateway_forwards_anew_from_go_on() -> None:
    pe = OnePe(GATEWAY_TABLE)
    pe.configure(SILENT, 1)
    pe.command(*slice_messages(CARRYING, 2, 1002), Activate(1, 2, Step.BREAK, 1002))
    assert sent(pe.hear(rate_frame(1.0)), RATE_ID, 1) == []
    pe.command(Activate(1, 2, Step.GO, 1002))
    assert sent(pe.hear(rate_frame(1.0)), RATE_ID, 1) == [rate_frame(1.0)]


def test_a_break_after_a_break_still_adds_nothing() -> None:
    pe = OnePe(GATEWAY_TABLE)
    pe.configure(SILENT, 1)
    for epoch in (2, 3):
        pe.command(*slice_messages(CARRYING, epoch, 1000 + epoch), Activate(1, epoch, Step.BREAK, 1000 + epoch))
        assert sent(pe.hear(rate_frame(1.0)), RATE_ID, 1) == []


def test_what_two_slices_have_in_common() -> None:
    assert FLYING.restricted_to(FLYING) == FLYING
    assert FLYING.restricted_to(SILENT) == SILENT
    assert CARRYING_FOR_ANOTHER.restricted_to(CARRYING).forward == {}
    wide = Slice(publish={DEMAND: 0b11, ALARM: 0b10}, forward={RATE: (FAR, 0b11)})
    narrow = Slice(publish={DEMAND: 0b01, ALARM: 0b01}, forward={RATE: (FAR, 0b10)})
    assert wide.restricted_to(narrow) == Slice(publish={DEMAND: 0b01}, forward={RATE: (FAR, 0b10)})
    assert narrow.restricted_to(Slice(forward={RATE: (FAR, 0b01)})) == Slice()
