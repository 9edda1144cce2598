"""What follows in the whole core when this manager becomes active, stands by, or stops sending.

`claim` decides; this file carries the decision out for all parts of the core:

    begin a term     this manager commands from now on. A PE that is not heard may still drive its outputs for T_lease
    give way         another manager is active, and has a higher term or was active first. Forget all but the memory,
                     and follow that manager
    follow           as a standby or advising manager, take in the commands of the active manager (`following`)
    take over        the PEs report that no manager is active any more. Begin a term with what was learnt from the
                     manager that was active last. A PE is not held down if it was available to that manager, and its
                     last state is ACTIVE. This manager waits for each PE that has proven no state to it yet
                     (`health`)
    fall silent      no PE is heard, or most PEs refuse this manager. Forget all but the memory, send nothing, and
                     listen for a PE

`claim` and `following` say what lost, late, doubled and forged frames cause.
"""

from heronry_manager import events
from heronry_manager.core.epochs import Cause
from heronry_manager.core.intake.hearer import Hearer
from heronry_manager.core.mastership import Mastership
from heronry_wire.frame import Malformed
from heronry_wire.management import Lease, ManagementMessage
from heronry_wire.protocol_times import LEARNS_LEASES


class Succession(Hearer):
    """Changes all parts of the core when this manager becomes active, stands by, or stops sending."""

    # What another manager sends

    def heard(self, node: int, message: ManagementMessage | Malformed) -> None:
        """Process a command of another manager.

        As a standby or advising manager, take in the command. In any other state, decide at a LEASE whether to
        give way to the other manager. A malformed command has no effect.
        """
        if isinstance(message, Malformed):
            return
        if self._claim.state is Mastership.STANDBY:
            self._follow(node, message)
        elif self._settings.advise:
            self._learn_beside(node, message)
        elif isinstance(message, Lease):
            self._give_way(node, message)

    def _follow(self, node: int, message: ManagementMessage) -> None:
        following = self._following
        before = following.node
        self._learn(node, message)
        if before is None and following.node is not None:
            self._turn.emit(events.StandingBy, node=node, term=following.term)

    def _learn_beside(self, node: int, message: ManagementMessage) -> None:
        is_listening = self._claim.state is Mastership.LISTENING
        if is_listening and self._following.node is None and isinstance(message, Lease):
            self._claim.learns_for(LEARNS_LEASES)
        self._learn(node, message)

    def _learn(self, node: int, message: ManagementMessage) -> None:
        self._reactions.take(self._following.heard(node, message))
        self._reactions.take(self._following.held_no_longer(node, message))

    def _give_way(self, node: int, lease: Lease) -> None:
        was_active = self._claim.is_active
        if self._claim.gives_way_to(node, lease):
            if was_active:
                self._forget()
            self._follow(node, lease)

    # Beginning and ending

    def begin_term(self) -> None:
        """Begin a term: this manager is active from now on. If all terms have been used, no term begins."""
        if self._claim.begin_term():
            self._following.flies_own()
            self._deployment.begin(self._turn.term)
            self._exclusion.begun(self._turn.now_ns, self._health.available())
            self._beat.begin()

    def take_over(self) -> None:
        """Begin a term as successor of the manager that this manager has followed.

        To be called when no manager is active any more.
        """
        followed, now_ns = self._following, self._turn.now_ns
        active = filter(self._deployment.is_active, followed.available())
        inherited = self._health.inherited(active, now_ns)
        self._reactions.take(inherited)
        self.begin_term()
        for change in inherited:
            self._exclusion.unknown(change.pe)  # this manager does not know what the PE may drive
        if not self._claim.is_active:
            return
        silent_ns = None if followed.leased_ns is None else now_ns - followed.leased_ns
        self._turn.emit(
            events.TakenOver,
            term=self._turn.term,
            before=followed.term,
            silent_ns=silent_ns,
            phase=self._situation.phase,
        )
        if followed.holds_script():
            self._known.script.end(f"the mastership of manager {followed.node}, which held it, has ended")
        known_ns = followed.leased_ns if followed.leased_ns is not None else now_ns
        self._health.await_again(followed.unbelieved(), now_ns, self._settings.window_ns)
        self._replanning.take_over(Cause("no manager was active", now_ns, known_ns))

    def is_over(self, *, hears_no_pe: bool) -> bool:
        """Tell whether this term must end, and report the reason as an event.

        The term must end in two cases: this manager hears no PE (it is cut off, or its receiver has failed), or most
        PEs have reported for long enough that they hear no LEASE (for example, its term is too low). The answer is
        False if this manager only advises, or is not in the state ACTIVE.

        hears_no_pe: this manager hears no PE.
        """
        if self._settings.advise or self._claim.state is not Mastership.ACTIVE:
            return False
        if hears_no_pe:
            self._turn.emit(events.HearsNobody, term=self._turn.term)
            return True
        if self._beat.is_due() and self._claim.is_refused(most_hear_none=self._following.most_hear_none()):
            self._turn.emit(events.Refused, term=self._turn.term)
            return True
        return False

    def fall_silent(self) -> None:
        """Stop sending, and forget all that this manager knows except its memory, which the journal holds.

        The manager then listens until a PE is heard, and for T_lease after that.
        """
        self._forget()
        self._claim.fall_silent()

    def _forget(self) -> None:
        self._known.script.mastership_ends()
        self._replanning.forget()
        self._known.forget()
