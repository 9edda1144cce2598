"""The reports of PEs, once they are decoded and believed: the pages of a state, and EMCYs.

    page 0    shows that the PE lives, and which epoch it runs. `health`, `following` and `deployment` get the page, in
              this order. If the PE runs what it must not, or an epoch newer than this manager's, a plan is needed
    page 1    shows how far the PE is with the epoch that is being prepared; without a key also that the PE lives
    page 2    exists with a key: the PE requests a session, which this manager opens if it is active
    page 3    is used by `authenticity` alone
    EMCY      reports a fault, or requests a phase or a priority. Only an active manager takes such an EMCY, and
              acknowledges it; the PE repeats the EMCY until it is acknowledged. Notices (`module_notices`) and
              silences (`silences`) are not acknowledged, unless a module fails by its silence. An EMCY that reports a
              reset has no effect, since the incarnation shows the reset

A page that cannot be decoded has no effect. When a manager that has fallen silent hears a page again, it forgets
everything except what its journal holds (`memory`), and listens for T_lease.
"""

from heronry_manager.core.intake.hearer import Hearer
from heronry_manager.core.mastership import Mastership
from heronry_wire.frame import Malformed
from heronry_wire.identifiers import Command
from heronry_wire.management import (
    PRIORITY_REQUEST_NUMBERS,
    Control,
    ElementKind,
    Emergency,
    FaultCode,
    Operation,
)
from heronry_wire.state_frames import (
    PeFlags,
    PeState,
    Reason,
    StatePage,
    StatePage0,
    StatePage1,
    StatePage2,
    StatePage3,
)

_REQUESTS = (ElementKind.PHASE, ElementKind.PRIORITY)


class PeReports(Hearer):
    """Hands the reports of PEs to the objects of the core that use them."""

    def page(self, pe: str, page: StatePage | None) -> None:
        """Process a page of a PE's state; None: the page has come but is not believed."""
        if self._claim.state is Mastership.LISTENING and self._claim.hears_a_pe():
            self._known.forget()
            if self._settings.key is None:  # with a key no PE can be believed before this manager is active
                self._health.in_flight(self._turn.now_ns)  # do not wait for PEs that were down before
        match page:
            case StatePage0():
                self._page_0(pe, page)
            case StatePage1():
                if self._known.authenticity is None:
                    self._lives(pe, None, page.flags)
                self._page_1(pe, page)
            case StatePage2() if self._known.authenticity is not None and self._claim.speaks():
                self._known.authenticity.answer(pe, page)
            case StatePage2() | StatePage3() | None:  # pragma: no branch - nothing else is left
                pass

    def unproven(self, pe: str, page: StatePage0) -> None:
        """Process a page 0 that is not believed.

        The page may still show that the PE lives, and that the PE hears a manager.
        """
        self._health.spoke(pe, page.incarnation, self._turn.now_ns)
        self._following.state(pe, page, is_proven=False)

    def _page_0(self, pe: str, page: StatePage0) -> None:
        self._lives(pe, page.incarnation, page.flags)
        if page.state is not PeState.UNCONFIGURED:
            self._health.in_flight(self._turn.now_ns)
        self._following.state(pe, page)
        self._situation.answered(pe)
        self._known.held_outputs.reported(pe, page)
        cause = self._deployment.observe(pe, page)
        if self._settings.advise:
            self._replanning.look_at_what_runs()
            return
        if cause is not None:
            self._reactions.fail(pe, cause)
        self._replanning.need_higher_epoch(pe)

    def _page_1(self, pe: str, page: StatePage1) -> None:
        if self._settings.advise:
            return
        cause = self._deployment.staging(pe, page)
        if cause is not None and page.reason is Reason.DIGEST:
            self._reactions.has_another_table(pe)
        elif cause is not None:
            self._reactions.fail(pe, cause)

    def _lives(self, pe: str, incarnation: int | None, flags: PeFlags) -> None:
        self._exclusion.heard(pe)
        hears_lease = PeFlags.HEARS_LEASE in flags or not self._claim.speaks()
        self._reactions.take(self._health.heard(pe, incarnation, self._turn.now_ns, hears_lease=hears_lease))

    def emergency(self, pe: str, emergency: Emergency | Malformed) -> None:
        """Process an EMCY of a PE: a fault, a notice of a module, or a request for a phase or a priority."""
        if isinstance(emergency, Malformed) or emergency.code is FaultCode.RESET or not self._claim.is_active:
            return
        if self._deployment.is_switching():
            return  # its indices may be those of another spec; the PE repeats it to the next manager
        if self._situation.noticed(pe, emergency):
            return
        if emergency.code is FaultCode.STALE:
            failed = self._known.silences.reported(pe, emergency)
            if failed is not None:
                self._reactions.take(self._situation.failed_there(failed, pe, emergency))
                self._acknowledge(pe, emergency)
            return
        if emergency.kind not in _REQUESTS:
            changes = self._situation.reported(pe, emergency)
        elif self._settings.advise and self._following.hears_lease():
            return  # the active manager announces phase and priorities
        else:
            changes = self._situation.requested(pe, emergency)
        if changes is None:
            return
        element = self._situation.element(emergency)
        if emergency.kind is ElementKind.MODULE and element is not None:
            self._known.details.failed(pe, element, emergency)
        self._reactions.take(changes)
        if emergency.kind is ElementKind.PHASE:  # the PE forgets an acknowledged request
            self._beat.tell_phase()
        elif emergency.kind is ElementKind.PRIORITY:
            self._beat.tell_priority(emergency.index // PRIORITY_REQUEST_NUMBERS)
        self._acknowledge(pe, emergency)

    def _acknowledge(self, pe: str, emergency: Emergency) -> None:
        node = self._settings.spec.pes[pe].node_id
        told = Control(self._turn.term, node, Operation.ACKNOWLEDGE, *emergency.acknowledgement)
        self._turn.send(Command.CONTROL, told)

    def lost_channel(self, pe: str, emergency: Emergency) -> None:
        """Note a PE's report that a channel of a replicated bus carries nothing, or carries frames again."""
        if self._claim.is_active:
            self._situation.channel_reported(pe, emergency)
