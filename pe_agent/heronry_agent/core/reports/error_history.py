"""The errors that a PE has reported, newest first: object 1003h of CANopen (CiA 301, 7.5.2.4).

The history holds one number for each new EMCY, and none for a repeated EMCY:

    bits 15..0     the code of the EMCY
    bits 27..16    the index of the element
    bits 31..28    the kind of the element

The oldest error is dropped when there is no room. The history is emptied when a client writes 0 to the number of
errors, when the PE is reset by NMT, and when it restarts.
"""

from collections import deque

from heronry_wire.canopen_objects import ERRORS_KEPT, LARGEST_INDEX
from heronry_wire.management import ElementKind, FaultCode


class ErrorHistory:
    """The last errors of one PE."""

    def __init__(self) -> None:
        self._errors: deque[int] = deque(maxlen=ERRORS_KEPT)

    @property
    def errors(self) -> tuple[int, ...]:
        """All errors in the history, newest first."""
        return tuple(self._errors)

    def add(self, code: FaultCode, kind: ElementKind, index: int) -> None:
        """Add an error as the newest; the caller leaves out repetitions of one report."""
        self._errors.appendleft(kind << 28 | min(index, LARGEST_INDEX) << 16 | code)

    def clear(self) -> None:
        """Empty the history."""
        self._errors.clear()
