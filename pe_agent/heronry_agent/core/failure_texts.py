"""The text of each module's last failure, for which the failure's EMCY has no room.

The agent keeps one reason and one traceback for each module of its table, at most 2.2 kB: the newest failure replaces
the one before it. The texts stay until the agent ends, even if the fault is cleared or the module runs again. Objects
2015h and 2016h give the texts to any SDO client; the manager reads the reason when an EMCY has reported the failure. A
text comes from the code of a module, so characters other than printable ASCII are escaped first (`failure_text`).
"""

from heronry_agent.core.vocabulary import Failure
from heronry_wire.failure_text import plain_reason, plain_traceback

_NONE = Failure("")


class FailureTexts:
    """The failures of the modules of one PE."""

    def __init__(self) -> None:
        self._last: dict[int, Failure] = {}  # by index of the module

    def found(self, module: int, failure: Failure) -> str:
        """Store the last failure of a module, and return its reason as plain text."""
        plain = Failure(plain_reason(failure.reason), plain_traceback(failure.traceback))
        self._last[module] = plain
        return plain.reason

    def last(self, module: int) -> Failure:
        """Return the last failure of a module; its texts are empty if the module has not failed."""
        return self._last.get(module, _NONE)
