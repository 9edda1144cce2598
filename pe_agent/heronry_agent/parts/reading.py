"""How images read numbers from their inputs: a datum that is not valid, or not a finite number, counts as missing.

A datum is missing for `number` and `whole` in four cases:

- The datum is not supplied.
- The datum is too old.
- The producer has declared the datum invalid.
- The datum is not a finite number, because its producer is broken.
"""

import math

from heronry_agent.module import Inputs, Value


def number(inputs: Inputs, variable: str) -> float | None:
    """Return the value of a variable as a finite float; None if the datum is missing (head of this file)."""
    datum = inputs.get(variable)
    if datum is None or not datum.valid or not isinstance(datum.value, (int, float)):
        return None
    return float(datum.value) if math.isfinite(datum.value) else None


def whole(inputs: Inputs, variable: str) -> int | None:
    """Return the value of a variable, truncated to an integer; None if the datum is missing (head of this file)."""
    value = number(inputs, variable)
    return None if value is None else int(value)


def numbers(inputs: Inputs, variable: str, count: int) -> tuple[int, ...] | None:
    """Return the value of a variable that is a tuple of `count` integers.

    None if there is no valid datum, or its value is not a tuple of this length.
    """
    datum = inputs.get(variable)
    if datum is None or not datum.valid or not isinstance(datum.value, tuple) or len(datum.value) != count:
        return None
    return datum.value


def is_finite(value: Value) -> bool:
    """Tell whether a value is a finite number."""
    return isinstance(value, (int, float)) and math.isfinite(value)


def held(value: float, limit: float) -> float:
    """Limit a value to the range -limit..limit, and return it."""
    return min(max(value, -limit), limit)
