"""Slices: bytes written by hand, one encoding for each slice, and any bytes are decoded in bounded time."""

import random
from collections.abc import Iterable
from typing import TypeVar

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from heronry_wire.configuration_slice import (
    ModuleSlice,
    Slice,
    SliceError,
    configuration_digest,
    decode_slice,
    slice_digest,
)

T = TypeVar("T")

LEAVES = {(0, 0): 0, (1, 0): 2, (1, 1): 1, (7, 0): 3, (300, 0): 1}  # (module, mode) -> leaves, of some PE's table
TABLE = b"\xab" * 32  # the identity of a table
TABLES = {node: bytes((node,)) * 32 for node in range(92, 126)}

indices = st.integers(0, 5) | st.integers(120, 140) | st.integers(0, 100_000)
nodes, masks = st.integers(92, 125), st.integers(1, 15)


@st.composite
def module_slices(draw: st.DrawFn) -> tuple[ModuleSlice, ...]:
    """Modules of the table, each once, in ascending order."""
    modes = draw(st.lists(st.sampled_from(sorted(LEAVES)), unique_by=lambda key: key[0]))
    return tuple(
        ModuleSlice(module, mode, tuple(draw(st.none() | indices) for _ in range(LEAVES[module, mode])))
        for module, mode in sorted(modes)
    )


@st.composite
def whole_slices(draw: st.DrawFn) -> Slice:
    modules = draw(module_slices())
    return Slice(
        modules,
        draw(st.dictionaries(indices, nodes, max_size=4)),
        draw(st.dictionaries(indices, masks, max_size=4)),
        draw(st.dictionaries(indices, st.tuples(nodes, masks), max_size=4)),
        frozenset(module.module for module in modules if draw(st.booleans())),
    )


slices = whole_slices()


def test_a_slice_byte_for_byte() -> None:
    wanted = Slice(
        modules=(ModuleSlice(1, 0, (4, None)), ModuleSlice(300, 0, (200,))),
        remote={4: 93},
        publish={200: 1, 5: 3},
        forward={130: (94, 2)},
    )
    body = bytes.fromhex(
        "02"  # two modules
        "01 00 05 00"  # module 1 in mode 0 reads source 4, and nothing
        "AC02 00 C901"  # module 300 (0x2C + 2 x 128) in mode 0 reads source 200 (201 = 0x49 + 128)
        "01 04 5D"  # source 4 comes from node 93
        "02 05 03 C801 01"  # source 5 goes out on both ports, source 200 on the first
        "01 8201 5E 02"  # source 130 of node 94 is forwarded to the second port
    )
    assert wanted.encode() == body
    assert decode_slice(body, LEAVES) == wanted


def test_a_pe_that_has_nothing_to_do_is_sent_no_bytes() -> None:
    assert Slice().encode() == b""
    assert decode_slice(b"", LEAVES) == Slice()


def test_a_gateway_that_runs_nothing_may_still_forward() -> None:
    gateway = Slice(forward={3: (92, 2)})
    assert gateway.encode() == bytes.fromhex("00 00 00 01 03 5C 02")
    assert decode_slice(gateway.encode(), LEAVES) == gateway


def test_what_rests_without_a_manager_stands_last_and_only_where_there_is_any() -> None:
    modules = (ModuleSlice(0, 0, ()), ModuleSlice(300, 0, (None,)))
    plain, marked = Slice(modules), Slice(modules, expendable=frozenset({300}))
    assert marked.encode() == plain.encode() + bytes.fromhex("01 AC02")
    assert decode_slice(marked.encode(), LEAVES) == marked


@pytest.mark.parametrize("odd", ["00", "01 07", "02 AC02 AC02", "02 AC02 00"])
def test_what_rests_is_told_in_one_way(odd: str) -> None:
    plain = Slice((ModuleSlice(0, 0, ()), ModuleSlice(300, 0, (None,)))).encode()
    with pytest.raises(SliceError, match=r"out of order|not in the slice"):
        decode_slice(plain + bytes.fromhex(odd), LEAVES)


@given(slices)
def test_every_slice_survives_the_bus(wanted: Slice) -> None:
    assert decode_slice(wanted.encode(), LEAVES) == wanted


def shuffled(rng: random.Random, items: Iterable[T]) -> list[T]:
    return sorted(items, key=lambda _: rng.random())


