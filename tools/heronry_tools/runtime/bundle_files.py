"""The bundles in a folder, for a manager that brings them to PEs, and for what is checked before a flight."""

from pathlib import Path

from heronry_manager.core.settings import CodeBundle
from heronry_tools.console.errors import UserError
from heronry_wire.bundle import MOST_BYTES, SUFFIX, Bundle, BundleError, unpack
from heronry_wire.ordinary_file import read_ordinary


def read_bundle(file: Path) -> Bundle:
    """Read a bundle and check all but its signature; raises UserError."""
    try:
        return unpack(read_ordinary(file, MOST_BYTES + 1))
    except OSError as error:
        raise UserError(f"{file}: {error.strerror}; make a bundle with 'heronry bundle build'") from error
    except BundleError as error:
        raise UserError(f"{file}: {error}") from error


def read_bundles(folder: Path) -> tuple[CodeBundle, ...]:
    """Read every bundle of a folder, the files whose names end in `.bundle`; raises UserError.

    Signatures are for the PEs, which have the public key: a manager brings what a PE may refuse.
    """
    if not folder.is_dir():
        raise UserError(f"{folder} is no folder: name the folder that holds the bundles")
    read = (read_bundle(file) for file in sorted(folder.glob(f"*{SUFFIX}")))
    found = tuple(
        CodeBundle(one.manifest.name, one.manifest.version, frozenset(one.manifest.images), one.content) for one in read
    )
    if not found:
        raise UserError(f"{folder} holds no file whose name ends in {SUFFIX}: make one with 'heronry bundle build'")
    return found
