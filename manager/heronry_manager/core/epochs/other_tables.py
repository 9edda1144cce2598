"""PEs whose table is not the one for which this manager compiles slices: of another spec, another protocol, or damaged.

Only the PE itself decides this: the digest of a slice names the table (protocol rule 4), so such a PE reports in page 1
that it refuses the slice for its digest. Nothing else is believed; object 2001h only words the sentence (`pe_details`).

    it runs nothing     it is unavailable until it restarts, since no PE changes its table while it runs. This counts as
                        no loss: the PE has done nothing that a hold-down should punish
    it flies            it runs what this manager neither knows nor has commanded, and this manager has no current
                        epoch: it was restarted with a changed spec, and the aircraft flies by the old one. Then no
                        epoch is activated, since a newer epoch takes the exclusive outputs away from every PE that
                        does not run it (protocol rule 6). LEASE names no epoch, so all PEs go on with what they run

The PE stops flying when it is lost, restarts, falls back to running nothing, or the operator fails it. When no PE flies
any more, the manager plans. Until then all other faults wait, too: a plan for some PEs would stop the others.

A lost page 1 is repeated by the PE. A forged one holds a manager that has just started, without a key; a PE that is in
the current epoch is never among the flying ones, so a forged page 1 cannot hold an aircraft that this manager flies. A
restart, and each new term, forgets everything here; the PEs refuse again.
"""

from heronry_manager.core.epochs.observation import Observations

ANOTHER_TABLE = "its table is another one than this manager compiles for it"


class OtherTables:
    """Knows the PEs that fly with another table."""

    def __init__(self, observed: Observations) -> None:
        self._observed = observed
        self._refusing: set[str] = set()

    def forget(self) -> None:
        """Begin a new term, in which no PE has refused anything yet."""
        self._refusing.clear()

    def flies(self, pe: str) -> None:
        """Note that a PE refuses its slice for the digest, and flies."""
        self._refusing.add(pe)

    def lost(self, pe: str) -> None:
        """Note that a PE is not available any more."""
        self._refusing.discard(pe)

    def flying(self) -> list[str]:
        """Return the PEs that fly with another table, by name."""
        return sorted(pe for pe in self._refusing if self._observed.runs_unknown(pe))

    def why(self) -> str:
        """Say why no epoch is opened."""
        flying = self.flying()
        return f"{', '.join(flying)} {'flies' if len(flying) == 1 else 'fly'} with another table"
