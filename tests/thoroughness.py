"""How much of the long tests runs: a part of them in `make test`, all of them in `make soak` and `make coverage`.

Two ways. A case among many, or a whole test, has the marker `soak`: `make test` leaves those out by `-m 'not soak'`. An
enumeration by numbers, or by drawn examples, takes its length from these functions; HERONRY_SOAK=1 in the environment
makes it complete.
"""

import os
from collections.abc import Collection, Iterable, Sequence
from typing import TypeVar

import pytest
from _pytest.mark.structures import ParameterSet

Thing = TypeVar("Thing")

IS_WHOLE = os.environ.get("HERONRY_SOAK", "") not in ("", "0")


def part_of(number: int, share: int = 8) -> int:
    """Return the number of examples to try: all of them, or in `make test` one of `share`."""
    return number if IS_WHOLE else max(1, number // share)


def sample(things: Sequence[Thing], share: int = 8) -> Sequence[Thing]:
    """Return the things to try: all of them, or in `make test` the first of every `share`."""
    return things if IS_WHOLE else things[::share]


def mostly_soak(cases: Iterable[Thing], always: Collection[Thing]) -> list[ParameterSet]:
    """Return a test's cases as parameters: those in `always` for every run, the others for `make soak`."""
    listed = list(cases)
    unknown = [case for case in always if case not in listed]
    if unknown:
        raise ValueError(f"not among the cases: {unknown}")
    return [pytest.param(case, marks=() if case in always else pytest.mark.soak) for case in listed]
