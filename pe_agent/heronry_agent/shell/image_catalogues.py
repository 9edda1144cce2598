"""Which class a spec's `image` means.

`package.module:Class` is imported as it stands, so that code of one's own needs no entry anywhere. A bare name is
looked up in the catalogues that installed packages offer under the entry point `heronry.images`: each is a mapping of
names to `package.module:Class`. Nothing is imported before it is asked for: a PE loads the code that it runs.
"""

import difflib
import importlib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points

from heronry_agent.module import Module
from heronry_wire.errors import HeronryError

_GROUP = "heronry.images"


class UnknownImageError(HeronryError, LookupError):
    """No such image; the message says what to write instead."""


def find_image(name: str) -> type[Module]:
    """Give the class of an image, importing it where needed.

    Raises UnknownImageError for a name that is neither in a catalogue nor an importable `package.module:Class` that
    is a `Module`.
    """
    target = name if ":" in name else _catalogue().get(name, name)
    module_name, _, class_name = target.partition(":")
    if not class_name or not module_name or module_name.startswith("."):
        raise UnknownImageError(_not_in_catalogue(name))
    try:
        found = getattr(importlib.import_module(module_name), class_name, None)
    except ImportError as error:
        raise UnknownImageError(
            f"image '{name}': cannot import {module_name} ({error}); is it installed here?"
        ) from error
    if not (isinstance(found, type) and issubclass(found, Module)):
        raise UnknownImageError(
            f"image '{name}': {module_name} has no class {class_name} derived from heronry_agent.module.Module"
        )
    return found


@cache
def _catalogue() -> Mapping[str, str]:
    """All catalogues of this installation as one; where two know a name, the first entry point by name has it."""
    offered = sorted(entry_points(group=_GROUP), key=lambda one: one.name, reverse=True)
    return {name: target for one in offered for name, target in one.load().items()}


def _not_in_catalogue(name: str) -> str:
    close = difflib.get_close_matches(name, _catalogue(), n=1)
    hint = f"did you mean '{close[0]}'?" if close else "write package.module:Class for code of your own"
    return f"there is no image '{name}'; {hint}"
