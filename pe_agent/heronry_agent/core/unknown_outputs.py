"""Finds misspelt outputs: a step gives no value for an output of its mode, but gives a value under a similar name.

The agent cannot publish such a value. The module counts as running, and its function as served, although the modules
that read the output never get it. So the agent informs its manager once a second (this is no fault), and the log of the
agent names the output that was probably meant. A module may compute more values than its mode has outputs, and may
leave outputs out; so other unknown names are not reported.
"""

from collections.abc import Collection

from heronry_wire.pe_table import ModuleEntry
from heronry_wire.spelling import close

_LIKENESS = 0.8


def misspelt_output(entry: ModuleEntry, of_mode: Collection[str], given: Collection[str]) -> tuple[str, str] | None:
    """Return a misspelt name and the output that was probably meant; None if no name is misspelt.

    of_mode: names of the outputs of the present mode. given: names under which the step gives values.
    """
    lacking = [name for name in of_mode if name not in given]
    if not lacking:
        return None
    known = {name for mode in entry.modes for name in mode.gives}
    pairs = ((name, close(name, lacking, _LIKENESS)) for name in given if name not in known)
    return next(((name, meant) for name, meant in pairs if meant is not None), None)
