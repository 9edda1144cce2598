"""How images read their inputs: a datum is present, valid and a finite number, or it counts as missing.

There are three ways to have no datum (not supplied, too old, declared invalid by its producer) and a fourth with a
broken producer (not a number). The result is None for all of them.
"""

import math

from heronry_agent.module import Inputs


def number(inputs: Inputs, variable: str) -> float | None:
    """Value of a variable as a finite float, or None."""
    datum = inputs.get(variable)
    if datum is None or not datum.valid or not isinstance(datum.value, (int, float)):
        return None
    return float(datum.value) if math.isfinite(datum.value) else None


def whole(inputs: Inputs, variable: str) -> int | None:
    """Value of a variable as an integer, or None; for states, counts and commands."""
    value = number(inputs, variable)
    return None if value is None else int(value)


def numbers(inputs: Inputs, variable: str, count: int) -> tuple[int, ...] | None:
    """Value of a variable that is a tuple of `count` integers, or None."""
    datum = inputs.get(variable)
    if datum is None or not datum.valid or not isinstance(datum.value, tuple) or len(datum.value) != count:
        return None
    return datum.value


def held(value: float, limit: float) -> float:
    """Limit a value to -limit..limit."""
    return min(max(value, -limit), limit)
