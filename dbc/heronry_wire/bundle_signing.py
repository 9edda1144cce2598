"""Who made a bundle: ed25519 keys, and the signature of a bundle.

The keys and their files: `bundle_keys`.

`cryptography` takes 8 MB when it is imported, so only commands and the loader's short-lived processes import this file.
"""

import hashlib
import os
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from heronry_wire.bundle import (
    KEY_NAME_BYTES,
    SIGNED,
    Bundle,
    BundleError,
    ForeignBundleError,
)
from heronry_wire.bundle_keys import PUBLIC, SECRET, read_key_file


def make_signing_key(file: Path) -> str:
    """Draw a key, write it to the new file `file` and its public half beside it; returns the name of the key.

    Raises BundleError where one of the files exists or cannot be made; then neither of them is left behind.
    """
    key = Ed25519PrivateKey.generate()
    public = file.with_name(f"{file.name}.pub")
    made: list[Path] = []
    try:
        for path, kind, raw, mode in (
            (file, SECRET, key.private_bytes_raw(), 0o600),
            (public, PUBLIC, key.public_key().public_bytes_raw(), 0o644),
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
    return Ed25519PublicKey.from_public_bytes(read_key_file(file, PUBLIC))


def key_name(public: Ed25519PublicKey) -> bytes:
    """Return the name of a key: the first bytes of the SHA-256 of its public half."""
    return hashlib.sha256(public.public_bytes_raw()).digest()[:KEY_NAME_BYTES]


def sign(bundle: Bundle, file: Path) -> Bundle:
    """Return the bundle with the signature of the signing key in `file`; raises BundleError."""
    key = Ed25519PrivateKey.from_private_bytes(read_key_file(file, SECRET))
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
