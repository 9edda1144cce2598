"""The file that holds a fleet's key: one line of 64 hexadecimal digits, which only its owner may read.

A file that other users own, or may read or change, is refused, because its key must not count as secret any more.
`make_key` draws the key from the system's random source, creates the file with mode 0600, and never overwrites a file.
"""

import os
import re
import stat
from pathlib import Path

from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.errors import HeronryError

_TEXT = re.compile(rf"[0-9a-f]{{{2 * KEY_BYTES}}}\n?", re.ASCII)
_FOR_OTHERS = stat.S_IRWXG | stat.S_IRWXO


class KeyFileError(HeronryError):
    """The key cannot be read or made; the message is one sentence with the remedy."""


def read_key(file: Path) -> Key:
    """Read a key from its file; raises KeyFileError."""
    try:
        with os.fdopen(os.open(file, os.O_RDONLY | os.O_NONBLOCK), encoding="ascii") as stream:
            known = os.fstat(stream.fileno())
            text = stream.read(2 * KEY_BYTES + 2)
    except OSError as error:
        remedy = "name a key file that you can read, or make a key with 'heronry key FILE'"
        raise KeyFileError(f"{file}: {error.strerror}; {remedy}") from error
    except UnicodeDecodeError as error:
        raise KeyFileError(f"{file} holds no key; 'heronry key' makes one") from error
    mode = known.st_mode
    if known.st_uid not in (0, os.geteuid()):
        raise KeyFileError(
            f"{file} belongs to another user (user ID {known.st_uid}), so its key is no secret; "
            "give the command as that user, or make a new key with 'heronry key'"
        )
    if mode & _FOR_OTHERS:
        raise KeyFileError(
            f"{file} can be read or changed by others (mode {stat.S_IMODE(mode):04o}), so its key is no secret; "
            "make a new key with 'heronry key', and give each copy of it the mode 0600"
        )
    if _TEXT.fullmatch(text) is None:
        raise KeyFileError(
            f"{file} holds no key (a key is {2 * KEY_BYTES} hexadecimal digits); 'heronry key' makes one"
        )
    return Key(bytes.fromhex(text))


def make_key(file: Path) -> Key:
    """Draw a key and write it to a new file; raises KeyFileError where the file exists or cannot be made."""
    secret, descriptor = os.urandom(KEY_BYTES), -1
    try:
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, stat.S_IRUSR | stat.S_IWUSR)
        with os.fdopen(descriptor, "w", encoding="ascii") as stream:
            stream.write(f"{secret.hex()}\n")
            stream.flush()
            os.fsync(stream.fileno())
    except FileExistsError as error:
        raise KeyFileError(f"{file} exists already, and heronry overwrites no key: name another file") from error
    except OSError as error:
        if descriptor >= 0:
            file.unlink(missing_ok=True)  # this call made it, and it holds no key
        remedy = "name a file in an existing folder to which you can write"
        raise KeyFileError(f"{file}: {error.strerror}; {remedy}") from error
    return Key(secret)
