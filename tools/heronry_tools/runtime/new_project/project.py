"""Writes a project: all of its files, or none."""

import keyword
import os
import re
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from heronry_tools.console.errors import UserError
from heronry_tools.runtime import deployment

_TEMPLATES = Path(__file__).with_name("templates")
_UNITS = ("heronry-agent@.service", "heronry-manager@.service")
_NAME = re.compile(r"[a-z][a-z0-9_]{0,29}")
_PLACE = "NAME"
_ENDING = ".template"  # Python files of a project are no files of heronry, so no linter reads them


def write_project(name: str, parent: Path) -> list[Path]:
    """Write a project into a new folder of its name in `parent`; returns its files, relative to `parent`.

    Raises UserError for a name that cannot be that of a package, and for a folder that is there already.
    """
    _check_name(name)
    folder = parent / name
    if os.path.lexists(folder):
        raise UserError(f"{folder} exists already; choose another name, or remove it")
    try:
        with tempfile.TemporaryDirectory(prefix=f".{name}-", dir=parent) as staging:
            made = Path(staging) / name
            for place, text in _files(name):
                (made / place).parent.mkdir(parents=True, exist_ok=True)
                (made / place).write_text(text, encoding="utf-8")
            made.rename(folder)
    except OSError as error:
        raise UserError(f"{parent}: {error.strerror}; choose a folder that you may write to") from None
    return sorted(file.relative_to(parent) for file in folder.rglob("*") if file.is_file())


def _check_name(name: str) -> None:
    if not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise UserError(
            f"{name:.60} cannot be the name of a Python package; use small letters, digits and _, at most 30, "
            "and begin with a letter"
        )
    if find_spec(name) is not None:
        raise UserError(f"there is a Python package {name} already, which would hide the new one; choose another name")


def _files(name: str) -> Iterator[tuple[str, str]]:
    for template in sorted(_TEMPLATES.rglob("*")):
        if template.is_file():
            place = str(template.relative_to(_TEMPLATES)).removesuffix(_ENDING)
            yield place.replace(_PLACE, name), template.read_text(encoding="utf-8").replace(_PLACE, name)
    for unit in _UNITS:
        yield f"units/{unit}", Path(deployment.__path__[0], unit).read_text(encoding="utf-8")
