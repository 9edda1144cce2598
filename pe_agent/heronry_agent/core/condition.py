"""What the state frames of a PE report, and which of these frames are sent immediately and not at the next period.

`Condition` reads the facts from the parts on demand. It also logs changes that no command caused: whether a manager is
heard, and whether exclusive outputs are authorized or held back.

`StateReports` sends the frames: periodically (`reporting`), and immediately where a part has requested a page. With a
key a page 0 also follows every EMCY immediately, since the tag of the page authenticates the EMCY.
"""

from dataclasses import dataclass

from heronry_agent.core.authority import Authenticity, FollowedManager, OutputAuthorization
from heronry_agent.core.configuration import ActiveConfiguration, Staging
from heronry_agent.core.modules import RunningModules
from heronry_agent.core.reports import Facts, Reporting
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_wire.management import NO_EPOCH, Step
from heronry_wire.sansio import Send
from heronry_wire.state_frames import PeFlags, PeState


@dataclass
class Condition:
    """Collects the content of one PE's state frames from the parts of its agent."""

    turn: Turn
    index: TableIndex
    followed_manager: FollowedManager
    output_authorization: OutputAuthorization
    staging: Staging
    active_configuration: ActiveConfiguration
    modules: RunningModules
    _hears_lease: bool = False  # as last logged
    _is_held: bool = False  # exclusive outputs, as last logged
    _reached: tuple[PeState, int, int] = (PeState.UNCONFIGURED, NO_EPOCH, 0)  # with all devices at rest

    def facts(self) -> Facts:
        """Return the present content of the state frames, and log what has changed since the last call.

        `facts` logs only changes that no command causes: whether a manager is heard, and whether exclusive outputs are
        authorized. While the device of a stopped branch still moves, the configuration before is reported (`rests`).
        """
        now_ns = self.turn.now_ns
        hears_lease = self.followed_manager.hears_lease(now_ns)
        held = self.modules.has_exclusive_output and not self.output_authorization.allows(now_ns)
        self._note_changes(hears_lease, held)
        flags = PeFlags.HEARS_LEASE if hears_lease else PeFlags(0)
        if self.modules.faults.pending:
            flags |= PeFlags.FAULT_PENDING
        if held:
            flags |= PeFlags.OUTPUT_HELD
        running = self.active_configuration.running
        if not self.modules.rests.are_due:
            self._reached = self.active_configuration.state, running.epoch, running.digest
        state, epoch, digest = self._reached
        return Facts(
            state,
            flags,
            epoch,
            digest,
            *self.staging.told,
            self.staging.reason,
            self.modules.load_percent,
        )

    def _note_changes(self, hears_lease: bool, is_held: bool) -> None:
        if hears_lease != self._hears_lease:
            self._hears_lease = hears_lease
            stops = (
                "expendable modules stop" if self.index.table.without_manager == "safe_mode" else "all modules go on"
            )
            self.turn.note("lease", "a manager is heard" if hears_lease else f"no manager is heard; {stops}")
        if is_held != self._is_held:
            self._is_held = is_held
            self.turn.note(
                "output", "exclusive outputs are held back" if is_held else "exclusive outputs are authorized"
            )


@dataclass
class StateReports:
    """Sends the state frames of one PE."""

    turn: Turn
    condition: Condition
    reporting: Reporting
    modules: RunningModules
    authenticity: Authenticity | None
    _proven_changes: int = 0  # value of `Faults.changes` at the last page 0

    def tick(self) -> None:
        """Send the state frames that are due once in a heartbeat period, and before them a report of a silence."""
        self.turn.do(*self._silences(), *self.reporting.tick(self.turn.now_ns, self.condition.facts()))
        if self.authenticity is not None:
            self.authenticity.beat()

    def _silences(self) -> list[Send]:
        condition, now_ns = self.condition, self.turn.now_ns
        active, followed = condition.active_configuration, condition.followed_manager
        is_steady = active.step is Step.GO_ALL and followed.hears_lease(now_ns)
        frames = self.modules.silences.look(active.live, now_ns, is_steady=is_steady)
        return [Send(condition.index.uplink, frame) for frame in frames]

    def immediate(self) -> None:
        """Send the state pages that parts of the agent have requested in this call of the core."""
        turn = self.turn
        if self.authenticity is not None and self.modules.faults.changes != self._proven_changes:
            self._proven_changes = self.modules.faults.changes
            turn.wants_page_0 = True
        if turn.wants_page_0 or turn.wants_page_1:
            facts = self.condition.facts()
            turn.do(*self.reporting.immediate(facts, page_0=turn.wants_page_0, page_1=turn.wants_page_1))
