"""The identifier plan has no collision, and every (producer, variable) gets the identifier of docs/protocol.md."""

import random
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_wire import identifiers as plan
from heronry_wire.frame import WireError
from heronry_wire.identifiers import ALLOCATED_DATA_IDS, Command, Meaning, Source, Use, allocate, classify


def test_no_identifier_has_two_uses() -> None:
    counts = Counter(can_id for can_id, _ in plan.planned_uses())
    assert {can_id for can_id, count in counts.items() if count > 1} == set()
    assert set(counts) <= set(range(2048))


def test_what_the_plan_gives_is_what_a_receiver_reads() -> None:
    for can_id, meaning in plan.planned_uses():
        assert classify(can_id) == meaning
    planned = {can_id for can_id, _ in plan.planned_uses()}
    for can_id in set(range(2048)) - planned:
        assert classify(can_id) == Meaning(Use.UNASSIGNED)


@pytest.mark.parametrize(
    ("can_id", "meaning"),
    [
        (0, Meaning(Use.NMT)),
        (1, Meaning(Use.EMERGENCY_EVENT, 1)),
        (127, Meaning(Use.EMERGENCY_EVENT, 127)),
        (128, Meaning(Use.NODE_SERVICE)),  # where CANopen has SYNC
        (199, Meaning(Use.NODE_SERVICE)),
        (200, Meaning(Use.MANAGEMENT, 126, Command.LEASE)),
        (207, Meaning(Use.MANAGEMENT, 126, Command.TAG)),
        (208, Meaning(Use.UNASSIGNED)),
        (214, Meaning(Use.MANAGEMENT, 127, Command.ACTIVATE)),
        (220, Meaning(Use.EMCY, 92)),
        (255, Meaning(Use.EMCY, 127)),
        (256, Meaning(Use.TIME)),
        (257, Meaning(Use.STATE, 92)),
        (290, Meaning(Use.STATE, 125)),
        (291, Meaning(Use.GATEWAY)),
        (299, Meaning(Use.GATEWAY)),
        (300, Meaning(Use.STANDARD_DATA)),
        (1499, Meaning(Use.STANDARD_DATA)),
        (1500, Meaning(Use.SDO_RESPONSE, 92)),
        (1535, Meaning(Use.SDO_RESPONSE, 127)),
        (1536, Meaning(Use.ALLOCATED_DATA)),
        (1627, Meaning(Use.ALLOCATED_DATA)),
        (1628, Meaning(Use.SDO_REQUEST, 92)),
        (1663, Meaning(Use.SDO_REQUEST, 127)),
        (1664, Meaning(Use.ALLOCATED_DATA)),
        (1792, Meaning(Use.ALLOCATED_DATA)),
        (1793, Meaning(Use.UNASSIGNED)),
        (1884, Meaning(Use.HEARTBEAT, 92)),
        (1919, Meaning(Use.HEARTBEAT, 127)),
        (1920, Meaning(Use.ACTUATOR_ECHO, 92)),
        (1953, Meaning(Use.ACTUATOR_ECHO, 125)),
        (1954, Meaning(Use.CHECKPOINT, 92)),
        (1987, Meaning(Use.CHECKPOINT, 125)),
        (1988, Meaning(Use.BULK)),
        (1999, Meaning(Use.BULK)),
        (2000, Meaning(Use.NODE_SERVICE)),
        (2020, Meaning(Use.UNASSIGNED)),  # CANopen LSS
        (2021, Meaning(Use.UNASSIGNED)),
        (2031, Meaning(Use.NODE_SERVICE)),
        (2032, Meaning(Use.UNASSIGNED)),
    ],
)
def test_the_edges_of_the_plan(can_id: int, meaning: Meaning) -> None:
    assert classify(can_id) == meaning


