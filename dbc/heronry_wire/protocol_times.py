"""Times of the protocol: every period, limit and cadence that both sides, the tools and the documents count with.

Each time stands here once. `period_ns` is always the heartbeat period of the bus in question, as the spec gives it; a
count of periods ends in `_PERIODS`, a time in `_NS`, and a cadence ("every so many of them") in `_EVERY`.

    1 1/4 periods     `late_ns`      a beat has not come in time: a PE is asked, a channel is behind
    k + 1/4 periods   `silent_ns`    so many beats have not come: a PE is down, a channel is lost
    3 1/4 periods     `unsent_ns`    what a silent PE could still send has been sent by then
    k + 1 periods     `heard_ns`     whoever lives has been heard, whenever one began to listen
    5 periods         `t_lease_ns`   T_lease: for so long may one drive, unheard, what is exclusive

The judges of the simulator take nothing from here: they have numbers of their own (docs/protocol.md, "Times"), so that
a core that takes another one is found out, and a test compares the two. What belongs to one driver or one measurement
alone (the patience of a transmit queue, the window of a radio's outage) stands where that is.
"""

USUAL_HEARTBEAT_NS = 20_000_000
"""Heartbeat period where a spec says nothing, or where no spec is known."""

USUAL_MISSES = 3
"""Beats that a PE may miss before it is down, where a spec says nothing."""

LEASE_PERIODS = 5
"""T_lease."""

IDENTIFIER_PERIODS = 2
"""For so long after another node was heard may identifiers be used that others may use as well."""

UNSENT_PERIODS = 3
"""Silent periods of the slowest bus after which nothing of a PE is on its way any more; and a quarter."""

HOLD_DOWN_PERIODS = 10
"""Without a gap, before who was lost (a PE, a channel, a radio) is counted on again."""

LONGEST_HOLD_DOWN_NS = 60_000_000_000
"""The hold-down doubles with each loss, up to this."""

FORGIVEN_AFTER_NS = 60_000_000_000
"""A loss so long ago no longer doubles it."""

START_UP_WINDOW_NS = 5_000_000_000
"""For so long a manager waits for PEs that it has never heard."""

PATIENCE_PERIODS = 25
"""For one answer of a PE; one that is silent altogether is declared down long before."""

PLAN_AGAIN_NS = 1_000_000_000
"""After the planner has failed, the same is asked again."""

STATE_PAGE_1_EVERY = 10
"""Page 1 of a state goes out with every tenth page 0, and on change."""

ANNOUNCED_EVERY = 5
"""With every fifth beat a manager repeats one of the facts that a standby has to know."""

LEARNS_LEASES = 10
"""T_leases in which what another manager holds is learnt: so many facts are told meanwhile."""

CANOPEN_HEARTBEAT_NS = 1_000_000_000
"""CANopen heartbeat, of a manager, and of a PE at power-on."""

FRESH_PERIODS = 3
"""Of its source: an older datum is absent when a step is asked for."""

FAULT_QUIET_NS = 1_000_000_000
"""For so long is an acknowledged fault that is found again not told."""

CHANNEL_REPORT_NS = 1_000_000_000
"""So often is a lost channel told of again."""

CHANNEL_FORGOTTEN_NS = 3 * CHANNEL_REPORT_NS + CHANNEL_REPORT_NS // 2
"""Who has not told of a lost channel for so long has it again: three reports may be lost."""

RADIO_WINDOW_PERIODS = 10
"""Over the last so many periods of a radio its gateway measures it."""

RADIO_QUICK_PERIODS = 2
"""The last so many alone, where they are far worse."""


def late_ns(period_ns: int) -> int:
    """How long after the last beat the next one is late: a period and a quarter."""
    return silent_ns(period_ns, 1)


def silent_ns(period_ns: int, misses: int) -> int:
    """How long after the last beat so many have been missed: those periods, and a quarter."""
    return period_ns * misses + slack_ns(period_ns)


def unsent_ns(period_ns: int) -> int:
    """How long after its last word nothing of a PE is on its way any more; the period is that of the slowest bus."""
    return silent_ns(period_ns, UNSENT_PERIODS)


def heard_ns(period_ns: int, misses: int) -> int:
    """Within which time whoever lives is heard, though it may have missed so many beats."""
    return period_ns * (misses + 1)


def slack_ns(period_ns: int) -> int:
    """How far from its instant a beat may come and still count as in time."""
    return period_ns // 4


def t_lease_ns(period_ns: int) -> int:
    """T_lease on a bus with this period."""
    return LEASE_PERIODS * period_ns
