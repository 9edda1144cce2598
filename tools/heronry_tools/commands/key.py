"""`heronry key`: the key with which manager and PEs authenticate their frames, and the key that signs code."""

import argparse
import json

from heronry_wire.key_file import make_key, read_key


def run(arguments: argparse.Namespace) -> int:
    """Make a key, or print the fingerprint of one; returns the exit code."""
    if arguments.signing:
        return _make_signing_key(arguments)
    key = read_key(arguments.file) if arguments.check else make_key(arguments.file)
    told = {"file": str(arguments.file), "fingerprint": key.fingerprint}
    print(json.dumps(told) if arguments.json else f"{arguments.file}: key {key.fingerprint}")
    return 0


def _make_signing_key(arguments: argparse.Namespace) -> int:
    from heronry_wire.bundle_signing import make_signing_key  # noqa: PLC0415 - needs an extra, which the fleet's key does not

    name = make_signing_key(arguments.file)
    public = f"{arguments.file}.pub"
    told = {"file": str(arguments.file), "public": public, "name": name}
    print(json.dumps(told) if arguments.json else f"{arguments.file}: signing key {name}; its public half is {public}")
    return 0
