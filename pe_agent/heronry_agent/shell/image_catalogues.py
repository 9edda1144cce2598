"""Which class the `image` of a spec names.

`package.module:Class` is imported directly, so that a user's own code needs no entry in a catalogue. A bare name is
looked up in the catalogues that installed packages offer under the entry point `heronry.images`. A catalogue is a
mapping of names to `package.module:Class`. An image is imported when it is first needed, so a PE loads only the code
that it runs. A catalogue that cannot be loaded does not affect the others; the message about an unknown image names
that catalogue.
"""

import importlib
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.machinery import ModuleSpec
from importlib.metadata import entry_points
from typing import NamedTuple

from heronry_agent.module import Module
from heronry_wire.errors import HeronryError
from heronry_wire.spelling import meant

_GROUP = "heronry.images"


class UnknownImageError(HeronryError, LookupError):
    """An image does not exist or cannot be imported; the message says what to write instead."""


def find_image(name: str) -> type[Module]:
    """Return the class of an image, and import its code if necessary.

    Raises UnknownImageError if the name is in no catalogue and is not `package.module:Class`, or if its code cannot be
    imported or has no subclass of `Module` with this class name.
    """
    target = name if ":" in name else _catalogues().images.get(name, name)
    module_name, _, class_name = target.partition(":")
    if not class_name or not module_name or module_name.startswith("."):
        raise UnknownImageError(_not_in_catalogue(name))
    try:
        found = getattr(importlib.import_module(module_name), class_name, None)
    except ImportError as error:
        raise UnknownImageError(
            f"image '{name}': cannot import {module_name} ({error}); install what is missing, or set PYTHONPATH"
        ) from error
    if not (isinstance(found, type) and issubclass(found, Module)):
        raise UnknownImageError(
            f"image '{name}': {module_name} has no class {class_name} derived from heronry_agent.module.Module"
        )
    return found


def why_not_here(name: str) -> str | None:
    """Return a sentence that says why the code of an image is not installed here; None if the code is installed.

    The code is only searched for and not imported, so it may still be broken.
    """
    target = name if ":" in name else _catalogues().images.get(name, "")
    module, _, _ = target.partition(":")
    if not module:
        return _not_in_catalogue(name)
    return None if is_installed(module) else f"image '{name}': there is no {module} here; install it, or set PYTHONPATH"


def is_installed(module: str) -> bool:
    """Tell whether there is a Python module of this name here; nothing is imported."""
    path: Sequence[str] | None = None
    parts = module.split(".")
    for number in range(1, len(parts) + 1):
        found = _spec_of(".".join(parts[:number]), path)
        if found is None:
            return False
        path = found.submodule_search_locations
        if path is None and number < len(parts):
            return False
    return True


def _spec_of(module: str, path: Sequence[str] | None) -> ModuleSpec | None:
    """Find a Python module as `import` would; None if there is no such module."""
    for finder in sys.meta_path:
        with suppress(Exception):  # a finder is foreign code
            spec = finder.find_spec(module, path)
            if spec is not None:
                return spec
    return None


class _Catalogues(NamedTuple):
    """All installed catalogues, merged into one mapping, and a sentence for each catalogue that cannot be loaded."""

    images: Mapping[str, str]
    broken: tuple[str, ...]


@cache
def _catalogues() -> _Catalogues:
    """Load every catalogue; if two have the same image name, the entry point whose name sorts first wins."""
    images: dict[str, str] = {}
    broken: list[str] = []
    for offered in sorted(entry_points(group=_GROUP), key=lambda one: one.name, reverse=True):
        try:
            images |= dict(offered.load())
        except Exception as error:  # noqa: BLE001 - foreign code is imported here, and may raise anything
            broken.append(f"; catalogue '{offered.name}' cannot be loaded ({type(error).__name__}: {error})")
    return _Catalogues(images, tuple(broken))


def catalogue_names() -> list[str]:
    """Return the names of the images in all installed catalogues, sorted."""
    return sorted(_catalogues().images)


def _not_in_catalogue(name: str) -> str:
    known = _catalogues()
    hint = meant(name, known.images, "write package.module:Class for code of your own")
    return f"there is no image '{name}'; {hint}{''.join(known.broken)}"
