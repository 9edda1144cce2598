"""Kills of a computer whose module has a state: what follows, with a checkpoint and without.

`kills` and `live` fly `loop.dg.yaml`, in the simulator and on processes, and see how the output of an integrating
controller jumps. `landings` flies the EAV, and sees whether it lands.
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
    """Return the spec of the loop, with or without its checkpoints."""
    spec = load(LOOP)
    return spec if kept else without_checkpoints(spec)


def without_checkpoints(spec: Spec) -> Spec:
    """Return a spec whose modules take no state along."""
    modules = {name: replace(module, checkpoint=None) for name, module in spec.modules.items()}
    return with_digest(replace(spec, modules=modules))
