"""Another spec to which the aircraft may change in flight, with what a manager needs for it; kept for the process."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

from heronry_dg.loader import load
from heronry_dg.model import Spec
from heronry_manager.shell.other_spec import OtherSpec
from heronry_tools.sim.world.planning import Prepared, prepared


@dataclass(frozen=True)
class NextSpec:
    """Another spec; of its plans none is made ahead."""

    other: OtherSpec
    ahead: Prepared

    @property
    def spec(self) -> Spec:
        """Return the spec."""
        return self.other.spec


@cache
def next_spec(file: Path) -> NextSpec:
    """Read the spec in a file; raises SpecError, and WireLimitError if it exceeds a limit of the wire."""
    spec = load(file)
    return NextSpec(OtherSpec(spec), prepared(spec, None))


def why_not(present: Spec, following: NextSpec) -> str | None:
    """Return why the aircraft cannot change to another spec in flight, or not in the simulator; None: it can."""
    if present.pes.keys() != following.spec.pes.keys():
        names = ", ".join(sorted(f"pe:{pe}" for pe in present.pes.keys() ^ following.spec.pes.keys()))
        return f"the simulator changes only between specs with the same PEs; only one of these two has {names}"
    order = following.other.order(present)
    return order if isinstance(order, str) else None
