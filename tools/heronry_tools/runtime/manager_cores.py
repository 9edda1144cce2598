"""Makes the cores of one manager's process: of the spec with which it starts, and of those that follow in flight."""

import argparse
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.memory import Memory
from heronry_manager.core.settings import CodeBundle
from heronry_manager.core.tables import Compiler
from heronry_manager.planner.client import PlannerClient
from heronry_manager.planning_policy import PlanningPolicy
from heronry_manager.shell.other_spec import OtherSpec
from heronry_manager.shell.planner_processes import PlannerProcesses
from heronry_manager.shell.spec_reloads import Successor
from heronry_wire.authentication import Key

# Where all nodes share a computer, as in the demo, a manager that is late loses healthy PEs. So its planner stands back
# to the priority that the PEs have there, and pre-planning, which may wait, stands back behind them.
PLANNER_NICENESS, PRE_PLANNER_NICENESS = 5, 15


@dataclass(frozen=True)
class ManagerCores:
    """What all cores of one process have in common; `stack` ends the planners with the process."""

    arguments: argparse.Namespace
    node: int
    key: Key | None
    bundles: tuple[CodeBundle, ...]
    has_solver: bool
    stack: ExitStack

    def core(self, spec: Spec, compiler: Compiler, memory: Memory, now_ns: int, **more: Any) -> ManagerCore:
        """Make the core of a spec."""
        return ManagerCore(
            spec,
            self.node,
            memory,
            now_ns,
            advise=self.arguments.advise,
            key=self.key,
            standby=self.arguments.standby,
            tells_departures=True,
            reads_objects=True,
            bundles=self.bundles,
            compiler=compiler,
            **more,
        )

    def prepare(self, other: OtherSpec, file: Path) -> Successor:
        """Make the planners of a spec that may follow; none of its plans is made ahead. Raises PlannerError."""
        own = self.stack.enter_context(ExitStack())
        planner, pre_planner = (
            self.planner(own, other.spec, file, niceness, starts=False)
            for niceness in (PLANNER_NICENESS, PRE_PLANNER_NICENESS)
        )

        def start() -> None:
            for one in (planner, pre_planner):
                if one is not None:
                    one.start()

        def start_pre_planner() -> PlannerClient:
            assert pre_planner is not None, "there is a solver"
            return pre_planner

        def make(memory: Memory, now_ns: int) -> tuple[ManagerCore, PlannerProcesses]:
            policy = PlanningPolicy(other.spec, other.planner, has_planner=self.has_solver)
            core = self.core(other.spec, other.compiler, memory, now_ns, tables=other.contents)
            return core, PlannerProcesses(policy, planner, start_pre_planner)

        return Successor(start, make, own.close)

    def planner(
        self, stack: ExitStack, spec: Spec, file: Path, niceness: int, *, starts: bool = True
    ) -> PlannerClient | None:
        """Return a planner, which ends with `stack`; None: there is no solver. Raises PlannerError."""
        if not self.has_solver:
            return None
        return stack.enter_context(PlannerClient(spec, file, niceness=niceness, starts=starts))
