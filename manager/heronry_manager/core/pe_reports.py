"""What a PE reports of itself, once it is decoded and believed: its state, a page at a time, and its EMCYs.

    page 0    the PE lives, and runs this: for `health`, `following` and `deployment`, in this order. Where it runs what
              it must not, or a newer epoch than there is, a plan is needed
    page 1    without a key: the PE lives; how far it is with the epoch that is being prepared
    page 2    with a key: the PE asks for a session, and gets its answer if this manager is active
    page 3    nothing but what `authenticity` takes from it
    EMCY      a fault, or a request for a phase. Only an active manager takes it in, and acknowledges it: until then the
              PE repeats it. An EMCY of a reset adds nothing, since the incarnation of the PE tells it

A page that cannot be decoded has no effect. A manager that has fallen silent forgets what it knew with the first page
that it hears, and listens anew.
"""

from heronry_manager.core.beat import Beat
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.mastership import Claim, Mastership
from heronry_manager.core.reactions import Reactions
from heronry_manager.core.replanning import Replanning
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import Command
from heronry_wire.management import Control, ElementKind, Emergency, FaultCode, Operation
from heronry_wire.state_frames import PeFlags, PeState, StatePage, StatePage0, StatePage1, StatePage2, StatePage3


class PeReports:
    """Takes in what PEs report."""

    def __init__(
        self,
        settings: ManagerSettings,
        turn: Turn,
        claim: Claim,
        known: Knowledge,
        *,
        beat: Beat,
        replanning: Replanning,
        reactions: Reactions,
    ) -> None:
        self._settings, self._turn, self._claim, self._known = settings, turn, claim, known
        self._beat, self._replanning, self._reactions = beat, replanning, reactions

    def page(self, pe: str, page: StatePage | None) -> None:
        """Take a page of a PE's state; None: one that is not believed."""
        if self._claim.state is Mastership.LISTENING and self._claim.hears_a_pe():
            self._known.begin()
            if self._settings.key is None:  # with one no PE can be believed before this manager is active
                self._known.health.in_flight(self._turn.now_ns)  # a PE that was down before need not be waited for
        match page:
            case StatePage0():
                self._page_0(pe, page)
            case StatePage1():
                if self._known.authenticity is None:
                    self._lives(pe, None, page.flags)
                cause = None if self._settings.advise else self._known.deployment.staging(pe, page)
                if cause is not None:
                    self._reactions.fail(pe, cause)
            case StatePage2() if self._known.authenticity is not None and self._claim.speaks():
                self._known.authenticity.answer(pe, page)
            case StatePage2() | StatePage3() | None:  # pragma: no branch - nothing else is left
                pass

    def unproven(self, pe: str, page: StatePage0) -> None:
        """Take a page 0 that is not believed: the PE lives, and reports whether it hears a manager."""
        self._known.health.spoke(pe, page.incarnation, self._turn.now_ns)
        self._known.following.state(pe, page, is_proven=False)

    def _page_0(self, pe: str, page: StatePage0) -> None:
        known = self._known
        self._lives(pe, page.incarnation, page.flags)
        if page.state is not PeState.UNCONFIGURED:
            known.health.in_flight(self._turn.now_ns)
        known.following.state(pe, page)
        cause = known.deployment.observe(pe, page)
        if self._settings.advise:
            self._replanning.look_at_what_runs()
            return
        if cause is not None:
            self._reactions.fail(pe, cause)
        self._replanning.need_higher_epoch(pe)

    def _lives(self, pe: str, incarnation: int | None, flags: PeFlags) -> None:
        known = self._known
        known.exclusion.heard(pe)
        hears_lease = PeFlags.HEARS_LEASE in flags or not self._claim.speaks()
        self._reactions.take(known.health.heard(pe, incarnation, self._turn.now_ns, hears_lease=hears_lease))

    def emergency(self, pe: str, emergency: Emergency | Malformed) -> None:
        """Take an EMCY of a PE: a fault, or a request for a phase."""
        if isinstance(emergency, Malformed) or emergency.code is FaultCode.RESET or not self._claim.is_active:
            return
        if emergency.kind is not ElementKind.PHASE:
            changes = self._known.situation.reported(pe, emergency)
        elif self._settings.advise and self._known.following.hears_lease():
            return  # the active manager announces what follows from it
        else:
            changes = self._known.situation.requested(pe, emergency)
        if changes is None:
            return
        self._reactions.take(changes)
        if emergency.kind is ElementKind.PHASE:  # once it is acknowledged only managers know of it
            self._beat.tell_phase()
        node = self._settings.spec.pes[pe].node_id
        told = Control(self._turn.term, node, Operation.ACKNOWLEDGE, *emergency.acknowledgement)
        self._turn.send(Command.CONTROL, told)

    def lost_channel(self, pe: str, emergency: Emergency) -> None:
        """Take a PE's report that a channel of a replicated bus carries nothing, or carries frames again."""
        if self._claim.is_active:
            self._known.situation.channels.reported(pe, emergency)
