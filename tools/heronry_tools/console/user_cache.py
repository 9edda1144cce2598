"""The user's cache of results: the folder of each kind of result, and the digest that identifies an input."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path


def user_cache(kind: str) -> Path:
    """Return the cache folder for results of a kind: in ``$XDG_CACHE_HOME``, else in ``~/.cache``."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base.absolute() / "heronry" / kind


def digest_of(what: str, files: Iterable[tuple[str, Path]]) -> str:
    """Return a digest of a text and of the contents of named files: 16 hexadecimal digits."""
    digest = hashlib.sha256(what.encode())
    for name, file in files:
        digest.update(f"{name}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]
