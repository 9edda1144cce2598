"""A bundle: the code of one or more images in one file, which travels over the bus and is signed.

    8 bytes    "HERONRY1", which is also the number of this format
    8 bytes    the name of the public key (`bundle_signing`); zeros: the bundle is not signed
    64 bytes   the signature, by ed25519, of SIGNED followed by the archive
    the rest   the archive, a ZIP file

The archive is never unpacked: Python imports from it (`zipimport`), so no name in it can lead to another place, and a
slot of a PE (`heronry_agent.loader`) is one file, whole or absent. Its first member, MANIFEST, is a JSON object:

    bundle     the name, by which an operator knows it
    version    1 to 4294967295; each version is higher than the ones before, and a PE takes no lower one
    python     major and minor of the Python for which the code was tested: "3.11"
    images     the images that it holds, as a spec writes them: package.module:Class
    wheels     what else must be installed on the PE, as pip writes it: "numpy>=1.26"
    files      for each other member its SHA-256, hexadecimal

The same files give the same bytes: members are sorted, and carry no time, owner or mode.

*Who may change it.* `sign` alone replaces the head. Every reader checks all that it uses: `unpack` believes nothing of
an archive whose names, sizes and digests do not agree with its manifest. What is wrong is told in one sentence
(BundleError). That the code itself does no harm is proven by the signature alone, which `bundle_signing` checks.

Neither this file nor `bundle_signing` is imported by an agent: short-lived processes of the loader use them.
"""

import hashlib
import json
import re
import stat
import struct
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any

from heronry_wire.errors import HeronryError, on_one_line

MAGIC = b"HERONRY1"
SIGNED = b"heronry bundle 1\n"
KEY_NAME_BYTES, SIGNATURE_BYTES = 8, 64
HEAD = struct.Struct(f"<{len(MAGIC)}s{KEY_NAME_BYTES}s{SIGNATURE_BYTES}s")
MANIFEST = "heronry-bundle.json"
SUFFIX = ".bundle"
MOST_BYTES = 1 << 20
"""Longest bundle in bytes, since a PE takes no longer value by SDO."""
MOST_UNPACKED = 16 << 20
"""Longest sum of all members in bytes, so that a few bytes cannot fill the memory of a PE."""
MOST_VERSION = 0xFFFF_FFFF

_NEVER = (1980, 1, 1, 0, 0, 0)  # the earliest time that a ZIP file can carry
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", re.ASCII)
_IMAGE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*", re.ASCII)
_PYTHON = re.compile(r"3\.\d{1,3}", re.ASCII)
_UNIX = 3  # the system of a member whose mode is a Unix mode
_AGAIN = "get the bundle anew"


class BundleError(HeronryError):
    """A bundle cannot be made or used; the message says in one sentence why, and what to do."""

    def __init__(self, sentence: str) -> None:
        super().__init__(on_one_line(sentence))


class LargeBundleError(BundleError):
    """A bundle is larger than what its place can take."""


class ForeignBundleError(BundleError):
    """A bundle is whole, and not for this computer or not signed as this computer demands."""


