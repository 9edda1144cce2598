"""The digest of a module's code: a state is restored only by the version of the code that has saved it.

The digest covers the files of the module's class and of its base classes, and the files that they name in their import
statements, directly or through others, with the packages in which they are, as long as they belong to the same top-
level package or to `heronry_agent.parts`. The statements are read, wherever they stand, and not what has been imported:
that differs from one partition to another. A compiled module counts by its source, if that lies beside it. Other
packages are not covered: if a new version of one of them gives the saved numbers another meaning, change a line of the
module, too.
"""

import ast
import sys
from collections.abc import Iterator
from hashlib import sha256
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from heronry_wire.checkpoint_frames import DIGEST_BYTES

_PARTS = "heronry_agent.parts"
_DIGESTS: dict[type, bytes] = {}


def code_digest(code: type) -> bytes:
    """Return the digest of a class and of the files that it is made of, 8 bytes; a class without files counts alone.

    A file is read by what has imported it, from a bundle too. Raises what that raises where the file is gone: OSError,
    ImportError, EOFError or zlib.error.
    """
    known = _DIGESTS.get(code)
    if known is None:
        known = _DIGESTS[code] = _digest(code)
    return known


def _digest(code: type) -> bytes:
    digest = sha256(f"{code.__module__}:{code.__qualname__}".encode())
    for name, content in sorted(_files(code)):
        digest.update(f"\n{name} {len(content)}\n".encode() + content)
    return digest.digest()[:DIGEST_BYTES]


def _files(code: type) -> Iterator[tuple[str, bytes]]:
    package = code.__module__.partition(".")[0]
    frontier, seen = [base.__module__ for base in code.__mro__], set[str]()
    while frontier:
        name = frontier.pop()
        is_own = name.partition(".")[0] == package or f"{name}.".startswith(f"{_PARTS}.")
        if name in seen or not is_own:
            continue
        seen.add(name)
        file, loader, folders = _place(name)
        read = getattr(loader, "get_data", None)
        if file is not None and read is not None:
            content, parent = read(_source(file)), name.rpartition(".")[0]
            yield name, content
            frontier += [parent, *_imported(content, parent if folders is None else name)]


def _source(file: str) -> str:
    """Return the source beside a compiled module, which is the same on each machine; any other file as it is."""
    path = Path(file)
    source = path.with_name(path.name.partition(".")[0] + ".py")
    return str(source) if path.suffix == ".so" and source.is_file() else file


def _place(name: str) -> tuple[str | None, Any, Any]:
    """Return the file, the loader and, of a package, the folders of a module, whether it has been imported or not."""
    module = sys.modules.get(name)
    if module is not None:
        return getattr(module, "__file__", None), module.__loader__, getattr(module, "__path__", None)
    parent = name.rpartition(".")[0]
    folders = _place(parent)[2] if parent else None
    found = None if parent and folders is None else PathFinder.find_spec(name, folders)
    return (None, None, None) if found is None else (found.origin, found.loader, found.submodule_search_locations)


def _imported(content: bytes, package: str) -> Iterator[str]:
    """Yield the names that may be modules in the import statements of a file of a package; none if it is no source."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            origin = ".".join([*above, *filter(None, [node.module])])
            yield origin
            yield from (f"{origin}.{one.name}" for one in node.names)
