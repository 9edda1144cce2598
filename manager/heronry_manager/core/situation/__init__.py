"""The situation: what is down, what is limited, the mission phase, changed priorities; what plans are made for.

*What is decided.* `known_situation` puts the situation together, and says as values what follows from a change
(`SituationChange`); it carries nothing out. Each part has a file of its own:

    latched_faults        well ─► latched, until the operator clears the element
    radio_links           settling ─► followed ─► gone: the share of a radio's bandwidth that plans may use
    mission_phase         the phase of the mission, by order, by request, or by a rule
    changed_priorities    the priority of a function: the spec's, requested, or ordered
    held_script           asked ─► held: the configuration that a script of the operator makes
    suspicions            what modules say of PEs and buses; the manager assesses it by its own evidence

Three more only report, and change no plan: `lost_channels`, `module_notices` and `restarts_told`.

*Who may change it.* A report of a PE or a gateway, an order of the operator, and, while this manager follows another
one, what that manager announces. PEs that are not available count as down (`membership`); this room cannot change that,
except that it bars a PE with a latched fault and cuts off the PEs beyond a radio that is gone.

*What may go wrong.* The head of each file tells it in detail. In common:

    lost       A PE repeats each report until it is acknowledged or its cause is over. An order of the operator reaches
               the manager over a stream. A standby manager hears each fact again in every round of announcements
    late       A report after the cause has been cleared counts as a new one; requests carry numbers
    doubled    A report of what is known already changes nothing
    forged     Without a key: a false fault takes an element out of use until it is cleared, a false request changes a
               phase, or a priority within its range. With a key a report counts once a state has proven it
    restart    Phase, faults, priorities and the numbers of requests are remembered (`memory`). Limits of radios,
               suspicions and notices come again with the next report

The protocol: docs/protocol/faults.md, phases.md, priorities.md, radios.md and channels.md.
"""

from heronry_manager.core.situation.changed_priorities import Fact
from heronry_manager.core.situation.changes import (
    Changes,
    LimitChanged,
    ModuleReleased,
    PeSuspected,
    PlanInTime,
    PlanNeeded,
    SituationChange,
    TargetOrdered,
    TargetReleased,
)
from heronry_manager.core.situation.held_script import HeldScript
from heronry_manager.core.situation.known_situation import KnownSituation
from heronry_manager.core.situation.latched_faults import HELD_CODE, OPERATOR_CODE, LatchedFault
from heronry_manager.core.situation.radio_links import LinkRecord

__all__ = [
    "HELD_CODE",
    "OPERATOR_CODE",
    "Changes",
    "Fact",
    "HeldScript",
    "KnownSituation",
    "LatchedFault",
    "LimitChanged",
    "LinkRecord",
    "ModuleReleased",
    "PeSuspected",
    "PlanInTime",
    "PlanNeeded",
    "SituationChange",
    "TargetOrdered",
    "TargetReleased",
]
