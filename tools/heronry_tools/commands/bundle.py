"""`heronry bundle`: the code of images as one signed file, for PEs that take code over the bus."""

import argparse
import json
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from heronry_tools.console.errors import UserError
from heronry_tools.console.manager_calls import unlock_pe
from heronry_tools.console.progress import Working
from heronry_tools.console.whole_file import expect_writable, write_whole
from heronry_tools.runtime.bundle_files import read_bundle
from heronry_wire.authentication import KEY_BYTES
from heronry_wire.bundle import MOST_UNPACKED, Bundle, BundleError, pack
from heronry_wire.bundle_keys import SECRET
from heronry_wire.bundle_needs import read_wheel
from heronry_wire.bundle_signing import check_signature, read_public_key, sign
from heronry_wire.bus_arguments import flagged_bus
from heronry_wire.ordinary_file import read_ordinary

_LEFT_OUT = ("__pycache__", ".git")
_KEY = re.compile(rf"{SECRET}\b|[0-9a-f]{{{2 * KEY_BYTES}}}\s*\Z".encode())  # one that signs code, or the fleet's


def run_build(arguments: argparse.Namespace) -> int:
    """Make a bundle from the files of a folder; returns the exit code."""
    expect_writable(arguments.file)
    for wheel in arguments.wheel:
        read_wheel(wheel)
    if not arguments.folder.is_dir():
        raise UserError(f"{arguments.folder} is no folder: name the folder that holds your modules")
    files = dict(_files(arguments.folder, arguments.file.resolve()))
    try:
        bundle = pack(arguments.name, arguments.version, tuple(arguments.image), files, tuple(arguments.wheel))
    except BundleError as error:
        raise UserError(f"{arguments.folder} makes no bundle: {error}") from error
    write_whole(arguments.file, bundle.content)
    _say(arguments, bundle, "built, not signed yet")
    return 0


def run_sign(arguments: argparse.Namespace) -> int:
    """Sign a bundle in its place; returns the exit code."""
    bundle = sign(read_bundle(arguments.file), arguments.key)
    write_whole(arguments.file, bundle.content)
    _say(arguments, bundle, f"signed with key {bundle.key_name.hex()}")
    return 0


def run_inspect(arguments: argparse.Namespace) -> int:
    """Tell what is in a bundle; with a public key, check its signature. Returns the exit code."""
    bundle = read_bundle(arguments.file)
    if arguments.key is not None:
        try:
            check_signature(bundle, read_public_key(arguments.key))
        except BundleError as error:
            raise UserError(f"{arguments.file}: {error}") from error
    state = f"signed with key {bundle.key_name.hex()}" if bundle.is_signed else "not signed"
    _say(arguments, bundle, f"{state}{', which is right' if arguments.key else ''}")
    if not arguments.json:
        manifest = bundle.manifest
        print("images:", ", ".join(manifest.images))
        print("needs: ", ", ".join((f"Python {manifest.python}", *manifest.wheels)))
        print("files: ", ", ".join(sorted(manifest.files)))
    return 0


def run_send(arguments: argparse.Namespace) -> int:
    """Bring a bundle to a PE and start it; returns the exit code."""
    from heronry_tools.console.spec_files import expect_pe, load_spec  # noqa: PLC0415 - the others need no spec
    from heronry_tools.runtime import bundle_sending  # noqa: PLC0415

    bundle, spec = read_bundle(arguments.file), load_spec(arguments.spec)
    expect_pe(spec, arguments.pe)
    pe = spec.pes[arguments.pe]
    size = len(bundle.content)
    if size > pe.flash:
        raise UserError(f"{arguments.file} has {size} bytes, and {pe.name} {pe.flash} bytes of flash: leave files out")
    flags = {name: value for name, value in flagged_bus(arguments).items() if value is not None}
    unlock = None
    if arguments.unlock or arguments.socket is not None:
        unlock = partial(unlock_pe, arguments.socket, spec.name, pe.name)
    with Working(f"bringing {arguments.file} to {pe.name}"):
        took_s = bundle_sending.send(
            flags,
            pe.node_id,
            bundle,
            bitrate=bundle_sending.slowest_bitrate(spec, pe.name),
            unlock=unlock,
            start=not arguments.no_start,
        )
    _say(arguments, bundle, f"is on {pe.name}, node {pe.node_id}, after {took_s:.1f} s")
    return 0


def _files(folder: Path, result: Path) -> Iterator[tuple[str, bytes]]:
    """Yield path and content of each file of a folder; compiled files and the bundle itself are left out."""
    left = MOST_UNPACKED
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if any(part in _LEFT_OUT for part in path.parts) or path.resolve() == result:
            continue
        if path.is_symlink():
            raise UserError(f"{path} is a symbolic link, which a bundle cannot hold: put the file itself in its place")
        if path.is_dir():
            continue
        try:
            content = read_ordinary(path, left + 1)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}; leave it out of the folder") from error
        if _KEY.match(content):
            raise UserError(f"{path} holds a secret key, which no bundle may carry: keep it out of the folder")
        left -= len(content)
        if left < 0:
            raise UserError(f"{folder} has more than {MOST_UNPACKED} bytes in its files: leave files out")
        yield name, content


def _say(arguments: argparse.Namespace, bundle: Bundle, state: str) -> None:
    manifest = bundle.manifest
    if arguments.json:
        told: dict[str, Any] = {
            **json.loads(manifest.to_json()),
            "file": str(arguments.file),
            "bytes": len(bundle.content),
            "sha256": bundle.digest,
            "key": bundle.key_name.hex() if bundle.is_signed else None,
        }
        print(json.dumps(told))
    else:
        print(f"{arguments.file}: {manifest.name}, version {manifest.version}, {len(bundle.content)} bytes, {state}")
