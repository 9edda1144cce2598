"""Finds misspelt outputs: a step gives a name that no mode of the module has, in place of an output of its mode.

The agent cannot publish such a value. If the agent only dropped it, the module would count as running, and its function
as served, while its readers never get the datum. So the module has failed, and the sentence names what it may give.
Code may compute more than a spec takes from it, and need not give every output in every step. So a name is misspelt
only if it is like an output of the mode that the step lacks, or if the step gives no output of the mode at all.
"""

from collections.abc import Collection

from heronry_wire.errors import HeronryError
from heronry_wire.pe_table import ModuleEntry
from heronry_wire.spelling import close


class UnknownOutputError(HeronryError, LookupError):
    """A module gave an output that none of its modes has; the message names the outputs that it may give."""


def expect_outputs(entry: ModuleEntry, of_mode: Collection[str], given: Collection[str]) -> None:
    """Compare what a step has given with the outputs of its mode; raises UnknownOutputError for a misspelt one."""
    known = list(dict.fromkeys(name for mode in entry.modes for name in mode.gives))
    lacking = [name for name in of_mode if name not in given]
    for unknown in (name for name in given if name not in known):
        meant = close(unknown, lacking)
        if meant or (lacking and len(lacking) == len(of_mode)):
            guess = f"; did you mean '{meant}'?" if meant else ""
            raise UnknownOutputError(f"its step gives '{unknown}'{guess} (the spec lets it give {', '.join(known)})")