@dataclass(frozen=True, slots=True)
class Manifest:
    """What a bundle says of itself."""

    name: str
    version: int
    python: str
    images: tuple[str, ...]
    wheels: tuple[str, ...]
    files: Mapping[str, str]  # SHA-256 in hexadecimal, by path

    def to_json(self) -> str:
        """Return the text of the member MANIFEST."""
        said = {
            "bundle": self.name,
            "version": self.version,
            "python": self.python,
            "images": list(self.images),
            "wheels": list(self.wheels),
            "files": dict(sorted(self.files.items())),
        }
        return json.dumps(said, indent=1) + "\n"


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle whose archive agrees with its manifest; its signature is not checked here."""

    manifest: Manifest
    key_name: bytes
    signature: bytes
    archive: bytes

    @property
    def is_signed(self) -> bool:
        """Tell whether the bundle carries a signature, right or wrong."""
        return any(self.key_name)

    @property
    def content(self) -> bytes:
        """Return the bytes of the whole bundle."""
        return HEAD.pack(MAGIC, self.key_name, self.signature) + self.archive

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the whole bundle, hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()


def this_python() -> str:
    """Return major and minor of the Python that runs: "3.11"."""
    return f"{sys.version_info.major}.{sys.version_info.minor}"


def pack(
    name: str, version: int, images: tuple[str, ...], files: Mapping[str, bytes], wheels: tuple[str, ...] = ()
) -> Bundle:
    """Make a bundle that is not signed; raises BundleError where `unpack` would refuse it.

    images: `package.module:Class`, whose modules must be among the files.
    files: the content of each file, by its path with "/" between folders.
    """
    digests = {path: _sha256(content) for path, content in sorted(files.items())}
    manifest = Manifest(name, version, this_python(), tuple(sorted(images)), tuple(sorted(wheels)), digests)
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for path, content in [(MANIFEST, manifest.to_json().encode()), *sorted(files.items())]:
            member = zipfile.ZipInfo(path, _NEVER)
            member.create_system, member.external_attr = _UNIX, (stat.S_IFREG | 0o644) << 16
            archive.writestr(member, content, zipfile.ZIP_DEFLATED, 9)
    return unpack(HEAD.pack(MAGIC, bytes(KEY_NAME_BYTES), bytes(SIGNATURE_BYTES)) + stream.getvalue())


def unpack(content: bytes) -> Bundle:
    """Read a bundle and check everything but its signature; raises BundleError."""
    if len(content) > MOST_BYTES:
        raise LargeBundleError(f"it has {len(content)} bytes, and a bundle has at most {MOST_BYTES}: leave files out")
    if len(content) < HEAD.size or not content.startswith(MAGIC):
        raise BundleError("it is no bundle: make one with 'heronry bundle build'")
    _, key_name, signature = HEAD.unpack_from(content)
    return Bundle(_read_archive(content[HEAD.size :]), key_name, signature, content[HEAD.size :])


def _read_archive(content: bytes) -> Manifest:
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            members = archive.infolist()
            _check_members(members)
            read = {member.filename: archive.read(member) for member in members}
    except BundleError:
        raise
    except Exception as error:  # zipfile raises many kinds for bytes that are no archive
        raise BundleError(f"its archive is damaged ({on_one_line(str(error))}): {_AGAIN}") from error
    manifest = _read_manifest(read.pop(MANIFEST))
    if manifest.files.keys() != read.keys():
        odd = min(manifest.files.keys() ^ read.keys())
        raise BundleError(f"its manifest and its archive do not name the same files ('{odd}'): {_AGAIN}")
    for path, data in read.items():
        if _sha256(data) != manifest.files[path]:
            raise BundleError(f"its file '{path}' is not the one of which its manifest has the digest: {_AGAIN}")
    for image in manifest.images:
        module = image.partition(":")[0].replace(".", "/")
        if f"{module}.py" not in read and f"{module}/__init__.py" not in read:
            raise BundleError(f"it names the image {image} and has no {module}.py: build it from the folder above it")
    return manifest


def _check_members(members: list[zipfile.ZipInfo]) -> None:
    """Check names, kinds and sizes before a member is read; raises BundleError."""
    if not members or members[0].filename != MANIFEST:
        raise BundleError("it has no manifest: make it with 'heronry bundle build'")
    names = [member.filename for member in members]
    if len({name.casefold() for name in names}) < len(names):
        raise BundleError(f"its archive has two files of one name: {_AGAIN}")
    for member in members:
        check_path(member.orig_filename)
        kind = stat.S_IFMT(member.external_attr >> 16)
        if kind == stat.S_IFLNK:
            raise BundleError(f"its file '{member.filename}' is a symbolic link: put the file itself in its place")
        if kind not in (0, stat.S_IFREG) or member.is_dir():
            raise BundleError(f"its file '{member.filename}' is not an ordinary file: leave it out")
    if sum(member.file_size for member in members) > MOST_UNPACKED:
        raise LargeBundleError(f"its files have more than {MOST_UNPACKED} bytes together: leave files out")


def check_path(path: str) -> None:
    """Raise BundleError for the path of a file that would not lie inside of the folder of its bundle."""
    parts = path.split("/")
    if "\\" in path or "\0" in path or ":" in parts[0] or any(part in ("", ".", "..") for part in parts):
        raise BundleError(f"its file '{path}' would lie outside of its folder: {_AGAIN}")


def _read_manifest(data: bytes) -> Manifest:
    try:
        said = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise BundleError(f"its manifest is not JSON: {_AGAIN}") from error
    wanted = {"bundle", "version", "python", "images", "wheels", "files"}
    if not isinstance(said, dict) or said.keys() != wanted:
        raise BundleError(f"its manifest has other keys than {', '.join(sorted(wanted))}: {_AGAIN}")
    manifest = Manifest(
        _text(said["bundle"], _NAME, "bundle"),
        _version(said["version"]),
        _text(said["python"], _PYTHON, "python"),
        tuple(_text(one, _IMAGE, "images") for one in _list(said["images"])),
        tuple(_text(one, re.compile(r"[ -~]{1,200}"), "wheels") for one in _list(said["wheels"])),
        {path: _text(digest, re.compile("[0-9a-f]{64}"), path) for path, digest in _mapping(said["files"]).items()},
    )
    if not manifest.images:
        raise BundleError("its manifest names no image: name one with 'heronry bundle build --image'")
    return manifest


def _text(value: Any, pattern: re.Pattern[str], what: str) -> str:
    if not isinstance(value, str) or pattern.fullmatch(value) is None:
        raise BundleError(f"its manifest says {what}: {json.dumps(value)[:80]}, which heronry cannot read")
    return value


def _version(value: Any) -> int:
    if type(value) is not int or not 1 <= value <= MOST_VERSION:
        raise BundleError(f"its version {json.dumps(value)[:40]} is not a number from 1 to {MOST_VERSION}")
    return value


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise BundleError(f"its manifest has no list where one belongs: {_AGAIN}")
    return value


def _mapping(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise BundleError(f"its manifest has no list of files: {_AGAIN}")
    return value


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
