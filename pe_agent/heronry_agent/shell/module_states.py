"""Saves the state of a module, and restores it: the calls of `save` and `restore`, and the checks of what they give.

A state is a few numbers, each packed as 8 bytes (a double of IEEE 754, little-endian). No exception of a module leaves
this file: a state that cannot be saved or restored is a `StateLacking` with the reason.
"""

import math
import struct
from collections.abc import Callable
from contextlib import AbstractContextManager

from heronry_agent.core.vocabulary import KeptState, StateLacking, StateRestored, StateSaved
from heronry_agent.module import Module
from heronry_agent.shell.code_digest import code_digest
from heronry_agent.shell.time_limit import TookTooLong
from heronry_wire.checkpoint_frames import Lack
from heronry_wire.errors import on_one_line

NUMBER_BYTES = 8

Limit = Callable[[], AbstractContextManager[None]]
Describe = Callable[[Module, Exception], str]


class ModuleStates:
    """Calls `save` and `restore` of modules."""

    def __init__(self, within: Limit, describe: Describe) -> None:
        """Begin; `within` limits the time of a call, and `describe` tells an exception of a module in one line."""
        self._within, self._describe = within, describe

    def save(
        self, module: int, code: Module, round_number: int, most_bytes: int, now_ns: int
    ) -> StateSaved | StateLacking:
        """Save the state of the module with this index, at most `most_bytes` bytes; the result repeats the round."""
        try:
            with self._within():
                given: object = code.save()
                numbers = _numbers(given)
                shown = f"{given!r:.60}" if numbers is None else ""
        except TookTooLong:
            return StateLacking(module, Lack.HANGS, "save takes too long")
        except Exception as error:  # noqa: BLE001 - code of a module may raise anything
            return StateLacking(module, Lack.RAISES, self._describe(code, error))
        if numbers is None:
            return StateLacking(module, Lack.NO_NUMBERS, f"save gives {shown}; return a tuple of finite numbers")
        length = len(numbers) * NUMBER_BYTES
        if length > most_bytes:
            reason = f"save gives {len(numbers)} numbers, {length} bytes; the spec has bytes: {most_bytes}"
            return StateLacking(module, Lack.TOO_LONG, reason)
        digest = _digest(code)
        if isinstance(digest, str):
            return StateLacking(module, Lack.RAISES, digest)
        return StateSaved(module, round_number, digest, struct.pack(f"<{len(numbers)}d", *numbers), now_ns)

    def restore(self, module: int, code: Module, kept: KeptState | Lack, now_ns: int) -> StateRestored | StateLacking:
        """Restore the state of the module with this index, if there is one that may be used now.

        After `Lack.REFUSED` the object `code` must not be used.
        """
        if isinstance(kept, Lack):
            return StateLacking(module, kept)
        if now_ns > kept.until_ns:
            return StateLacking(module, Lack.TOO_OLD)
        data = kept.state.data
        digest = _digest(code)
        if isinstance(digest, str):
            return StateLacking(module, Lack.OTHER_CODE, digest)
        if len(data) % NUMBER_BYTES or not kept.state.is_of(digest):
            return StateLacking(module, Lack.OTHER_CODE)
        age_ns = max(0, now_ns - kept.since_ns)
        try:
            with self._within():
                code.restore(struct.unpack(f"<{len(data) // NUMBER_BYTES}d", data), age_ns)
        except TookTooLong:
            return StateLacking(module, Lack.REFUSED, "restore takes too long")
        except Exception as error:  # noqa: BLE001 - code of a module may raise anything
            return StateLacking(module, Lack.REFUSED, self._describe(code, error))
        return StateRestored(module, age_ns)


def _digest(code: Module) -> bytes | str:
    """Return the digest of the code of a module, or why there is none."""
    try:
        return code_digest(type(code))
    except Exception as error:  # noqa: BLE001 - what has imported the code reads it, and may be anything
        return on_one_line(f"the files of its code cannot be read ({error}), so its state is of no known version")


def _numbers(given: object) -> list[float] | None:
    """Return the numbers of a state as doubles; None if it is no tuple or list of finite ones.

    The types may be a module's own, so this may raise anything, and may take long.
    """
    if not isinstance(given, tuple | list) or not all(isinstance(value, int | float) for value in given):
        return None
    try:
        numbers = [*map(float, given)]
    except OverflowError:
        return None
    return numbers if all(map(math.isfinite, numbers)) else None
