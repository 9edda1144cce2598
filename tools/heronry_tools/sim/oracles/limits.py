"""The limits that docs/protocol.md promises under "Times", repeated for the oracles.

The oracles do not import these numbers from the cores, so that they detect a core that uses other numbers. If
docs/protocol.md changes, this file must change too: a test compares both.
"""

LEASE_PERIODS = 5
"""T_lease, in heartbeat periods."""

CHANNEL_REPORT_NS = 1_000_000_000
"""Time after which a PE reports a lost channel again."""

START_UP_WINDOW_NS = 5_000_000_000
"""Longest time for which a new mastership waits for PEs that were never heard."""

PATIENCE_PERIODS = 25
"""Heartbeat periods after which the manager fails a PE that has not acknowledged a command."""

FRESH_PERIODS = 3
"""Age, in periods of its source, at which a datum counts as absent."""

SILENT_PERIODS = 5
"""Periods of its source without a datum after which an input counts as silent, but at least T_lease."""

SILENCE_REPORT_NS = 1_000_000_000
"""Period in which a PE reports again that an input or output is silent."""

HOLD_DOWN_PERIODS = 10
"""Heartbeat periods of a PE's first hold-down; each loss doubles the next hold-down."""

LONGEST_HOLD_DOWN_NS = 60_000_000_000
FORGIVEN_AFTER_NS = 60_000_000_000
"""Time for which a PE must be available without a gap until its losses are forgotten."""

RADIO_WINDOW_PERIODS = 10
"""Length of the window in which a gateway measures its radio, in heartbeat periods of the radio."""

RADIO_DOUBLINGS = 2
"""How often, at most, the hold-down of a radio whose bandwidth rises again is doubled."""

RADIO_STEPS = (1000, 800, 600, 400, 250, 160, 80, 40, 20, 0)
"""Shares of a radio's bit rate that a manager may plan with, per mille."""

UNPRICED_PERCENT = 10
"""Share of a bus, in per cent, below which forged frames deny nothing where there is a key."""
