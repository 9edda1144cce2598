"""Finds misspelt outputs: a step gives a name that is like an output of the module's mode, and lacks that output.

The agent cannot publish such a value. The module counts as running, and its function as served, while its readers never
get the datum. So the agent tells its manager once a second (a notice, no fault), and its log names what was meant. Code
may compute more than a spec takes from it, and need not give every output in every step; so nothing is told of a name
that is like no output that is lacking.
"""

from collections.abc import Collection

from heronry_wire.pe_table import ModuleEntry
from heronry_wire.spelling import close

_LIKENESS = 0.8


def misspelt_output(entry: ModuleEntry, of_mode: Collection[str], given: Collection[str]) -> tuple[str, str] | None:
    """Give a misspelt variable of a step, and the output of its mode that was meant; None if no variable is misspelt.

    of_mode: the outputs of the present mode. given: what the step gives.
    """
    lacking = [name for name in of_mode if name not in given]
    if not lacking:
        return None
    known = {name for mode in entry.modes for name in mode.gives}
    pairs = ((name, close(name, lacking, _LIKENESS)) for name in given if name not in known)
    return next(((name, meant) for name, meant in pairs if meant is not None), None)
