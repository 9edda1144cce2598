"""The files of the keys that sign code.

A *signing key* is one line "heronry-signing-key " and 64 hexadecimal digits, in a file that its owner alone may read;
it stays with those who build. The *public key* beside it, in a file with `.pub` behind the name, is one line
"heronry-public-key " and 64 digits; each PE is given it, and it is no secret. The fleet's key (`key_file`), by which
frames are proven, is another one: every node has that key, and no node shall be able to sign code.

A key is lost: whoever finds it can sign code. Then a new key goes to each PE, by a way other than the bus.

This file reads them, and needs nothing that is slow to import; `bundle_signing` uses them.
"""

import re
import stat
from pathlib import Path

from heronry_wire.bundle import BundleError
from heronry_wire.ordinary_file import read_ordinary

SECRET, PUBLIC = "heronry-signing-key", "heronry-public-key"
_DIGITS = 64
_MOST = 256
_MAKE = "'heronry key --signing FILE' makes the two"


def read_key_file(file: Path, kind: str) -> bytes:
    """Return the 32 bytes of a key of this kind, SECRET or PUBLIC; raises BundleError."""
    try:
        text = read_ordinary(file, _MOST).decode("ascii", "replace")
        mode = file.stat().st_mode
    except OSError as error:
        raise BundleError(f"{file}: {error.strerror}; {_MAKE}") from error
    found = re.fullmatch(rf"{kind} ([0-9a-f]{{{_DIGITS}}})\n?", text)
    if found is None:
        other = PUBLIC if kind == SECRET else SECRET
        hint = f"it holds a {other}" if text.startswith(other) else f"it holds no {kind}"
        raise BundleError(f"{file}: {hint}; {_MAKE}")
    if kind == SECRET and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise BundleError(
            f"{file} can be read or changed by others (mode {stat.S_IMODE(mode):04o}), so it is no secret; "
            "make a new key with 'heronry key --signing'"
        )
    return bytes.fromhex(found[1])
