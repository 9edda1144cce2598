"""The errors that a PE has told, newest first: object 1003h of CANopen (CiA 301, 7.5.2.4).

One number for each EMCY that told something new, not for its repetitions: its code in bits 15..0, the index of the
element in bits 27..16 and its kind in bits 31..28. What does not fit any more is forgotten, and so is everything when a
client writes 0 to its number of errors, and with a restart.
"""

from collections import deque

from heronry_wire.canopen_objects import ERRORS_KEPT
from heronry_wire.management import ElementKind, FaultCode

_LARGEST_INDEX = 0xFFF


class ErrorHistory:
    """The last errors of one PE."""

    def __init__(self) -> None:
        self._errors: deque[int] = deque(maxlen=ERRORS_KEPT)

    @property
    def errors(self) -> tuple[int, ...]:
        """All of them, newest first."""
        return tuple(self._errors)

    def add(self, code: FaultCode, kind: ElementKind, index: int) -> None:
        """Something new was told."""
        self._errors.appendleft(kind << 28 | min(index, _LARGEST_INDEX) << 16 | code)

    def clear(self) -> None:
        """Forget them."""
        self._errors.clear()
