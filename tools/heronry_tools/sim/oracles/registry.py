"""The list of all oracles of a flight, one per line. To add one, write its class (`oracle`) and name the class here."""

from collections.abc import Callable

from heronry_dg.checkpoints import kept_modules
from heronry_tools.sim.oracles.checkpoints import CheckpointCheck
from heronry_tools.sim.oracles.configurations import ConfigurationCheck
from heronry_tools.sim.oracles.journal import JournalCheck
from heronry_tools.sim.oracles.known import Known
from heronry_tools.sim.oracles.load import LoadCheck
from heronry_tools.sim.oracles.oracle import Oracle
from heronry_tools.sim.oracles.orphans import OrphanCheck
from heronry_tools.sim.oracles.progress import ProgressCheck
from heronry_tools.sim.oracles.publishing import PublishingCheck
from heronry_tools.sim.oracles.radio import RadioCheck
from heronry_tools.sim.oracles.safe_mode import SafeModeCheck
from heronry_tools.sim.oracles.transitions import TransitionCheck

ORACLES: tuple[Callable[[Known], Oracle | None], ...] = (
    lambda known: known.exclusion,
    lambda known: known.either,
    lambda known: known.epochs,
    lambda known: ConfigurationCheck(known.spec),
    lambda known: known.service,
    lambda known: known.terms,
    lambda known: OrphanCheck(known.spec, has_digests=known.key is None),
    lambda known: known.freshness,
    lambda known: CheckpointCheck(known.spec) if any(kept_modules(known.spec)) else None,
    lambda known: PublishingCheck(known.spec, known.commanded),
    lambda known: LoadCheck(known.spec),
    lambda known: RadioCheck(known.spec),
    lambda known: SafeModeCheck(known.spec, known.commanded),
    lambda known: known.channels,
    lambda known: TransitionCheck(known.spec, known.commanded.epochs),
    lambda known: JournalCheck(known.spec, known.read_journal, known.switched_by),
    lambda _: ProgressCheck(),
    lambda known: known.phases,
    lambda known: known.priorities,
    lambda known: known.scripts,
    lambda known: known.blame,
    lambda known: known.stale,
    lambda known: known.planned_load,
    lambda known: known.availability,
    lambda known: known.tables,
    lambda known: known.code,
    lambda known: known.authenticity,
)
"""Functions that create the oracles; a function returns None where its oracle has nothing to verify in the run."""


def oracles(known: Known) -> list[Oracle]:
    """Create the oracles of one flight."""
    return [oracle for make in ORACLES if (oracle := make(known)) is not None]
