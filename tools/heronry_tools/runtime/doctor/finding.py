"""One result of a check, in one sentence; if something is wrong, also the command line or sentence that helps."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding.

    check: a word to filter by.
    says: the result in a sentence.
    remedy: a command line or a sentence that helps; None where all is right.
    """

    check: str
    says: str
    remedy: str | None = None

    @property
    def is_right(self) -> bool:
        """Tell whether no remedy is needed."""
        return self.remedy is None
