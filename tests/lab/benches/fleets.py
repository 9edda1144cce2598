"""An aircraft of real processes on software buses, as the benchmarks fly it."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from heronry_dg.model import Spec
from heronry_manager.contingency.contingencies import Contingencies
from heronry_tools.console.spec_files import load_spec, spec_path
from heronry_tools.runtime.demo.buses import BusChoice, choose
from heronry_tools.runtime.demo.fleet import Fleet, run_folder


@dataclass(frozen=True, slots=True)
class Aircraft:
    """The spec and the processes of an aircraft whose buses run."""

    spec: Spec
    fleet: Fleet
    buses: dict[str, BusChoice]

    @property
    def main(self) -> BusChoice:
        """Return the manager's bus."""
        return self.buses[self.spec.manager.bus]

    def start_pes(self) -> dict[str, int]:
        """Start every PE; gives their process numbers."""
        return {pe: self.fleet.start_pe(pe) for pe in self.spec.pes}


@contextmanager
def aircraft(spec_name: str, made: Contingencies | None = None, key: Path | None = None) -> Iterator[Aircraft]:
    """Yield an aircraft without manager and PEs; all its processes end with the block.

    key: the file of the key that all nodes have; None: they have none.
    """
    spec, folder = load_spec(spec_name), run_folder()
    with Fleet(spec, spec_path(spec_name), folder, made, key) as fleet:
        buses = dict(choose(spec, folder, {}, None, prefer_vcan=False))
        fleet.start_buses(buses)
        yield Aircraft(spec, fleet, buses)
