"""All that watches a run, behind one look-up by identifier."""

from collections.abc import Callable
from functools import partial

from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_tools.simulator.bus import Clash, Sent
from heronry_tools.simulator.check_blame import BlameCheck
from heronry_tools.simulator.check_configurations import ConfigurationCheck
from heronry_tools.simulator.check_end_state import Seen, end_state
from heronry_tools.simulator.check_epochs import EpochCheck
from heronry_tools.simulator.check_exclusion import ExclusionCheck
from heronry_tools.simulator.check_freshness import FreshnessCheck
from heronry_tools.simulator.check_load import LoadCheck
from heronry_tools.simulator.nodes import Driven
from heronry_tools.simulator.stranger import STRANGER
from heronry_tools.simulator.violation import Violation
from heronry_tools.witness import Witness
from heronry_wire.frame import Malformed
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
from heronry_wire.management import StatePage0, decode_command


class Checks:
    """The checkers of one run."""

    def __init__(self, spec: Spec) -> None:
        """Watch runs of this spec."""
        self._spec = spec
        demux_of = {branch: demux.name for demux in spec.demuxes.values() for branch in demux.branches}
        self.phase = spec.initial_phase()  # the mission's, as the manager tells it
        self._exclusion = ExclusionCheck(demux_of)
        self._epochs = EpochCheck(spec)
        self._blame = BlameCheck(spec)
        self._configurations = ConfigurationCheck(spec)
        self._freshness = FreshnessCheck(spec, self._configurations.commanded)
        self._load = LoadCheck(spec)
        self.witness = Witness(spec)
        self._node_of_state = {state_id(node): node for node in PE_NODES}
        self._last_commands: dict[int, bytes] = {}
        self._watchers: dict[int, Callable[[Sent], object]] = dict.fromkeys(
            (*STANDARD_DATA_IDS, *ALLOCATED_DATA_IDS), self._datum
        )
        self._watchers |= dict.fromkeys(self._node_of_state, self._state)
        self._watchers |= dict.fromkeys(map(emcy_id, PE_NODES), self._blame.emergency)
        self._watchers |= dict.fromkeys(map(actuator_echo_id, PE_NODES), self._echo)
        for manager in MANAGER_NODES:
            for command in (Command.LEASE, Command.PREPARE, Command.SLICE, Command.ACTIVATE, Command.CONTROL):
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
        self._freshness.driven(driven)

    def broken(self, truth: Situation, clashes: list[Clash]) -> list[Violation]:
        """Give what must never have been, so far; `clashes` are the buses' own."""
        stories = [
            Violation(c.t_ns, "clash", f"{' and '.join(c.stations)} both wanted to send {c.can_id} on {c.bus}")
            for c in clashes
            if not any(station.startswith(STRANGER) for station in c.stations)
        ]
        blamed = self._blame.violations(truth)
        checks = (self._exclusion, self._epochs, self._configurations, self._freshness, self._load)
        found = [violation for check in checks for violation in check.violations]
        return sorted([*found, *blamed, *stories])

    def unsettled(self, truth: Situation, now_ns: int) -> list[Violation]:
        """Give what must not be once a run has settled."""
        seen = Seen(self._epochs.last, self.witness, self._configurations.commanded.current)
        return end_state(self._spec, truth, now_ns, seen)

    def _datum(self, sent: Sent) -> None:
        self._exclusion.published(sent)
        self._freshness.published(sent)
        self._load.published(sent)

    def _state(self, sent: Sent) -> None:
        page = self._epochs.state(sent)
        if page is None or sent.bus != self._spec.manager.bus:
            return
        node = self._node_of_state[sent.frame.can_id]
        if isinstance(page, StatePage0):
            self._freshness.state(node, sent.end_ns, page)
        else:
            self._configurations.staged(node, page)

    def _commanded(self, command: Command, sent: Sent) -> None:
        identifier, data = sent.frame.can_id, sent.frame.data
        if sent.bus != self._spec.manager.bus or self._last_commands.get(identifier) == data:
            return
        if command is Command.LEASE:
            self._last_commands[identifier] = data
        message = decode_command(command, data)
        self._exclusion.commanded(message)
        if not isinstance(message, Malformed):
            self._configurations.heard(sent.end_ns, message, self.phase)

    def _echo(self, sent: Sent) -> None:
        if sent.bus == self._spec.manager.bus:
            self.witness.see(sent.end_ns, sent.frame)
