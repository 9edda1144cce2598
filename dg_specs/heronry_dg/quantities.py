"""Converts quantities in a file to exact integers (or fractions) in the units of the model.

A file gives cores (`0.05`), memory (`64KiB`), Hz (`12.5`) or ms. In the model CPU is in thousandths of a reference
core, memory in bytes, a rate in millihertz, a time in nanoseconds. The conversion is exact: a value finer than the unit
of the model is an error, and is never rounded. Bounds keep every sum of quantities far inside the 64 bits of the
planner's solver.
"""

import re
from decimal import Decimal
from fractions import Fraction
from typing import Final

from heronry_dg.findings import shown
from heronry_dg.rules import schema as rules
from heronry_dg.rules.rule import Rule

MOST_CORES: Final = 1_000
LARGEST_MEMORY: Final = 1 << 40
MOST_HZ: Final = 1_000_000
MOST_BITS_PER_S: Final = 10**10
MOST_MS: Final = 3_600_000

_MEMORY = re.compile(r"(?P<number>[0-9]{1,13}(?:\.[0-9]{1,12})?)(?P<unit>KiB|MiB|GiB)")
_WITH_UNIT = re.compile(r"(?P<number>-?[0-9]+(?:\.[0-9]+)?) ?(?P<unit>%|[A-Za-z][A-Za-z/]*)?")
_LONGEST_SHOWN_NUMBER: Final = 12
_FINEST_SHOWN: Final = 1_000_000  # parts of a unit: finer numbers have too many digits to show
_UNITS: Final = {"KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}


class UnfitError(ValueError):
    """A value does not fit its field; the error has a rule, a sentence about the value, and a hint."""

    def __init__(self, rule: Rule, predicate: str, hint: str = "") -> None:
        """Keep the rule, the hint, and the predicate of the sentence, for example "must be a number, not 'x'".

        The text of the error has the subject "the value"; `said_of` gives the sentence with another subject.
        """
        super().__init__(f"the value {predicate}")
        self.rule, self.hint, self._predicate = rule, hint, predicate

    def said_of(self, subject: str) -> str:
        """Return the sentence of this error with `subject`, such as the name of a field, in place of "the value"."""
        return f"{subject} {self._predicate}"


def cpu_millis(value: object) -> int:
    """Convert cores to thousandths; raises UnfitError for a value that is negative, too large or too fine."""
    return _whole(value, 1000, MOST_CORES, "a thousandth of a core")


def positive_cpu_millis(value: object) -> int:
    """Convert as `cpu_millis` does, but refuse 0."""
    return _positive(cpu_millis(value), value)


def rate_mhz(value: object) -> int:
    """Convert Hz to millihertz; raises UnfitError for a value that is zero, negative, too large or too fine."""
    return _positive(_whole(value, 1000, MOST_HZ, "a millihertz"), value)


def weight_mbit_per_s(value: object) -> int:
    """Convert bit/s to thousandths of a bit/s.

    Raises UnfitError for a value that is negative, too large or too fine.
    """
    return _whole(value, 1000, MOST_BITS_PER_S, "a thousandth of a bit/s")


def span_ns(value: object) -> int:
    """Convert milliseconds to nanoseconds.

    Raises UnfitError for a value that is no number, is negative, is more than MOST_MS, or is no whole number of
    nanoseconds.
    """
    return _whole(value, 1_000_000, MOST_MS, "a nanosecond")


def period_ns(value: object) -> int:
    """Convert milliseconds to nanoseconds; raises UnfitError for 0, and for all that `span_ns` refuses."""
    return _positive(span_ns(value), value)


def memory_bytes(value: object) -> int:
    """Convert a number of bytes, or a text such as `64KiB`, `2MiB` or `1GiB`, to bytes.

    Raises UnfitError for any other value, and for a value that is negative, more than LARGEST_MEMORY, or no
    whole number of bytes.
    """
    if not isinstance(value, str):
        return _whole(value, 1, LARGEST_MEMORY, "a byte")
    match = _MEMORY.fullmatch(value)
    if match is None:
        sentence = f"must be a size of memory, not {shown(value)}"
        raise UnfitError(rules.BAD_MEMORY, sentence, "write a size such as 64KiB or 2MiB, or a number of bytes")
    factor = _UNITS[match["unit"]]
    a_byte = f"1/{factor} {match['unit']} (a byte)"
    return _whole(Decimal(match["number"]), factor, LARGEST_MEMORY // factor, a_byte)


def positive_memory_bytes(value: object) -> int:
    """Convert as `memory_bytes` does, but refuse 0."""
    return _positive(memory_bytes(value), value)


def share(value: object) -> Fraction:
    """Convert a share, 0 to 1; raises UnfitError for any other value."""
    exact = number(value)
    if not 0 <= exact <= 1:
        sentence = f"must be a share from 0 to 1, not {value}"
        raise UnfitError(rules.OUT_OF_RANGE, sentence, "write 0.8 for 80 %")
    return exact


def failures_per_hour(value: object) -> Fraction:
    """Convert a failure rate per hour, 0 or more; raises UnfitError for any other value."""
    exact = number(value)
    if exact < 0:
        sentence = f"must be 0 or more failures per hour, not {value}"
        raise UnfitError(rules.OUT_OF_RANGE, sentence, "write a number such as 0.0005 or 5e-4")
    return exact


def probability(value: object) -> Fraction:
    """Convert a probability, from 0 to 1; raises UnfitError for any other value."""
    exact = number(value)
    if not 0 <= exact <= 1:
        raise UnfitError(rules.OUT_OF_RANGE, f"must be from 0 to 1, not {value}", "write a number such as 0.001")
    return exact


def part(value: object) -> Fraction:
    """Convert a share above 0, at most 1; raises UnfitError for any other value."""
    exact = number(value)
    if not 0 < exact <= 1:
        raise UnfitError(
            rules.OUT_OF_RANGE, f"must be above 0 and at most 1, not {value}", "write a number such as 0.1"
        )
    return exact


def hours(value: object) -> Fraction:
    """Convert a number of hours, more than 0; raises UnfitError for any other value."""
    exact = number(value)
    if exact <= 0:
        raise UnfitError(rules.OUT_OF_RANGE, f"must be more than 0 hours, not {value}", "write a number such as 2.5")
    return exact


def number(value: object) -> Fraction:
    """Convert a number exactly; raises UnfitError for a value that is not a number."""
    return Fraction(_numeric(value))


def _numeric(value: object) -> int | Decimal:
    if isinstance(value, bool) or not isinstance(value, int | Decimal):
        numeric = _WITH_UNIT.fullmatch(value) if isinstance(value, str) else None
        sentence = f"must be a number, not {shown(value)}"
        if numeric is None:
            raise UnfitError(rules.WRONG_TYPE, sentence, "write only digits and a decimal point, for example 0.5")
        raise UnfitError(rules.WRONG_UNIT, sentence, _bare_number_hint(numeric["number"], numeric["unit"]))
    return value


def _bare_number_hint(number: str, unit: str) -> str:
    if not unit:
        return "remove the quotes"
    if unit == "%" and len(number) <= _LONGEST_SHOWN_NUMBER:
        return f"write {Decimal(number).scaleb(-2).normalize():f}"
    return "write the number alone, in the unit that the field is named for"


def _whole(value: object, factor: int, most: int, unit: str) -> int:
    above, below = _numeric(value).as_integer_ratio()  # a Fraction does the same, and takes five times as long
    if not 0 <= above <= most * below:
        sentence = f"must be from 0 to {most}, not {value}"
        raise UnfitError(rules.OUT_OF_RANGE, sentence, f"write a number from 0 to {most}")
    whole, rest = divmod(above * factor, below)
    if rest:
        next_one = Fraction(whole + 1, factor)
        hint = f"write {float(next_one):.10g}, the next possible value above" if factor <= _FINEST_SHOWN else "round it"
        raise UnfitError(rules.TOO_FINE, f"must not be finer than {unit}, but {value} is finer", hint)
    return whole


def _positive(result: int, value: object) -> int:
    if result == 0:
        raise UnfitError(rules.OUT_OF_RANGE, f"must be more than 0, not {value}", "write a number above 0")
    return result
