"""The text of each module's last failure, for which the failure's EMCY has no room.

For each module of its table, the agent keeps the reason and the traceback of the last failure, together at most 2.2 kB.
They stay until the module fails again or the agent ends, even if the fault is cleared or the module runs again.

An SDO client can read the reasons in object 2015h, and the tracebacks in object 2016h. The manager reads the reason
after an EMCY has reported the failure. The texts come from the code of modules, which is not trusted. So all characters
except printable ASCII are escaped first (`failure_text`).
"""

from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.vocabulary import Failure
from heronry_wire.failure_text import plain_reason, plain_traceback

_NONE = Failure("")
_MOST_NAMES = 4


class FailureTexts:
    """Keeps the last failure of each module of one PE: its reason and its traceback."""

    def __init__(self) -> None:
        self._last: dict[int, Failure] = {}  # by index of the module

    def found(self, module: int, failure: Failure) -> str:
        """Store the last failure of a module, and return its reason as plain text."""
        plain = Failure(plain_reason(failure.reason), plain_traceback(failure.traceback))
        self._last[module] = plain
        return plain.reason

    def last(self, module: int) -> Failure:
        """Return the last failure of a module; a Failure with empty texts if the module has not failed."""
        return self._last.get(module, _NONE)

    def carry_over(self, carried: CarriedOver) -> None:
        """Keep the failures of the modules that another table has, too."""
        named = carried.named_modules
        self._last = {named[module]: failure for module, failure in self._last.items() if module in named}


def with_names(modules: list[str]) -> str:
    """Name the first few modules of a partition, as a part of a sentence: ", with A, B and 2 more,"."""
    more = f" and {len(modules) - _MOST_NAMES} more" if len(modules) > _MOST_NAMES else ""
    return f", with {', '.join(modules[:_MOST_NAMES])}{more}," if modules else ""
