"""A script of the operator: the configuration that it makes is to run, and to stay.

A script turns the running configuration into another one, the *target*. The core knows no component graphs, so the
operator's order contains only the target. At most one target is asked for, and at most one is held:

    asked   the target was legal when it was ordered. The core has requested the best plan for the situation, and will
            compare the target with this plan
    held    the target was not worse at level 1 than that plan. It runs as an epoch, like any plan, and stays: the core
            requests no better plan in the background, and contingencies do not apply (`RequestPlan.target`)

A target that is asked for is refused in these cases:

    - it is worse at level 1 than the best plan
    - there is no plan
    - the situation changes before the plan comes
    - the operator releases it

A held target is no longer held in these cases; any other change of the situation lets it stay:

    - the operator releases it
    - another script takes its place
    - this mastership ends
    - the situation has changed, and the target is not legal any more
    - the situation has changed, and the target is worse at level 1 than the plan for the new situation

If the situation changes before the epoch of a held target is activated, the target is deployed as a new epoch.

The active manager announces a held script (`announcing`). A standby manager that takes over ends the script, and
reports that. A restart of the manager also ends it, without a report. The PEs go on with what they run, and the next
mastership seeks the best plan.

If an answer of the planner is late or doubled, its number shows that, and the answer is dropped (`planning`). If an
answer is lost, the next change of the situation refuses the target that was asked for.
"""

from typing import Any

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.objective import Placement, score
from heronry_dg.plan import Plan, make_plan
from heronry_dg.situation import Situation
from heronry_dg.verify import verify
from heronry_manager import events
from heronry_manager.core.turn import Turn

_TAKEN = "it is legal, and serves as much at level 1 as the best plan"
_WORSE = "it is worse at level 1 than the plan for this situation"


class HeldScript:
    """Keeps, for one mastership, the target that a script has asked for, and the target that is held."""

    def __init__(self, spec: Spec, turn: Turn) -> None:
        self._spec, self._turn = spec, turn
        self.forget()

    def forget(self) -> None:
        """Begin without a script."""
        self._ordered: Configuration | None = None
        self.target: Configuration | None = None  # the held one
        self._last: tuple[str, str] = ("none", "")  # what became of the last script, and why

    @property
    def is_ordered(self) -> bool:
        """Tell whether the operator has ordered a configuration that still has to be compared with the best plan."""
        return self._ordered is not None

    def status(self) -> dict[str, Any]:
        """Return the state of the last script (none, asked, held, refused, ended), and why it was refused or ended."""
        if self.is_ordered:
            return {"state": "asked", "why": None}
        if self.target is not None:
            return {"state": "held", "why": None}
        state, why = self._last
        return {"state": state, "why": why or None}

    def order(self, target: Configuration) -> None:
        """Note that the operator orders `target`, the configuration of a script, which is legal now."""
        self._ordered = target

    def refuse(self, reason: str) -> None:
        """Refuse the configuration that was ordered; the PEs go on with what they run."""
        self._ordered, self._last = None, ("refused", reason)
        self._turn.emit(events.ScriptRefused, reason=reason)

    def end(self, reason: str) -> None:
        """End the script that this manager holds or its predecessor held, and report the reason in an event."""
        self.target, self._last = None, ("ended", reason)
        self._turn.emit(events.ScriptEnded, reason=reason)

    def release(self) -> bool:
        """Release the operator's scripts: refuse the ordered one that waits, and end the held one.

        Returns False if there is neither an ordered nor a held one.
        """
        was_ordered, was_held = self.is_ordered, self.target is not None
        if was_ordered:
            self.refuse("the operator released it")
        if was_held:
            self.end("the operator released it")
        return was_ordered or was_held

    def mastership_ends(self) -> None:
        """End all scripts, since this manager no longer commands."""
        self._turned("this mastership has ended", is_legal=False)

    def situation_changed(self, now: Situation, cause: str) -> None:
        """Refuse the ordered configuration that waits; end the held one if it is not legal in the situation `now`."""
        if not self.is_ordered and self.target is None:
            return
        broken = [] if self.target is None else verify(self._spec, now, self.target)
        why = f"{cause}; it is no longer legal: {broken[0]}" if broken else f"the situation has changed: {cause}"
        self._turned(why, is_legal=not broken)

    def _turned(self, why: str, *, is_legal: bool) -> None:
        if self.is_ordered:
            self.refuse(why)
        if self.target is not None and not is_legal:
            self.end(why)

    def weigh(self, known: Plan, now: Situation, running: Placement | None) -> Plan | None:
        """Choose what to deploy: the configuration of a script, or `known`, the plan for this situation.

        1. If the operator has just ordered a configuration, it is compared with `known`. If it is worse at
           level 1, the order is refused; otherwise this configuration becomes the held one, and a plan of it is
           returned.
        2. Then the configuration of the held script is compared with `known`. If it is worse at level 1, the
           script ends; otherwise a plan of this configuration is returned.

        Returns None if no script has a configuration that may be deployed; then the caller has to deploy `known`.
        """
        if self._ordered is not None:
            plan = self._worthy(self._ordered, known, now, running)
            if plan is not None:
                self._take(self._ordered)
                return plan
            self.refuse(_WORSE)
        if self.target is not None:
            plan = self._worthy(self.target, known, now, running)
            if plan is not None:
                return plan
            self.end(_WORSE)
        return None

    def _take(self, target: Configuration) -> None:
        if self.target is not None:
            self.end("another script takes its place")
        self._ordered, self.target = None, target
        self._turn.emit(events.ScriptTaken, reason=_TAKEN)

    def _worthy(self, target: Configuration, known: Plan, now: Situation, running: Placement | None) -> Plan | None:
        worth = score(self._spec, now, target, running)
        if worth.critical < known.objective.critical:
            return None
        return make_plan(self._spec, now, target, worth, optimal=False)
