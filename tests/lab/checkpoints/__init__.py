"""Kills of a computer with an integrating controller: how its output jumps, with a checkpoint and without.

`kills` flies in the simulator, `live` on processes; both fly `loop.dg.yaml`.
"""

from dataclasses import replace
from pathlib import Path

from heronry_dg.loader import load
from heronry_dg.meaning import with_digest
from heronry_dg.model import Spec

LOOP = Path(__file__).with_name("loop.dg.yaml")
MOST_JUMP = 0.01
"""Largest jump of the output after a move with a checkpoint, as a share of its range."""


def loop(*, kept: bool) -> Spec:
    """Return the spec of the loop, with or without the checkpoint."""
    spec = load(LOOP)
    if kept:
        return spec
    modules = {name: replace(module, checkpoint=None) for name, module in spec.modules.items()}
    return with_digest(replace(spec, modules=modules))
