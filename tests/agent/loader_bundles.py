"""Bundles for tests of the loader: small ones of module `probe`, whose code says its version."""

from functools import cache
from pathlib import Path

from heronry_wire.bundle import Bundle, pack
from heronry_wire.bundle_signing import make_signing_key, sign

IMAGE = "probe:Probe"
CODE = b"""
from heronry_agent.module import Module

VERSION = %d


class Probe(Module):
    def step(self, inputs):
        return {}
"""


@cache
def bundle(version: int, more: int = 0) -> Bundle:
    """A bundle of this version, not signed; `more` bytes make it longer."""
    return pack("probe", version, (IMAGE,), {"probe.py": CODE % version, "more.bin": bytes(range(256)) * (more // 256)})


def signing_key(folder: Path) -> Path:
    """A new signing key; its public half is beside it, with `.pub` behind its name."""
    key = folder / "code.signing"
    make_signing_key(key)
    return key


def signed(key: Path, version: int) -> Bundle:
    """A bundle of this version that is signed with `key`."""
    return sign(bundle(version), key)
