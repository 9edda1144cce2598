"""Watches which inputs a module reads in its first steps, to find a misspelt name (`core/unknown_names`).

    watching   the first WATCHED_STEPS steps after a start: the module gets `WatchedInputs`
    over       later steps cost nothing; the misspelt names that were found stay known until the next start

A name counts as misspelt if no mode of the module needs it, and if it is similar to an input of the present mode that
the module has not read. A module that goes through all its inputs, or reads them by leaf, has read them all.
"""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from heronry_agent.core.unknown_names import misspelt
from heronry_agent.module import Datum, Inputs

WATCHED_STEPS = 10


class WatchedInputs(Inputs):
    """Inputs that note in `read` which variables are read; `needed` are those of the mode."""

    def __init__(self, by_leaf: Mapping[str, tuple[str, Datum]], read: set[str], needed: Collection[str]) -> None:
        super().__init__(by_leaf)
        self._read, self._needed = read, needed

    def __getitem__(self, variable: str) -> Datum:
        """Return the datum of a variable, as `Inputs` does."""
        self._read.add(variable)
        return super().__getitem__(variable)

    def get(self, variable: str, /, default: Any = None) -> Any:
        """Return the datum of a variable, or `default`, as `Inputs` does."""
        self._read.add(variable)
        return super().get(variable, default)

    def __iter__(self) -> Iterator[str]:
        self._read.update(self._needed)
        return super().__iter__()

    def leaf(self, path: str) -> Datum | None:
        """Return the datum at one leaf, as `Inputs` does."""
        self._read.update(self._needed)
        return super().leaf(path)

    def every(self, variable: str) -> list[Datum]:
        """Return the data of all leaves that read this variable, as `Inputs` does."""
        self._read.add(variable)
        return super().every(variable)


class ReadingWatch:
    """The names that one module reads, from its start on."""

    def __init__(self, needed: Collection[str], known: Collection[str]) -> None:
        """Begin to watch; `needed`: inputs of the present mode, `known`: those of all modes."""
        self._needed, self._known = needed, known
        self._read: set[str] = set()
        self._steps_left = WATCHED_STEPS if needed else 0
        self.misspelt: tuple[tuple[str, str], ...] = ()

    def inputs(self, by_leaf: Mapping[str, tuple[str, Datum]]) -> Inputs:
        """Return the inputs of the next step, watched or not."""
        if not self._steps_left:
            return Inputs(by_leaf)
        self._steps_left -= 1
        return WatchedInputs(by_leaf, self._read, self._needed)

    def stepped(self) -> tuple[tuple[str, str], ...]:
        """Return (name, the input that was probably meant) for each misspelt name, once the first steps are over."""
        if self._read and not self._steps_left:
            unread = sorted(frozenset(self._needed) - self._read)
            unknown = sorted(self._read.difference(self._known))
            self.misspelt = tuple(misspelt(unknown, unread)) if unread else ()
            self._read = set()
        return self.misspelt
