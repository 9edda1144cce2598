"""Compares a recorded mastership with its replay: decisions that both have, and decisions that only one has."""

from collections.abc import Iterator
from dataclasses import dataclass
from difflib import SequenceMatcher
from typing import Literal

from heronry_tools.recording.masterships import Decision, RecordedMastership
from heronry_tools.sim.replay.rerun import Remark, Rerun

Taken = Literal["both", "recorded", "replayed"]


@dataclass(frozen=True, slots=True)
class Compared:
    """A decision in the recording, in the replay, or in both.

    taken: where the decision is: in both, only in the recording, or only in the replay
    late_ns: how much later the decision is in the replay than in the recording, if it is in both
    """

    decision: Decision
    taken: Taken
    late_ns: int = 0

    @property
    def t_ns(self) -> int:
        """Return the time of the decision; if recording and replay both have it, its time in the recording."""
        return self.decision.t_ns


@dataclass(frozen=True, slots=True)
class Comparison:
    """All decisions and remarks of a mastership, in order of time."""

    mastership: RecordedMastership
    entries: list[Compared | Remark]

    def differences(self) -> int:
        """Return the number of differences between recording and replay.

        These are the decisions that only one of them has, and the remarks that report a difference.
        """
        return sum(e.differs if isinstance(e, Remark) else e.taken != "both" for e in self.entries)

    def decisions(self) -> int:
        """Return the number of decisions in the recording."""
        return len(self.mastership.decisions)


def compared(mastership: RecordedMastership, rerun: Rerun) -> Comparison:
    """Compare a mastership with its replay."""
    entries: list[Compared | Remark] = [*rerun.remarks, *_decisions(mastership, rerun)]
    entries.sort(key=lambda entry: entry.t_ns)  # stable: at equal times remarks come first
    return Comparison(mastership, entries)


def _decisions(mastership: RecordedMastership, rerun: Rerun) -> Iterator[Compared]:
    ours, theirs = rerun.decisions, mastership.decisions
    matcher = SequenceMatcher(None, theirs, ours, autojunk=False)
    for tag, i1, i2, j1, j2 in matcher.get_opcodes():
        if tag == "equal":
            for recorded, replayed in zip(theirs[i1:i2], ours[j1:j2], strict=True):
                yield Compared(recorded, "both", replayed.t_ns - recorded.t_ns)
        else:
            yield from (Compared(decision, "recorded") for decision in theirs[i1:i2])
            yield from (Compared(decision, "replayed") for decision in ours[j1:j2])
