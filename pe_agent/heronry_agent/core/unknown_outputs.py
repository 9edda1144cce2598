"""Finds misspelt outputs: a step gives a name that no mode of the module has, and lacks an output of the present mode.

The agent cannot publish such a value. If the agent only dropped it, the module would count as running, and its function
as served, while its readers never get the datum. So the module has failed, and the sentence names what it may give.
Code may compute more than a spec takes from it: a step that gives every output of its mode may give others as well.
"""

from collections.abc import Collection

from heronry_wire.errors import HeronryError
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.spelling import close


class UnknownOutputError(HeronryError, LookupError):
    """A module gave an output that none of its modes has; the message names those that it has."""


def expect_outputs(entry: ModuleEntry, of_mode: Collection[str], given: Collection[str]) -> None:
    """Compare what a step has given with the outputs of its mode; raises UnknownOutputError for a misspelt one."""
    known = list(dict.fromkeys(name for mode in entry.modes for name in mode.gives))
    unknown = next((name for name in given if name not in known), None)
    if unknown is None or set(of_mode) <= set(given):
        return
    found = close(unknown, known)
    meant = f"; did you mean '{found}'?" if found else ""
    raise UnknownOutputError(f"its step gives '{unknown}'{meant} (the spec lets it give {', '.join(known)})")