@given(slices, st.randoms(use_true_random=False))
def test_the_order_in_which_a_slice_was_put_together_does_not_count(wanted: Slice, rng: random.Random) -> None:
    again = Slice(
        tuple(shuffled(rng, wanted.modules)),
        dict(shuffled(rng, wanted.remote.items())),
        dict(shuffled(rng, wanted.publish.items())),
        dict(shuffled(rng, wanted.forward.items())),
        frozenset(shuffled(rng, wanted.expendable)),
    )
    assert again.encode() == wanted.encode()


@given(slices, slices)
def test_different_slices_have_different_bytes(one: Slice, other: Slice) -> None:
    assert (one.encode() == other.encode()) == (one == other)


few_numbers = st.lists(st.integers(0, 8) | st.integers(0, 255), max_size=40).map(bytes)


@given(st.binary(max_size=60) | few_numbers)
@example(bytes.fromhex("FFFFFFFF7F"))  # 34 359 738 367 modules, it says
@example(bytes.fromhex("00 FFFFFFFF7F"))  # ... sources read
@example(bytes.fromhex("00 00 00 FFFFFFFF7F 01"))  # ... sources forwarded
def test_any_bytes_are_the_one_way_to_write_a_slice_or_an_error(body: bytes) -> None:
    try:
        decoded = decode_slice(body, LEAVES)
    except SliceError:
        return
    assert decoded.encode() == body


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("00", "a number is cut off"),
        ("01 07 00 01", "a number is cut off"),
        ("01 02 00 00 00 00", "the table of this PE has no mode 0 of module 2"),
        ("01 01 02 00 00 00", "the table of this PE has no mode 2 of module 1"),
        ("00 00 00 00 00", "more bytes than needed"),
        ("00 00 00 00 00 00", "bytes follow the last number of the slice"),
        ("00 00 00 00", "more bytes than needed"),
        ("8080808080808080808000 00 00 00", "has more than 70 bits"),
        ("8000 00 00 00", "more bytes than needed"),
        ("02 01 01 00 00 00 00 00 00", "out of order or given twice"),
        ("02 00 00 00 00 00 00 00", "out of order or given twice"),
        ("02 01 01 00 01 00 00 00 00 00 00", "out of order or given twice"),
        ("00 02 05 5D 04 5D 00 00", "out of order or given twice"),
        ("00 00 02 05 01 05 02 00", "out of order or given twice"),
        ("00 00 00 02 05 5D 01 05 5D 02", "out of order or given twice"),
    ],
)
def test_an_error_says_what_is_wrong(text: str, reason: str) -> None:
    with pytest.raises(SliceError, match=reason):
        decode_slice(bytes.fromhex(text), LEAVES)


def test_a_slice_of_another_table_is_refused() -> None:
    body = Slice((ModuleSlice(1, 0, (4, None)),)).encode()
    with pytest.raises(SliceError):
        decode_slice(body, {(1, 0): 3})


# Digests

bodies = st.binary(max_size=12)
configurations = st.dictionaries(nodes, bodies, max_size=4)


@given(bodies)
def test_a_digest_has_24_bits_is_never_0_and_is_that_of_one_table(body: bytes) -> None:
    digest = slice_digest(TABLE, body)
    assert 0 < digest < 1 << 24
    assert digest != slice_digest(b"\xac" * 32, body)


@given(bodies, bodies)
def test_the_digest_of_a_slice_tells_slices_apart(one: bytes, other: bytes) -> None:
    assert (slice_digest(TABLE, one) == slice_digest(TABLE, other)) == (one == other)


@given(configurations, configurations)
@example({92: b"", 93: b"ab"}, {92: b"ab", 93: b""})  # the same bytes in another PE
@example({92: b"\x5d\0\0"}, {92: b"", 93: b""})  # bytes that look like the next PE's
def test_the_digest_of_a_configuration_tells_configurations_apart(
    one: dict[int, bytes], other: dict[int, bytes]
) -> None:
    assert (configuration_digest(TABLES, one) == configuration_digest(TABLES, other)) == (one == other)


@given(configurations)
def test_the_order_of_the_slices_does_not_count(slices_by_node: dict[int, bytes]) -> None:
    backwards = dict(reversed(slices_by_node.items()))
    assert configuration_digest(TABLES, backwards) == configuration_digest(TABLES, slices_by_node)


@given(st.dictionaries(nodes, bodies, min_size=1, max_size=4), st.data())
def test_the_digest_of_a_configuration_names_the_table_of_every_pe(
    slices_by_node: dict[int, bytes], data: st.DataObject
) -> None:
    node = data.draw(st.sampled_from(sorted(slices_by_node)))
    others = {**TABLES, node: b"\xac" * 32}
    assert configuration_digest(TABLES, slices_by_node) != configuration_digest(others, slices_by_node)
