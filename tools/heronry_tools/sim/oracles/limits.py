"""Limits that are promised, as the oracles know them: their own numbers, so that a core with others is found out.

They are those of docs/protocol.md, "Times". A change there must be made here, too: a test compares them.
"""

LEASE_PERIODS = 5
"""T_lease, in heartbeat periods."""

CHANNEL_REPORT_NS = 1_000_000_000
"""Time after which a PE reports a lost channel again."""

START_UP_WINDOW_NS = 5_000_000_000
"""Longest time for which a new mastership waits for PEs that were never heard."""

PATIENCE_PERIODS = 25
"""Heartbeat periods after which a PE that has not acknowledged is failed."""

FRESH_PERIODS = 3
"""Periods of its source after which a datum is absent."""

HOLD_DOWN_PERIODS = 10
"""Heartbeat periods for which a PE that is heard again is not available; after each loss twice as many."""

LONGEST_HOLD_DOWN_NS = 60_000_000_000
FORGIVEN_AFTER_NS = 60_000_000_000
"""Time after which the losses of a PE that has been available throughout are forgotten."""

RADIO_WINDOW_PERIODS = 10
"""Heartbeat periods of a radio over which its gateway measures it."""

RADIO_DOUBLINGS = 2
"""How often the hold-down of a radio that gives more again is doubled, at most."""

RADIO_STEPS = (1000, 800, 600, 400, 250, 160, 80, 40, 20, 0)
"""Shares of a radio's bit rate that are planned with, per mille."""
