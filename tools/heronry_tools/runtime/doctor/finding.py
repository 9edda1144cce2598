"""One result of a check: right or not, in one sentence, and what to type where it is not."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding. `check`: the word to filter by; `remedy`: a command line or a sentence, None where all is right."""

    check: str
    says: str
    remedy: str | None = None

    @property
    def is_right(self) -> bool:
        """Tell whether no remedy is needed."""
        return self.remedy is None
