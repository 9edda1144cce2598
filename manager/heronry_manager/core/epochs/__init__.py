"""Epochs: from a plan to a configuration that runs, and what is known of what runs.

*What is decided.* An *epoch* is a compiled plan with a number. This room decides which number it gets, when it is
prepared, when each of its steps may be commanded, when it runs everywhere, and when it is given up. There are two
epochs at most: `next`, which is being prepared, and `current`, the last one whose ACTIVATE went out. The stages of one:

    PREPARING ─► BREAKING ─► HOLDING ─► GOING ─► DONE       BREAKING and HOLDING only if there is something to wait for
        └─► ABANDONED                                       only before the first ACTIVATE

    deployment         the two epochs, and what each report of a PE means for them
    known_epochs       how an epoch is made of a plan, and which old ones are remembered
    reconfiguration    one epoch on its way; the table of its stages
    activation         the steps BREAK, GO and GO_ALL, and what each waits for
    spec_switch        the epoch by which all PEs change to another spec
    adoption           takes over what runs already, without a new epoch
    numbering          the numbers of terms and epochs: none is used twice
    other_tables       which PEs fly with a table that this manager does not compile for
    observation        what each PE runs, by its own reports
    advice             what a manager that only advises says instead
    held_outputs       which PEs hold exclusive outputs back, and why
    silences           which inputs and outputs of what runs are silent

*Who may change it.* `planning` opens and abandons epochs. Reports of PEs move an epoch on; only they say what a PE
*runs*: a command never does. Which PEs an epoch waits for follows from `membership`.

*What may go wrong.*

    lost       Each command is repeated until it is acknowledged, and LEASE repeats the epoch and its step. A PE that
               does not answer for PATIENCE_PERIODS is failed
    late       An answer names its epoch, so an answer to an older one is dropped. A PE may come late, and still joins
    doubled    A doubled command has no effect on a PE; a doubled answer counts once
    forged     A state counts if `authentication` believes it. A forged epoch number makes the manager open an epoch
               that is newer still
    restart    The epoch that was activated last is remembered, as are the reserved numbers. What the PEs run is adopted
               if it is known, and replaced by a new epoch if not

The protocol: docs/protocol/reconfiguration.md.
"""

from heronry_manager.core.epochs.advice import Advice
from heronry_manager.core.epochs.deployment import Deployment
from heronry_manager.core.epochs.epoch import STAGE_TRANSITIONS, Cause, Stage
from heronry_manager.core.epochs.held_outputs import HeldOutputs
from heronry_manager.core.epochs.numbering import EPOCHS_PER_TERM, NoTermError, next_term
from heronry_manager.core.epochs.other_tables import ANOTHER_TABLE
from heronry_manager.core.epochs.silences import Silences
from heronry_manager.core.epochs.spec_switch import SpecSwitch

__all__ = [
    "ANOTHER_TABLE",
    "EPOCHS_PER_TERM",
    "STAGE_TRANSITIONS",
    "Advice",
    "Cause",
    "Deployment",
    "HeldOutputs",
    "NoTermError",
    "Silences",
    "SpecSwitch",
    "Stage",
    "next_term",
]
