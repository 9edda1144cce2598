"""DG253: a rule of the family DG2 (graph.py) about modules that fail when they fall silent."""

from heronry_dg.rules.graph import FAMILY
from heronry_dg.rules.samples import DISPLAY, DRIVER, RUNS

FAILS_ALONE = FAMILY.echo(
    "DG253",
    "fails-alone",
    what="A module with `silent: fails` has one possible PE, and a function is impossible without the module.",
    why="When the module leaves out an output, it fails until the operator clears it, and nothing takes its place. "
    "With `silent: told` it goes on, and may give data again.",
    fix="Leave `silent` out, or give another module or another PE that can take over.",
    bad=f"modules:\n  driver: {{device: gps, gives: {{speed: 1}}, silent: fails, {RUNS}}}\n{DISPLAY}",
    good=f"modules:\n{DRIVER}{DISPLAY}",
)