def test_an_identifier_is_refused_to_a_node_that_has_none() -> None:
    with pytest.raises(WireError, match=r"126 is not the node-ID of a PE: use 92\.\.125"):
        plan.state_id(126)
    with pytest.raises(WireError, match=r"91 is not the node-ID of a PE or manager: use 92\.\.127"):
        plan.heartbeat_id(91)
    with pytest.raises(WireError, match=r"125 is not the node-ID of a manager: use 126\.\.127"):
        plan.management_id(125, Command.LEASE)


def source(
    producer: str,
    variable: str,
    standard: int | None = None,
    *,
    version: int = 1,
    rank: int = 4,
    rate_mhz: int = 10_000,
    order: int = 0,
) -> Source:
    return Source(producer, variable, standard, version, rank, rate_mhz, order)


def test_the_best_producer_has_the_standard_identifier_and_the_other_an_allocated_one() -> None:
    given_ids = allocate(
        [
            source("low_quality_altitude", "altitude", 322, version=3, order=0),
            source("high_quality_altitude", "altitude", 322, version=1, order=1),
        ]
    )
    assert given_ids == {("high_quality_altitude", "altitude"): 322, ("low_quality_altitude", "altitude"): 1536}


def test_of_two_equal_producers_the_first_in_the_spec_is_the_best() -> None:
    pairs = [source("second", "altitude", 322, order=2), source("first", "altitude", 322, order=1)]
    assert allocate(pairs) == {("first", "altitude"): 322, ("second", "altitude"): 1536}


def test_criticality_then_period_then_order_decide_the_allocated_ones() -> None:
    pairs = [
        source("late", "v", rank=1, rate_mhz=10_000, order=4),
        source("early", "v", rank=1, rate_mhz=10_000, order=3),
        source("fast", "v", rank=1, rate_mhz=10_001, order=9),
        source("critical", "v", rank=0, rate_mhz=1, order=8),
        source("fast_but_idle", "v", rank=4, rate_mhz=1_000_000, order=0),
    ]
    ids = allocate(pairs)
    assert sorted(ids, key=lambda pair: ids[pair]) == [
        ("critical", "v"),
        ("fast", "v"),
        ("early", "v"),
        ("late", "v"),
        ("fast_but_idle", "v"),
    ]
    assert sorted(ids.values()) == [1536, 1537, 1538, 1539, 1540]


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(1, 3), st.booleans()), max_size=40), st.randoms())
def test_the_allocation_does_not_depend_on_how_the_pairs_are_listed(
    drawn: list[tuple[int, int, bool]], shuffled: random.Random
) -> None:
    pairs = [
        source(
            f"module{i}",
            f"variable{i % 7}",
            400 + i % 7 if i % 7 < 3 else None,
            version=version,
            rank=rank,
            rate_mhz=version * 1000,
            order=i,
        )
        for i, (rank, version, _) in enumerate(drawn)
    ]
    mixed = list(pairs)
    shuffled.shuffle(mixed)
    ids = allocate(pairs)
    assert allocate(mixed) == ids
    assert len(set(ids.values())) == len(pairs)
    assert all(classify(i).use in {Use.STANDARD_DATA, Use.ALLOCATED_DATA} for i in ids.values())


def test_the_gap_of_the_sdo_identifiers_is_jumped_over() -> None:
    ids = allocate(source(f"m{i}", "v", order=i) for i in range(221))
    assert list(ids.values()) == list(ALLOCATED_DATA_IDS)
    assert (ids["m91", "v"], ids["m92", "v"]) == (1627, 1664)


def test_too_many_pairs_are_an_error() -> None:
    with pytest.raises(WireError, match=r"222 .* pairs need an allocated identifier, but there are only 221"):
        allocate(source(f"m{i}", "v", order=i) for i in range(222))


def test_mistakes_of_the_spec_are_named() -> None:
    with pytest.raises(WireError, match="variable v: 1500 is no standard identifier"):
        allocate([source("m", "v", 1500)])
    with pytest.raises(WireError, match="variables v and w both claim identifier 322"):
        allocate([source("m", "v", 322), source("n", "w", 322, order=1)])
    with pytest.raises(WireError, match="listed twice"):
        allocate([source("m", "v", 322), source("m", "v", 322)])
