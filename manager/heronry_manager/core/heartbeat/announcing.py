"""The active manager announces what a standby manager must know: phase, priorities, faults, a held script, the spec.

A *fact* is one such announcement:

- CONTROL HOLDS with the spec that flies, the phase, a latched fault, a changed priority or a held script;
- CONTROL CLEAR with a function that has the priority of the spec, if the manager has executed a PE's request for a
  priority of this function.

The manager announces one fact at a time. A new fact comes with the next beat. The other facts take turns: one of them
comes with every ANNOUNCED_EVERY-th beat.

The manager also announces which requests of PEs it has executed: when the phase has its turn, the requests for phases;
when a priority has its turn, the requests for this priority. Before each answer to a request, the manager announces the
phase or the priority once more, since a standby manager that has just started may not have heard it yet.

The spec that flies is announced only once it has changed in flight (`memory`). It comes first in each term, since the
indices in all other facts are those of this spec (`flown_spec`).

A PE uses only the phase, for the rules of phases (`phase_requests` of the agent). A standby manager that has missed a
fact hears it again later. It drops a fact that it has not heard for some turns (`known_situation`).
"""

from heronry_dg.model import Spec
from heronry_manager.core.situation import Fact, HeldScript, KnownSituation
from heronry_manager.core.turn import Turn
from heronry_wire.element_places import spec_mark
from heronry_wire.management import ElementKind, Operation
from heronry_wire.protocol_times import ANNOUNCED_EVERY


class Announcer:
    """Chooses the fact that the active manager announces next."""

    def __init__(self, spec: Spec, turn: Turn, situation: KnownSituation, script: HeldScript) -> None:
        self._turn, self._phases = turn, list(spec.phases)
        self._spec: Fact = Operation.HOLDS, ElementKind.SPEC, spec_mark(spec.digest)
        self._situation, self._script = situation, script
        self._beat = 0
        self._told: dict[Fact, int] = {}  # number of the beat that announced each fact last

    def next(self) -> Fact | None:
        """Return the fact to announce with this beat, and count it as announced; None: no fact is due."""
        self._beat += 1
        facts = self.look()
        fact = min(facts, key=lambda one: self._told.get(one, 0), default=None)
        if fact is None or (fact in self._told and self._beat % ANNOUNCED_EVERY):
            return None
        self._told[fact] = self._beat
        return fact

    def phase(self) -> list[Fact]:
        """Return the phase as a fact that is announced immediately; an empty list if the spec has no phases."""
        phase = self._phase()
        self._told |= dict.fromkeys(phase, self._beat)
        return phase

    def look(self) -> list[Fact]:
        """List the facts that hold now, and forget all others: a fact that holds again later counts as new."""
        facts = [self._spec] if self._turn.memory.flies is not None else []
        facts += self._phase() + self._situation.facts()
        if self._script.target is not None:
            facts.append((Operation.HOLDS, ElementKind.SCRIPT, 0))
        self._told = {fact: beat for fact, beat in self._told.items() if fact in facts}
        return facts

    def _phase(self) -> list[Fact]:
        phase = self._situation.phase
        return [] if phase is None else [(Operation.HOLDS, ElementKind.PHASE, self._phases.index(phase))]
