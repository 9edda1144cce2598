"""The deadlines of the parts of an agent, and the order in which the parts are called when several are due."""

from dataclasses import dataclass

from heronry_agent.core.canopen import CanopenNode
from heronry_agent.core.condition import StateReports
from heronry_agent.core.configuration import Staging
from heronry_agent.core.modules import RunningModules, WithoutManager
from heronry_agent.core.reports import ChannelReports
from heronry_agent.core.turn import Turn


@dataclass
class Deadlines:
    """Calls each part of one PE's agent, except the radios, when the next deadline of that part is due.

    start_notes: lines to log when the PE boots up.
    """

    turn: Turn
    staging: Staging
    without_manager: WithoutManager
    canopen: CanopenNode
    state_reports: StateReports
    modules: RunningModules
    channels: ChannelReports
    start_notes: tuple[str, ...]

    def next_ns(self) -> int:
        """Time in ns at which the first of the agent's parts is due, if no event comes before."""
        due_ns = min(self.state_reports.reporting.next_ns, self.modules.next_ns)
        due_ns = min(due_ns, self.modules.faults.next_ns)
        due_ns = min(due_ns, self.staging.ask_ns)
        due_ns = min(due_ns, self.canopen.next_ns)
        due_ns = min(due_ns, self.without_manager.next_ns)
        due_ns = min(due_ns, self.modules.checkpoints.next_ns)
        return min(due_ns, self.channels.next_ns)

    def tick(self) -> None:
        """Call every part that is due now, but step no module: `AgentCore` steps the due modules after each event."""
        turn = self.turn
        now_ns = turn.now_ns
        if self.staging.tick(now_ns):
            turn.wants_page_1 = True
        if now_ns >= self.without_manager.next_ns:
            self.without_manager.tick()
        if now_ns >= self.canopen.next_ns:
            if not self.canopen.booted:
                for text in self.start_notes:
                    turn.note("start", text)
                self.modules.lack(self.staging.reader.missing_images)
            self.canopen.tick()
        if now_ns >= self.state_reports.reporting.next_ns:
            self.state_reports.tick()
        if now_ns >= self.modules.faults.next_ns:
            self.modules.repeat_faults()
        if now_ns >= self.modules.checkpoints.next_ns:
            self.modules.checkpoints.tick()
        if now_ns >= self.channels.next_ns:
            self.channels.tick()
