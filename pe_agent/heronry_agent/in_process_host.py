"""The module host of a node that runs its modules in the agent's own process (`pe-agent --in-process`).

For computers that have many agents and few cores, as in the demo: a step costs no message to another process and back,
which is half of the CPU. The price: a module that hangs silences its PE, which is then declared down; one that ends the
process ends the agent. An overrun is still noticed, when the step has ended.
"""

import time
from collections.abc import Collection

from heronry_agent.host import ModuleHost
from heronry_agent.vocabulary import Action, ModuleEvent, Stepped
from heronry_wire.sansio import NEVER_NS


class InProcessHost(ModuleHost):
    """Serves a driver as `PartitionHost` does."""

    def readers(self) -> list[object]:
        """Nothing to select on: every answer is there at once."""
        return []

    def next_deadline_ns(self) -> int:
        """It waits for nothing."""
        return NEVER_NS

    def carry_out(self, action: Action, now_ns: int) -> ModuleEvent | None:
        """Do what an action asks; a step says what it has spent."""
        began_ns = time.thread_time_ns()
        answer = super().carry_out(action, now_ns)
        if isinstance(answer, Stepped):
            return answer._replace(spent_ns=time.thread_time_ns() - began_ns)
        return answer

    def flush(self, now_ns: int) -> None:
        """Everything is done at once."""

    def take(self, ready: Collection[object], now_ns: int) -> list[ModuleEvent]:  # noqa: ARG002 - as PartitionHost has it
        """Nothing comes by itself."""
        return []

    def abandon(self) -> None:
        """End all modules; nobody is told."""
        for module in self._partitions:
            self._runner.stop(module)

    def close(self) -> None:
        """End everything."""
        self.abandon()
