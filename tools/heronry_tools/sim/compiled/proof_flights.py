"""Flights of every shipped spec, with faults, which must give equal frames in Python and in the compiled form.

Running this module prints one line per flight: spec, seed, number of frames, their digest, the violations. The seeds
together draw faults of every kind, buses that lose frames, two managers, and a key.
"""

from collections.abc import Iterator
from itertools import product
from pathlib import Path

from heronry_dg.loader import load
from heronry_dg.shipped import example_specs, shipped_spec_names, shipped_spec_path
from heronry_tools.sim.faults.drawing import drawn_faults
from heronry_tools.sim.flight.outcome import Scenario, play

_SECONDS = 2.0
_LOSS = 0.001


def main() -> None:
    """Simulate a fixed list of flights, and print a line with the digest of all frames for each."""
    for file, seeds, kinds in _flights():
        spec = load(file)
        for seed, of_two in product(range(seeds), (False, True)):
            faults = drawn_faults(spec, seed, _SECONDS, kinds, of_two=of_two, keyed=of_two)
            loss = _LOSS if seed % 2 else 0.0
            scenario = Scenario(seed, _SECONDS, faults, loss, drawn=True, keyed=of_two, standby=of_two)
            outcome = play(spec, scenario)
            print(spec.name, seed, *kinds, outcome.frames, outcome.digest, *outcome.violations)


def _flights() -> Iterator[tuple[Path, int, tuple[str, ...]]]:
    """Yield for each spec how many seeds are flown, and the kinds of faults; no kinds: a seed draws them, too."""
    for name in shipped_spec_names():
        yield shipped_spec_path(name), 4, ()
    for file in example_specs():
        yield file, 1, ()
    yield shipped_spec_path("elevator_and_chute"), 2, ("blank",)


if __name__ == "__main__":
    main()
