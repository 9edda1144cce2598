"""A spec under check: what it means, and where its parts were written.

A check of a family is a function `check(subject, findings)`. It is called only for a spec that loads, so every form of
the draft is there and every name refers to something.
"""

from dataclasses import dataclass

from heronry_dg import yaml_source
from heronry_dg.draft import Draft
from heronry_dg.findings import Place
from heronry_dg.model import Spec


@dataclass(frozen=True, slots=True)
class Subject:
    """One loaded spec."""

    file: str
    draft: Draft
    spec: Spec

    def place(self, *path: str | int) -> Place:
        """Place of a key or list item, as `place("functions", "elevator", "output")`; of what is left of the path.

        A field that the file leaves out has the place of the element it belongs to.
        """
        place, node = self.draft.root.place, self.draft.root
        for step in path:
            match node:
                case yaml_source.Mapping(entries=entries) if isinstance(step, str) and step in entries:
                    place, node = entries[step].place, entries[step].node
                case yaml_source.Sequence(items=items) if isinstance(step, int) and step < len(items):
                    place, node = items[step].place, items[step]
                case _:
                    break
        return place
