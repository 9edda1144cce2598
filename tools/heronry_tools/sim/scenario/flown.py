"""The result of a flight of a script, in the simulator or with real processes."""

from dataclasses import dataclass

from heronry_tools.sim.scenario.evaluation import Verdict
from heronry_tools.sim.scenario.script import Script


@dataclass(frozen=True, slots=True)
class Flown:
    """The result of one flight: verdicts on expectations, violations, the decision trace."""

    script: Script
    where: str  # in the simulator, or on which bus
    seconds: float  # how long the script lasts
    verdicts: tuple[Verdict, ...]  # one for each expectation
    violations: tuple[str, ...]  # one sentence for each
    trace: tuple[str, ...]  # the lines of the decision trace
    differences: tuple[str, ...] | None = None  # from the golden trace; None: not compared with a golden trace
    digest: str = ""  # of all frames, in the simulator

    @property
    def holds(self) -> bool:
        """Tell whether every expectation holds, no requirement is violated, and the trace equals the golden one."""
        return not (self.violations or self.differences) and all(verdict.holds for verdict in self.verdicts)
