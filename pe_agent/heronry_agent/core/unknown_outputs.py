"""Finds the outputs of a step that no mode of the module has, such as a misspelt name.

The agent cannot publish such a value. If the agent only dropped it, the module would count as running, and its function
as served, while its readers never get the datum. So the module has failed, and the sentence names what it may give.
"""

from heronry_wire.errors import HeronryError
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.spelling import close


class UnknownOutputError(HeronryError, LookupError):
    """A module gave an output that none of its modes has; the message names those that it has."""


def expect_output(entry: ModuleEntry, variable: str) -> None:
    """Return if some mode of the module gives this variable; raises UnknownOutputError otherwise."""
    known = list(dict.fromkeys(name for mode in entry.modes for name in mode.gives))
    if variable in known:
        return
    found = close(variable, known)
    meant = f"; did you mean '{found}'?" if found else ""
    has = f"the spec lets it give {', '.join(known)}" if known else "the spec lets it give nothing"
    raise UnknownOutputError(f"its step gives '{variable}'{meant} ({has})")
