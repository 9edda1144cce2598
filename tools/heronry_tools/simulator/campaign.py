"""Many flights: in parallel, in the order of their seeds, and what they have reached all together.

Hours alone say little. What counts is which faults have struck in which state of the protocol (`coverage_table`): a
cell that was never hit was never tried.

Processes share nothing: each loads the spec once, and keeps the plans it has made for the flights that follow.
"""

import os
import signal
from collections import Counter
from collections.abc import Iterable, Iterator
from multiprocessing import get_context
from pathlib import Path

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_tools.simulator.act import KINDS
from heronry_tools.simulator.protocol_state import STATES
from heronry_tools.simulator.scenario import Outcome, Scenario, play

_POLITENESS = 10
_SPECS: list[Spec] = []  # the one of a worker process


def fly_all(spec_file: Path, scenarios: Iterable[Scenario], jobs: int) -> Iterator[Outcome]:
    """Fly scenarios on that many processors; what is not waited for any more is stopped."""
    if jobs == 1:
        spec = load(spec_file)
        yield from (play(spec, scenario) for scenario in scenarios)
        return
    with get_context("spawn").Pool(jobs, _begin, (spec_file,)) as pool:
        yield from pool.imap(_fly, scenarios)


def coverage_table(hits: Counter[tuple[str, str]]) -> list[str]:
    """Lines of a table: kinds of faults by the state of the protocol in which they struck."""
    kinds = [kind for kind in KINDS if any(hits[kind, state] for state in STATES)]
    lines = [f"{'strikes in state':16}" + "".join(f"{state:>11}" for state in STATES)]
    lines += [f"{kind:16}" + "".join(f"{hits[kind, state]:11}" for state in STATES) for kind in kinds]
    return lines if kinds else []


def _begin(spec_file: Path) -> None:
    """Start a worker: it is stopped by its parent and not by the keyboard, and stands back."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(_POLITENESS)
    _SPECS.append(load(spec_file))


def _fly(scenario: Scenario) -> Outcome:
    return play(_SPECS[0], scenario)
