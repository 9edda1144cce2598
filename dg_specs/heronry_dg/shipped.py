"""Finds the shipped specs: they lie beside this package in a checkout, and inside it in an installed wheel."""

from pathlib import Path

from heronry_dg.loader import SUFFIX
from heronry_wire.errors import HeronryError

_PACKAGE = Path(__file__).resolve().parent
_FOLDERS = (_PACKAGE.parent, _PACKAGE / "specs")
_FLIGHTS = tuple(folder / "flights" for folder in _FOLDERS)  # specs of aircraft in a flight dynamics model


class UnknownSpecError(HeronryError, LookupError):
    """No spec with that name is shipped; the message lists the shipped ones."""


def shipped_spec_names() -> tuple[str, ...]:
    """Names of all shipped specs, sorted."""
    return tuple(sorted({path.name.removesuffix(SUFFIX) for folder in _FOLDERS for path in folder.glob(f"*{SUFFIX}")}))


def example_specs() -> tuple[Path, ...]:
    """Files of the small example specs, sorted."""
    folder = shipped_spec_path(shipped_spec_names()[0]).parent / "examples"
    return tuple(sorted(folder.glob(f"*{SUFFIX}")))


def flight_specs() -> tuple[Path, ...]:
    """Files of the specs whose aircraft fly in a flight dynamics model, sorted."""
    return tuple(sorted(path for folder in _FLIGHTS for path in folder.glob(f"*{SUFFIX}")))


def shipped_spec_path(name: str) -> Path:
    """Return the file of a shipped spec, or of a spec that `heronry fly` flies; raises UnknownSpecError."""
    found = (path for folder in (*_FOLDERS, *_FLIGHTS) if (path := folder / f"{name}{SUFFIX}").is_file())
    for path in found:
        return path
    names = ", ".join(shipped_spec_names()) or "none"
    raise UnknownSpecError(f"no spec named '{name}' is shipped; the shipped specs are {names}")
