"""The standing of a PE: its state as the manager sees it, and the table of changes.

`health` decides on each change.

    WAITING    the manager waits for the PE until the start-up window closes: the PE was not heard yet, or its states
               are not authenticated yet in a new mastership
    UP         heard in time
    SUSPECT    late by a quarter of a heartbeat period, and the manager has sent PING; still available
    DOWN       silent for `misses` heartbeat periods and a quarter, or still WAITING when the window closed, or failed
               by the manager, for example after a reboot
    RETURNING  heard again; available after a hold-down without a gap

A PE is available while it is UP or SUSPECT.
"""

from enum import Enum, auto

from heronry_manager.core.transitions import TransitionTable


class Standing(Enum):
    """State of a PE as the manager sees it; the status shows these values."""

    WAITING = "waiting"
    UP = "up"
    SUSPECT = "suspect"
    DOWN = "down"
    RETURNING = "returning"


class StandingEvent(Enum):
    """Events that change the standing of a PE."""

    HEARD = auto()
    LATE = auto()
    SILENT = auto()
    FAILED = auto()  # or rebooted, barred, beyond a radio that is gone
    WINDOW_CLOSES = auto()
    HOLD_DOWN_ENDS = auto()
    INHERITED = auto()
    AWAITED_AGAIN = auto()
    QUARANTINED = auto()


STANDING_TRANSITIONS = TransitionTable(
    {Standing.WAITING: "start"},
    (
        (Standing.WAITING, StandingEvent.HEARD, Standing.UP, "heard"),
        (Standing.WAITING, StandingEvent.WINDOW_CLOSES, Standing.DOWN, "the start-up window closes"),
        (Standing.WAITING, StandingEvent.SILENT, Standing.DOWN, "a PE that is not authenticated yet falls silent"),
        (Standing.WAITING, StandingEvent.FAILED, Standing.DOWN, "the operator fails it"),
        (
            Standing.WAITING,
            StandingEvent.QUARANTINED,
            Standing.DOWN,
            "it was in quarantine before the manager restarted",
        ),
        (Standing.UP, StandingEvent.LATE, Standing.SUSPECT, "late by a quarter of a period, the manager sends PING"),
        (Standing.UP, StandingEvent.FAILED, Standing.DOWN, "rebooted, failed, or its receiver failed for T_lease"),
        (Standing.SUSPECT, StandingEvent.HEARD, Standing.UP, "heard"),
        (
            Standing.SUSPECT,
            StandingEvent.SILENT,
            Standing.DOWN,
            "silent for (misses + 1/4) periods",
        ),
        (Standing.SUSPECT, StandingEvent.FAILED, Standing.DOWN, "rebooted or failed"),
        (Standing.DOWN, StandingEvent.HEARD, Standing.RETURNING, "heard"),
        (Standing.DOWN, StandingEvent.FAILED, Standing.DOWN, ""),
        (Standing.DOWN, StandingEvent.QUARANTINED, Standing.DOWN, ""),
        (Standing.RETURNING, StandingEvent.HOLD_DOWN_ENDS, Standing.UP, "hold-down is over"),
        (Standing.RETURNING, StandingEvent.INHERITED, Standing.UP, "it was available to the previous manager"),
        (Standing.RETURNING, StandingEvent.SILENT, Standing.DOWN, "silent again"),
        (Standing.RETURNING, StandingEvent.FAILED, Standing.DOWN, "rebooted or failed"),
        *(
            (before, StandingEvent.AWAITED_AGAIN, Standing.WAITING, "a new mastership cannot authenticate it yet")
            for before in (Standing.WAITING, Standing.DOWN, Standing.RETURNING)
        ),
    ),
)
