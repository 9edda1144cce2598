"""One result of a check, in one sentence; if something is wrong, also the command line or sentence that helps."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of a check.

    check: one word that names the check; the user may filter findings by it.
    says: the result in a sentence.
    remedy: a command line or a sentence that helps; None if nothing is wrong.
    """

    check: str
    says: str
    remedy: str | None = None

    @property
    def is_right(self) -> bool:
        """Tell whether no remedy is needed."""
        return self.remedy is None
