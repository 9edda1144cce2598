"""Quantities are exact: the file's decimal number is what the model holds in integers, or an error."""

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from heronry_dg import quantities
from heronry_dg.plain_scalars import resolve
from heronry_dg.quantities import UnfitError


@pytest.mark.parametrize(
    ("read", "text", "exact"),
    [
        (quantities.cpu_millis, "0.5", 500),
        (quantities.cpu_millis, "0.050", 50),
        (quantities.cpu_millis, "1e-3", 1),
        (quantities.cpu_millis, "4", 4000),
        (quantities.cpu_millis, "0", 0),
        (quantities.rate_mhz, "12.5", 12_500),
        (quantities.rate_mhz, "0.001", 1),
        (quantities.period_ns, "12.5", 12_500_000),
        (quantities.period_ns, "0.000001", 1),
        (quantities.span_ns, "0", 0),
        (quantities.memory_bytes, "64KiB", 65_536),
        (quantities.memory_bytes, "1.5KiB", 1_536),
        (quantities.memory_bytes, "2MiB", 2_097_152),
        (quantities.memory_bytes, "1GiB", 1 << 30),
        (quantities.memory_bytes, "100", 100),
        (quantities.share, "0.8", Fraction(4, 5)),
        (quantities.failures_per_hour, "1e-5", Fraction(1, 100_000)),
        (quantities.number, "-2.5", Fraction(-5, 2)),
    ],
)
def test_decimal_text_is_converted_exactly(read: Callable[[object], object], text: str, exact: object) -> None:
    assert read(resolve(text)) == exact


@pytest.mark.parametrize(
    ("read", "value", "sentence"),
    [
        (
            quantities.cpu_millis,
            Decimal("0.0005"),
            "must not be finer than a thousandth of a core, but 0.0005 is finer",
        ),
        (quantities.cpu_millis, -1, "must be from 0 to 1000, not -1"),
        (quantities.cpu_millis, 1001, "must be from 0 to 1000, not 1001"),
        (quantities.cpu_millis, True, "must be a number, not true"),
        (quantities.cpu_millis, "half", "must be a number, not 'half'"),
        (quantities.cpu_millis, None, "must be a number, not nothing"),
        (quantities.positive_cpu_millis, 0, "must be more than 0, not 0"),
        (quantities.rate_mhz, Decimal("0.0001"), "must not be finer than a millihertz, but 0.0001 is finer"),
        (quantities.rate_mhz, 0, "must be more than 0, not 0"),
        (quantities.period_ns, Decimal("1e-7"), "must not be finer than a nanosecond, but 1E-7 is finer"),
        (quantities.period_ns, 0, "must be more than 0, not 0"),
        (quantities.memory_bytes, Decimal("0.5"), "must not be finer than a byte, but 0.5 is finer"),
        (quantities.memory_bytes, "0.3KiB", "must not be finer than 1/1024 KiB (a byte), but 0.3 is finer"),
        (quantities.memory_bytes, "64KB", "must be a size of memory, not '64KB'"),
        (quantities.memory_bytes, "64 KiB", "must be a size of memory, not '64 KiB'"),
        (quantities.memory_bytes, "-1KiB", "must be a size of memory, not '-1KiB'"),
        (quantities.memory_bytes, "2000000MiB", "must be from 0 to 1048576, not 2000000"),
        (quantities.positive_memory_bytes, "0KiB", "must be more than 0, not 0KiB"),
        (quantities.share, Decimal("1.01"), "must be a share from 0 to 1, not 1.01"),
        (quantities.failures_per_hour, Decimal("-0.1"), "must be 0 or more failures per hour, not -0.1"),
    ],
)
def test_what_does_not_fit_is_an_error_and_never_rounded(
    read: Callable[[object], object], value: object, sentence: str
) -> None:
    with pytest.raises(UnfitError) as caught:
        read(value)
    assert str(caught.value) == f"the value {sentence}"


@given(st.integers(0, 1_000_000))
def test_every_thousandth_of_a_core_survives_the_way_through_text(millis: int) -> None:
    text = f"{millis // 1000}.{millis % 1000:03}"
    assert quantities.cpu_millis(resolve(text)) == millis


@given(st.decimals(allow_nan=False, allow_infinity=False, min_value=0, max_value=1000, places=9))
def test_cores_are_exact_or_refused(cores: Decimal) -> None:
    try:
        assert Fraction(quantities.cpu_millis(cores), 1000) == Fraction(cores)
    except UnfitError:
        assert (Fraction(cores) * 1000).denominator != 1
