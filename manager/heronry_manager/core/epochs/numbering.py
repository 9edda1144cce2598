"""The numbers of masterships and epochs: two managers never use the same number, and no manager uses one twice.

    terms    manager 126 takes the odd terms, manager 127 the even terms. So two managers can never be active in the
             same term, even if they have not heard of each other
    epochs   come in blocks of EPOCHS_PER_TERM. A mastership begins with the block of its term, and takes every second
             block from there on. So two managers that are active on the two sides of a broken bus do not give two
             epochs the same number

A new epoch is also newer than the epoch in the journal, and than every epoch that a PE was seen to run. The reason: a
PE accepts no epoch that is older than its own, and a silent PE may still hear commands and drive outputs.

A block is reserved in the journal (`memory`) before its first number is used. So a manager that restarts goes on behind
all numbers that it may have used. Epochs are counted modulo 2^16 (`is_newer`).
"""

from heronry_manager.core.memory import EPOCHS, Reserved
from heronry_manager.core.turn import Turn
from heronry_wire.errors import HeronryError
from heronry_wire.identifiers import FIRST_MANAGER
from heronry_wire.management import MAX_TERM, NO_EPOCH, newest_epoch, next_epoch

EPOCHS_PER_TERM = 16
_BLOCKS = 0x10000 // EPOCHS_PER_TERM


class NoTermError(HeronryError):
    """All terms of this manager have been used; the message says what to do."""


def next_term(node: int, highest: int) -> int:
    """Return the first term above `highest` that the manager `node` may use; raises NoTermError if none is left."""
    term = highest + 1 + (highest + node - FIRST_MANAGER) % 2
    if term > MAX_TERM:
        raise NoTermError(
            f"there is no term after {highest}; end all managers, remove the manager's journals (manager-*.journal in "
            "the folder of --state-dir), with --key make a new key, and restart the PEs and the managers"
        )
    return term


class EpochNumbers:
    """Gives numbers to the epochs of one manager."""

    def __init__(self, turn: Turn) -> None:
        self._turn = turn
        self._block: int | None = None  # the one that is being used up
        self.last = 0  # the newest number that was given, or may have been before a restart

    def begin(self, term: int) -> None:
        """Begin the mastership of a term: its epochs get numbers newer than all numbers used or reserved before."""
        self._block = None
        self.last = newest_epoch(((term - 1) * EPOCHS_PER_TERM, self._turn.memory.reserved.get(EPOCHS, 0), self.last))

    def next(self, newest_seen: int) -> int:
        """Return a number newer than all given before, and newer than `newest_seen`, the newest that a PE runs."""
        runs = self._turn.memory.runs
        epoch = next_epoch(newest_epoch((self.last, newest_seen, NO_EPOCH if runs is None else runs.epoch)))
        if (_block_of(epoch) - (self._turn.term - 1)) % 2:
            epoch = _first_of(_block_of(epoch) + 1)
        if _block_of(epoch) != self._block:
            self._block = _block_of(epoch)
            last = min(_first_of(self._block) + EPOCHS_PER_TERM - 1, 0xFFFF)
            self._turn.keep(Reserved(EPOCHS, last))
        self.last = epoch
        return epoch


def _block_of(epoch: int) -> int:
    return (epoch - 1) // EPOCHS_PER_TERM


def _first_of(block: int) -> int:
    return block % _BLOCKS * EPOCHS_PER_TERM + 1
