"""A spec under check: its model, and the places of its parts in the file.

Each family of rules has a function `check(subject, findings)`. This function is called only for a spec that loads. So
every element has its fields (in the draft of the spec no `form` is None), and every name refers to something.
"""

from dataclasses import dataclass
from typing import Final, Protocol

from heronry_dg import yaml_source
from heronry_dg.findings import Place
from heronry_dg.loader import Loaded
from heronry_dg.model import Spec


class Work(Protocol):
    """Shows the user how far a long check is."""

    def begin(self, what: str, total: int) -> None:
        """Begin a piece of work of `total` steps."""

    def step(self, steps: int = 1) -> None:
        """Count steps that are done."""


class _Unseen:
    """Work of which nobody sees how far it is."""

    def begin(self, what: str, total: int) -> None:
        pass

    def step(self, steps: int = 1) -> None:
        pass


UNSEEN: Final = _Unseen()


@dataclass(frozen=True, slots=True)
class Subject:
    """A spec that loads, and where in the file each of its parts is written; `work`: shows how far a check is."""

    file: str
    loaded: Loaded
    work: Work = UNSEEN

    @property
    def spec(self) -> Spec:
        """The spec as the loader built it."""
        return self.loaded.spec

    def leaf_places(self, module: str, mode: str) -> tuple[Place, ...]:
        """Return where in the file each input of a mode is written, in the order of `Mode.leaves`."""
        return self.loaded.gates.places[module, mode]

    def place(self, *path: str | int) -> Place:
        """Return the place in the file of a key or list item, such as `place("functions", "elevator", "output")`.

        If the file leaves a field out, the place is that of its element.
        """
        root = self.loaded.draft.root
        place, node = root.place, root
        for step in path:
            match node:
                case yaml_source.Mapping(entries=entries) if isinstance(step, str) and step in entries:
                    place, node = entries[step].place, entries[step].node
                case yaml_source.Sequence(items=items) if isinstance(step, int) and step < len(items):
                    place, node = items[step].place, items[step]
                case _:
                    break
        return place
