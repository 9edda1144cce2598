"""Which spec flies, as far as a manager that follows another one has heard (HOLDS of kind SPEC).

    its own    nothing else was heard. A manager announces its spec once that has changed in flight (`memory`)
    another    the active manager announces another spec. This manager does not take over, and takes in no other fact,
               since indices are those of that spec. If it has that spec at hand, it goes on with it (`reloading`)
    untold     a manager whose spec was announced has begun a new term, and not announced it yet: no fact is taken in

*Who may change it.* An announcement of the followed manager in its term; with a key a proven one. An announcement that
does not come for three turns is dropped, as any fact is: the spec is its own again. What most PEs show counts more
(`following`): if they run what this manager has overheard, then its own spec flies, whatever is announced.

*What may go wrong.*

    lost       The announcement is repeated in turn
    late       One of an earlier term has no effect
    doubled    No further effect
    forged     Without a key, this manager takes in no fact until the next true announcement, or for three turns. It
               takes over all the same if it knows what the PEs run
    restart    The last announcement is remembered. A restart with another spec forgets it
"""

from heronry_manager import events
from heronry_manager.core.memory import SpecFlies
from heronry_manager.core.turn import Turn
from heronry_wire.element_places import spec_mark
from heronry_wire.protocol_times import ANNOUNCED_EVERY

_TURNS = 3  # of announcements, in which the spec may stay unannounced


class FlownSpec:
    """Keeps what is announced of the spec that flies."""

    def __init__(self, turn: Turn, digest: str) -> None:
        """Begin with what is remembered; `digest`: of this manager's spec, hexadecimal."""
        self._turn, self._own = turn, spec_mark(digest)
        self.forget()

    def forget(self) -> None:
        """Forget all but what is remembered."""
        self._mark = self._turn.memory.flies
        self._told_in: int | None = None  # the term
        self._untold_beats = 0

    @property
    def is_announced(self) -> bool:
        """Tell whether the active manager is known to announce its spec."""
        return self._mark is not None

    def told(self, term: int, mark: int) -> None:
        """Note that the followed manager has announced, in its term, that the spec with this mark flies."""
        self._told_in, self._untold_beats = term, 0
        self._set(mark)

    def beat(self, term: int, facts: int) -> None:
        """Count a beat of the followed manager, which announces `facts` facts in turn; drop what it leaves out."""
        self._untold_beats += 1
        if self._untold_beats > _TURNS * ANNOUNCED_EVERY * facts:
            self.is_own()
            self._told_in = term

    def is_own(self) -> None:
        """Note that this manager's own spec flies; one that was never said to fly is not remembered."""
        if self._mark is not None:
            self._set(self._own)

    def facts_count(self, term: int) -> bool:
        """Tell whether the facts that the followed manager announces in this term have the indices of the own spec."""
        return self._mark is None or (self._mark == self._own and self._told_in == term)

    @property
    def other(self) -> int | None:
        """The mark of the spec that is said to fly, if that is not the own one."""
        return None if self._mark == self._own else self._mark

    def _set(self, mark: int) -> None:
        if mark != self._mark:
            self._mark = mark
            self._turn.keep(SpecFlies(mark))
            if mark != self._own:
                self._turn.emit(events.OtherSpecFlies, digest=f"{mark:04x}")
