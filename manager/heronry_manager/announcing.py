"""What the manager holds, told to whoever may have to take over: the phase, and each latched fault (CONTROL, HOLDS).

One fact a time: what is new with the next beat, the others in turn, one with every ANNOUNCED_EVERY-th beat. A phase
that a PE has asked for is told before the answer to that. A PE obeys none of it; a standby that has missed a fact hears
it again, and believes no longer in what it has not heard for some turns (`known_situation`).
"""

from heronry_dg.model import Spec
from heronry_manager.known_situation import ANNOUNCED_EVERY, KnownSituation
from heronry_wire.management import ElementKind

Fact = tuple[ElementKind, int]


class Announcer:
    """Chooses what to tell next."""

    def __init__(self, spec: Spec, situation: KnownSituation) -> None:
        self._phases = list(spec.phases)
        self._situation = situation
        self._beat = 0
        self._told: dict[Fact, int] = {}  # with which beat

    def next(self) -> Fact | None:
        """Give what is to be told with this beat."""
        self._beat += 1
        facts = self._facts()
        fact = min(facts, key=lambda one: self._told.get(one, 0), default=None)
        if fact is None or (fact in self._told and self._beat % ANNOUNCED_EVERY):
            return None
        self._told[fact] = self._beat
        return fact

    def phase(self) -> Fact | None:
        """Give the phase, if that is to be told at once: nobody has been told of it."""
        facts = self._facts()
        new = [fact for fact in facts if fact[0] is ElementKind.PHASE and fact not in self._told]
        self._told |= dict.fromkeys(new, self._beat)
        return new[0] if new else None

    def _facts(self) -> list[Fact]:
        """What is held now; what is not was told of another time, and is news if it is held again."""
        phase = self._situation.phase
        facts: list[Fact] = [] if phase is None else [(ElementKind.PHASE, self._phases.index(phase))]
        places = map(self._situation.failed.place, self._situation.failed.elements)
        facts += sorted(place for place in places if place is not None)
        self._told = {fact: beat for fact, beat in self._told.items() if fact in facts}
        return facts
