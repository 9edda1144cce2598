"""The result of a flight of a script, in the simulator or with real processes."""

from dataclasses import dataclass

from heronry_tools.sim.scenario.evaluation import Verdict
from heronry_tools.sim.scenario.script import Script


@dataclass(frozen=True, slots=True)
class Flown:
    """Verdicts on what was expected, what must never have been and was, and what was decided."""

    script: Script
    where: str
    seconds: float
    verdicts: tuple[Verdict, ...]
    violations: tuple[str, ...]
    trace: tuple[str, ...]
    differences: tuple[str, ...] | None = None  # from the golden trace; None where there is none
    digest: str = ""  # of all frames, in the simulator

    @property
    def holds(self) -> bool:
        """Tell whether every expectation holds, nothing is broken, and the trace is as before."""
        return not (self.violations or self.differences) and all(verdict.holds for verdict in self.verdicts)
