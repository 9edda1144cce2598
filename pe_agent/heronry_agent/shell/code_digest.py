"""The digest of a module's code: a state is restored only by the version of the code that has saved it.

The digest covers the file of the module's class, and the files from which this file imports, directly or through
others, as long as they belong to the same top-level package or to `heronry_agent.parts`. Other packages are not
covered: if a new version of one of them gives the saved numbers another meaning, change a line of the module, too.
"""

import inspect
import sys
from collections.abc import Iterator
from hashlib import sha256
from types import ModuleType

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
        module = sys.modules.get(name)
        is_own = name.partition(".")[0] == package or f"{name}.".startswith(f"{_PARTS}.")
        if name in seen or module is None or not is_own:
            continue
        seen.add(name)
        file, read = getattr(module, "__file__", None), getattr(module.__loader__, "get_data", None)
        if file is not None and read is not None:
            yield name, read(file)
        frontier += _imported(module)


def _imported(module: ModuleType) -> Iterator[str]:
    """Yield the names of the modules from which the names in a module come."""
    for value in vars(module).values():
        if isinstance(value, ModuleType):
            yield value.__name__
        elif inspect.isclass(value) or inspect.isfunction(value):
            yield value.__module__
