"""All that watches a run, behind one look-up by identifier."""

from collections.abc import Callable
from functools import partial

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.simulator.bus import Clash, Sent
from heronry_tools.simulator.check_blame import BlameCheck
from heronry_tools.simulator.check_end_state import end_state
from heronry_tools.simulator.check_epochs import EpochCheck
from heronry_tools.simulator.check_exclusion import ExclusionCheck
from heronry_tools.simulator.nodes import Driven
from heronry_tools.simulator.stranger import STRANGER
from heronry_tools.simulator.violation import Violation
from heronry_tools.witness import Witness
from heronry_wire.identifiers import (
    ALLOCATED_DATA_IDS,
    MANAGER_NODES,
    PE_NODES,
    STANDARD_DATA_IDS,
    Command,
    actuator_echo_id,
    emcy_id,
    management_id,
    state_id,
)
from heronry_wire.management import decode_command


class Checks:
    """The checkers of one run."""

    def __init__(self, spec: Spec) -> None:
        """Watch runs of this spec."""
        self._spec = spec
        demux_of = {branch: demux.name for demux in spec.demuxes.values() for branch in demux.branches}
        self._exclusion = ExclusionCheck(demux_of)
        self._epochs = EpochCheck()
        self._blame = BlameCheck(spec)
        self.witness = Witness(spec)
        self._watchers: dict[int, Callable[[Sent], object]] = dict.fromkeys(
            (*STANDARD_DATA_IDS, *ALLOCATED_DATA_IDS), self._exclusion.published
        )
        self._watchers |= dict.fromkeys(map(state_id, PE_NODES), self._epochs.state)
        self._watchers |= dict.fromkeys(map(emcy_id, PE_NODES), self._blame.emergency)
        self._watchers |= dict.fromkeys(map(actuator_echo_id, PE_NODES), self._echo)
        for manager in MANAGER_NODES:
            for command in (Command.LEASE, Command.ACTIVATE):
                self._watchers[management_id(manager, command)] = partial(self._commanded, command)

    def see(self, sent: Sent) -> None:
        """Take a frame from any bus."""
        watcher = self._watchers.get(sent.frame.can_id)
        if watcher is not None and not sent.sender.startswith(STRANGER):
            watcher(sent)

    @property
    def reported(self) -> set[str]:
        """Elements that some PE has reported as failed."""
        return self._blame.reported

    def driven(self, driven: Driven) -> None:
        """A branch of a DEMUX drives it."""
        self._exclusion.driven(driven)

    def broken(self, truth: Situation, clashes: list[Clash]) -> list[Violation]:
        """Give what must never have been, so far; `clashes` are the buses' own."""
        stories = [
            Violation(c.t_ns, "clash", f"{' and '.join(c.stations)} both wanted to send {c.can_id} on {c.bus}")
            for c in clashes
            if not any(station.startswith(STRANGER) for station in c.stations)
        ]
        blamed = self._blame.violations(truth)
        return sorted([*self._exclusion.violations, *self._epochs.violations, *blamed, *stories])

    def unsettled(self, truth: Situation, now_ns: int) -> list[Violation]:
        """Give what must not be once a run has settled."""
        return end_state(self._spec, truth, now_ns, self._epochs.last, self.witness)

    def _commanded(self, command: Command, sent: Sent) -> None:
        self._exclusion.commanded(decode_command(command, sent.frame.data))

    def _echo(self, sent: Sent) -> None:
        if sent.bus == self._spec.manager.bus:
            self.witness.see(sent.end_ns, sent.frame)
