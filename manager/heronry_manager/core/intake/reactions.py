"""The consequences of a change: for the available PEs, for what they may drive, and for the plan.

The files that notice a change (`health`, `known_situation`, `deployment`) only report it, as a value. `Reactions` acts
on each change, in the order in which the changes came:

    suspected                 the manager sends the PE a PING
    lost, rebooted, failed    ALIVE leaves the PE out immediately, epochs no longer wait for the PE, and a plan without
                              it is needed. If the PE was lost, `exclusion` works out until when it may still drive
                              outputs. If the PE has rebooted, `exclusion` takes its tokens away
    absent, joined            a plan is needed
    answered, heard again     there is only an event. A PE that has answered is still available; a PE that is heard
                              again is not available yet. `pe_details` reads whether the computer of the PE stood still
    any other change          as `known_situation` says

A PE that has another table is left alone (`other_tables`). A PE that does not execute its commands is failed, with the
cause in words. No change comes twice, since `health` and `known_situation` report a change only when their
own state changes.
"""

from collections.abc import Iterable

from heronry_manager import events
from heronry_manager.core.epochs import ANOTHER_TABLE
from heronry_manager.core.heartbeat import Beat
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.mastership import Claim
from heronry_manager.core.membership import Change, HealthChange
from heronry_manager.core.memory import Quarantined, Released
from heronry_manager.core.planning import Replanning
from heronry_manager.core.reports import Look
from heronry_manager.core.situation import (
    LimitChanged,
    ModuleReleased,
    PeSuspected,
    PlanInTime,
    PlanNeeded,
    SituationChange,
    TargetOrdered,
    TargetReleased,
)
from heronry_manager.core.turn import Turn
from heronry_wire.identifiers import Command
from heronry_wire.management import Control, Operation

LOADER = "the loader"
_ALL_NODES = 0


class Reactions:
    """Acts on each change of the situation, and of the health of a PE."""

    def __init__(self, turn: Turn, claim: Claim, known: Knowledge, beat: Beat, replanning: Replanning) -> None:
        self._turn, self._claim = turn, claim
        self._beat, self._replanning = beat, replanning
        self._health, self._exclusion, self._situation = known.health, known.exclusion, known.situation
        self._deployment, self._details = known.deployment, known.details
        self._bringing = known.bringing

    def take(self, changes: Iterable[SituationChange]) -> None:
        """Act on these changes, in their order: with commands, events, or a request for a plan."""
        for change in changes:
            match change:
                case HealthChange():
                    self._take_health(change)
                case PlanNeeded():
                    self._replanning.need(change)
                case PlanInTime():
                    self._replanning.need_in_time(change)
                case PeSuspected(pe):
                    self._beat.ping(pe)
                case LimitChanged():
                    self._replanning.limit(change)
                case TargetOrdered(target):
                    self._replanning.fly(target)
                case TargetReleased():
                    self._replanning.release()
                case ModuleReleased(module, pe):  # pragma: no branch - nothing else is left
                    if self._claim.is_active:
                        self._deployment.stopped(module, pe)

    def fail(self, pe: str, cause: str) -> None:
        """Fail a PE for this cause, although it still sends."""
        self.take(self._health.fail(pe, cause, self._turn.now_ns))

    def has_another_table(self, pe: str) -> None:
        """Leave a PE alone that refuses its slice for the digest.

        One that runs nothing is unavailable meanwhile, and is brought its table.
        """
        flies = self._deployment.leave_alone(pe)
        self._details.look_at_table(pe, flies=flies)
        if not flies:
            self.take(self._health.exclude(pe, ANOTHER_TABLE, self._turn.now_ns))
            self._bringing.has_another_table(pe)

    def code_arrived(self, element: str) -> None:
        """End the lack of code of a module, or of its place, as an operator's order ends a fault.

        If another fault or an order stands on it, it stays down.
        """
        changes, named = self._situation.code_arrived(element, LOADER), self._situation.field(element)
        if changes is None:
            return
        self.take(changes)
        if named is not None:
            self._turn.send(Command.CONTROL, Control(self._turn.term, _ALL_NODES, Operation.CLEAR, *named))

    def discount_losses(self) -> None:
        """Discount the last loss of each PE that was lost while this manager itself heard nothing.

        If a PE is still in quarantine after that, the memory gets its new number of losses; if it is not any more, the
        memory gets the end of the quarantine.
        """
        health = self._health
        for pe in health.discount_losses():
            if health.is_quarantined(pe):
                self._turn.keep(Quarantined(pe, health.losses(pe)))
            elif pe in self._turn.memory.quarantined:
                self._turn.keep(Released(pe))

    def _take_health(self, change: HealthChange) -> None:
        pe, last, turn = change.pe, change.last_heard_ns, self._turn
        match change.change:
            case Change.SUSPECTED:
                silent_ns = turn.now_ns - last if last is not None else None
                turn.emit(events.PeSuspected, pe=pe, cause=change.cause, silent_ns=silent_ns)
                if self._claim.is_active:
                    self._beat.ping(pe)
            case Change.ANSWERED:
                turn.emit(events.PeAnswered, pe=pe)
                self._details.look_at_standstills(pe, Look.TELL)
            case Change.LOST | Change.REBOOTED | Change.FAILED:
                self._lost(change)
            case Change.ABSENT:
                turn.emit(events.PeAbsent, pe=pe, cause=change.cause)
                self._replanning.need(PlanNeeded(f"pe:{pe}: {change.cause}"))
            case Change.HEARD_AGAIN:
                turn.emit(events.PeHeardAgain, pe=pe, cause=change.cause)
                self._details.look_at_standstills(pe, Look.TELL)
            case Change.JOINED:  # pragma: no branch - nothing else is left
                if pe in turn.memory.quarantined:
                    turn.keep(Released(pe))
                turn.emit(events.PeJoined, pe=pe, cause=change.cause)
                self._details.look_at_standstills(pe, Look.BEGIN)
                self._details.table_is_right(pe)
                self._bringing.table_is_right(pe)
                self._deployment.joined(pe)
                self._replanning.need(PlanNeeded(f"pe:{pe} joined"))

    def _lost(self, change: HealthChange) -> None:
        pe, last = change.pe, change.last_heard_ns
        if change.change is not Change.FAILED:
            self._details.table_is_right(pe)
            self._bringing.table_is_right(pe)
        if change.change is Change.REBOOTED:
            self._exclusion.rebooted(pe)
        elif change.change is Change.LOST:
            self._exclusion.declared_down(pe, self._turn.now_ns if last is None else last)
        self._turn.emit(events.PeLost, pe=pe, cause=change.cause, last_heard_ns=last)
        if self._health.is_quarantined(pe):
            self._turn.keep(Quarantined(pe, self._health.losses(pe)))
        self._deployment.lost(pe)
        if self._claim.speaks():
            self._beat.must_leave_out()
        self._situation.gateway_lost(pe)
        self._replanning.need(PlanNeeded(f"pe:{pe}: {change.cause}", last))
