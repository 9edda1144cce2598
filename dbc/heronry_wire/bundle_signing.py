"""Who made a bundle: ed25519 keys, the signature of a bundle, and what a bundle demands of the computer that runs it.

A *signing key* is one line "heronry-signing-key " and 64 hexadecimal digits, in a file that its owner alone may read;
it stays with those who build. The *public key* beside it, in a file with `.pub` behind the name, is one line
"heronry-public-key " and 64 digits; each PE is given it, and it is no secret. The fleet's key (`key_file`), by which
frames are proven, is another one: every node has that key, and no node shall be able to sign code.

A key is lost: whoever finds it can sign code. Then a new key goes to each PE, by a way other than the bus.

`cryptography` takes 8 MB when it is imported, so only commands and the loader's short-lived processes import this file.
"""

import hashlib
import os
import re
import stat
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from packaging.requirements import InvalidRequirement, Requirement

from heronry_wire.bundle import (
    KEY_NAME_BYTES,
    SIGNED,
    Bundle,
    BundleError,
    ForeignBundleError,
    Manifest,
    this_python,
)
from heronry_wire.ordinary_file import read_ordinary

_SECRET, _PUBLIC = "heronry-signing-key", "heronry-public-key"
_DIGITS = 64
_MOST = 256
_MAKE = "'heronry key --signing FILE' makes the two"


def make_signing_key(file: Path) -> str:
    """Draw a key, write it to the new file `file` and its public half beside it; returns the name of the key.

    Raises BundleError where one of the files exists or cannot be made; then neither of them is left behind.
    """
    key = Ed25519PrivateKey.generate()
    public = file.with_name(f"{file.name}.pub")
    made: list[Path] = []
    try:
        for path, kind, raw, mode in (
            (file, _SECRET, key.private_bytes_raw(), 0o600),
            (public, _PUBLIC, key.public_key().public_bytes_raw(), 0o644),
        ):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            made.append(path)
            with os.fdopen(descriptor, "w", encoding="ascii") as stream:
                stream.write(f"{kind} {raw.hex()}\n")
                stream.flush()
                os.fsync(stream.fileno())
    except OSError as error:
        for path in made:
            path.unlink(missing_ok=True)
        if isinstance(error, FileExistsError):
            raise BundleError(f"{error.filename} exists, and heronry overwrites no key: name another file") from error
        named = error.filename or file
        raise BundleError(f"{named}: {error.strerror}; name a file in a folder to which you can write") from error
    return key_name(key.public_key()).hex()


def read_public_key(file: Path) -> Ed25519PublicKey:
    """Read the public key from its file; raises BundleError."""
    return Ed25519PublicKey.from_public_bytes(_read(file, _PUBLIC))


def key_name(public: Ed25519PublicKey) -> bytes:
    """Return the name of a key: the first bytes of the SHA-256 of its public half."""
    return hashlib.sha256(public.public_bytes_raw()).digest()[:KEY_NAME_BYTES]


def sign(bundle: Bundle, file: Path) -> Bundle:
    """Return the bundle with the signature of the signing key in `file`; raises BundleError."""
    key = Ed25519PrivateKey.from_private_bytes(_read(file, _SECRET))
    return Bundle(bundle.manifest, key_name(key.public_key()), key.sign(SIGNED + bundle.archive), bundle.archive)


def check_signature(bundle: Bundle, public: Ed25519PublicKey) -> None:
    """Raise ForeignBundleError unless the bundle is signed with this key."""
    if not bundle.is_signed:
        raise ForeignBundleError("it is not signed: sign it with 'heronry bundle sign'")
    if bundle.key_name != key_name(public):
        raise ForeignBundleError(
            f"it is signed with the key {bundle.key_name.hex()}, not with {key_name(public).hex()}: sign it with this"
        )
    try:
        public.verify(bundle.signature, SIGNED + bundle.archive)
    except InvalidSignature:
        raise ForeignBundleError("its signature is wrong, so it was changed after it was signed: get it anew") from None


def check_here(manifest: Manifest) -> None:
    """Raise ForeignBundleError where this Python, or what is installed in it, is not what a bundle needs."""
    if manifest.python != this_python():
        raise ForeignBundleError(
            f"it is for Python {manifest.python}, and this is {this_python()}: build it with this one"
        )
    for wheel in manifest.wheels:
        wanted = read_wheel(wheel)
        try:
            found = version(wanted.name)
        except PackageNotFoundError:
            raise ForeignBundleError(f"it needs {wheel}, which is not here: install it on this node") from None
        if not wanted.specifier.contains(found, prereleases=True):
            raise ForeignBundleError(f"it needs {wheel}, and {found} is here: install that version on this node")


def read_wheel(text: str) -> Requirement:
    """Read what a bundle needs besides its own files, as pip writes it; raises BundleError."""
    try:
        return Requirement(text)
    except InvalidRequirement as error:
        raise BundleError(f"'{text}' names no package: write it as for pip, for example numpy>=1.26") from error


def _read(file: Path, kind: str) -> bytes:
    try:
        text = read_ordinary(file, _MOST).decode("ascii", "replace")
        mode = file.stat().st_mode
    except OSError as error:
        raise BundleError(f"{file}: {error.strerror}; {_MAKE}") from error
    found = re.fullmatch(rf"{kind} ([0-9a-f]{{{_DIGITS}}})\n?", text)
    if found is None:
        other = _PUBLIC if kind == _SECRET else _SECRET
        hint = f"it holds a {other}" if text.startswith(other) else f"it holds no {kind}"
        raise BundleError(f"{file}: {hint}; {_MAKE}")
    if kind == _SECRET and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise BundleError(
            f"{file} can be read or changed by others (mode {stat.S_IMODE(mode):04o}), so it is no secret; "
            "make a new key with 'heronry key --signing'"
        )
    return bytes.fromhex(found[1])
