"""What is made once and kept for the user: where it is, and the name that says of what it was made."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path


def user_cache(kind: str) -> Path:
    """Folder for things of a kind: in ``$XDG_CACHE_HOME``, else in ``~/.cache``."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base.absolute() / "heronry" / kind


def digest_of(what: str, files: Iterable[tuple[str, Path]]) -> str:
    """Name of what depends on a text and on the contents of files, each with its own name: 16 hexadecimal digits."""
    digest = hashlib.sha256(what.encode())
    for name, file in files:
        digest.update(f"{name}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]
