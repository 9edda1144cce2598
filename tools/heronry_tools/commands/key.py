"""`heronry key`: the key with which manager and PEs authenticate their frames (protocol rule 11)."""

import argparse
import json

from heronry_wire.key_file import make_key, read_key


def run(arguments: argparse.Namespace) -> int:
    """Make a key, or print the fingerprint of one; returns the exit code."""
    key = read_key(arguments.file) if arguments.check else make_key(arguments.file)
    told = {"file": str(arguments.file), "fingerprint": key.fingerprint}
    print(json.dumps(told) if arguments.json else f"{arguments.file}: key {key.fingerprint}")
    return 0
