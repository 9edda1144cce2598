"""Finds misspelt names: a step leaves out an output or input of its mode, but uses a similar name that the spec lacks.

The agent cannot publish such an output, and cannot supply such an input. The module counts as running, and its function
as served, although data are missing. So the agent informs its manager once a second (this is no fault), and the log of
the agent names what was probably meant. A module may compute more values than its mode has outputs, may leave outputs
and inputs out, and may ask for variables that only another spec has; so other unknown names are not reported.

Outputs are compared here, after each step. Inputs are compared where the module reads them (`shell/reading_watch`).
"""

from collections.abc import Collection, Iterable, Iterator

from heronry_wire.pe_table import ModuleEntry
from heronry_wire.spelling import close

_LIKENESS = 0.8


def misspelt_output(entry: ModuleEntry, missing: Collection[str], given: Iterable[str]) -> tuple[str, str] | None:
    """Return a misspelt name and the output that was probably meant; None if no name is misspelt.

    missing: outputs of the present mode for which the step gives no value. given: names under which it gives values.
    """
    if not missing:
        return None
    known = {name for mode in entry.modes for name in mode.gives}
    return next(misspelt((name for name in given if name not in known), missing), None)


def misspelt(names: Iterable[str], unused: Collection[str]) -> Iterator[tuple[str, str]]:
    """Yield each of some unknown names that is similar to an unused one, with the one that was probably meant."""
    for name in names:
        meant = close(name, unused, _LIKENESS)
        if meant is not None:
            yield name, meant
