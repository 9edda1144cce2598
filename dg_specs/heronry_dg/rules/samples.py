"""Sections and lines for the examples of rules, which fit the small correct spec of check/examples.py."""

from typing import Final

RUNS: Final = "cpu: 0.1, ram: 1KiB, rate_hz: 10"  # the fields that every mode must have
DRIVER: Final = f"  driver: {{device: gps, gives: {{speed: 1}}, {RUNS}}}\n"
DISPLAY: Final = f"  display: {{device: lamp, needs: speed, {RUNS}}}\n"


def pes(
    nav: str = "node_id: 92, buses: [can0]", tail: str = "node_id: 93, buses: [can0]", *, nav_ram: str = "64KiB"
) -> str:
    """Give the section `pes`: two PEs with these fields, and otherwise enough capacity."""
    return (
        f"pes:\n  nav: {{{nav}, cpu: 1, ram: {nav_ram}, flash: 64KiB}}\n"
        f"  tail: {{{tail}, cpu: 1, ram: 64KiB, flash: 64KiB}}\n"
    )
