"""Times of the protocol: every period, limit and cadence that both sides, the tools and the documents use.

Each time stands here once. `period_ns` is always the heartbeat period of the bus in question, as the spec gives it; a
count of periods ends in `_PERIODS`, a time in `_NS`, and a cadence ("every so many of them") in `_EVERY`.

    1 1/4 periods     `late_ns`      a beat has not come in time: a PE is sent PING, a channel is behind
    k + 1/4 periods   `silent_ns`    k beats have not come: a PE is down, a channel is lost
    3 1/4 periods     `unsent_ns`    all frames that a silent PE could still send have been sent by then
    k + 1 periods     `heard_ns`     every node that is alive has been heard, from any begin of listening
    5 periods         `t_lease_ns`   T_lease: how long a PE may drive exclusive outputs without hearing another node

The oracles of the simulator do not use this file: they have numbers of their own (docs/protocol.md, "Times"), so that a
wrong number in a core is found, and a test compares the two. Times of one driver or one measurement alone (the patience
of a transmit queue, the window of a radio's outage) stand there.
"""

USUAL_HEARTBEAT_NS = 20_000_000
"""Heartbeat period if a spec gives none, or no spec is known."""

USUAL_MISSES = 3
"""Beats that a PE may miss before it is down, if a spec gives no number."""

LEASE_PERIODS = 5
"""T_lease."""

IDENTIFIER_PERIODS = 2
"""How long after hearing another node a PE may send under identifiers that other PEs may use as well."""

UNSENT_PERIODS = 3
"""Silent periods of the slowest bus, and a quarter, after which no frame of a PE is on its way any more."""

HOLD_DOWN_PERIODS = 10
"""How long a lost PE, channel or radio must be heard without a gap before it is available again."""

LONGEST_HOLD_DOWN_NS = 60_000_000_000
"""The hold-down doubles with each loss, up to this."""

FORGIVEN_AFTER_NS = 60_000_000_000
"""A loss that is longer ago does not double the hold-down."""

START_UP_WINDOW_NS = 5_000_000_000
"""How long a manager waits for PEs that it has never heard."""

PATIENCE_PERIODS = 25
"""Time limit for one answer of a PE; a PE that sends no frame at all is declared down long before."""

PLAN_AGAIN_NS = 1_000_000_000
"""After a failure of the planner, the manager repeats the request."""

STATE_PAGE_1_EVERY = 10
"""Page 1 of a state goes out with every tenth page 0, and on change."""

ANNOUNCED_EVERY = 5
"""With every fifth beat a manager repeats one of the facts that the standby manager has to know."""

LEARNS_LEASES = 10
"""T_leases in which a manager learns the facts of the other one: so many facts are sent in that time."""

CANOPEN_HEARTBEAT_NS = 1_000_000_000
"""CANopen heartbeat, of a manager, and of a PE at power-on."""

FRESH_PERIODS = 3
"""Periods of its source after which a datum counts as absent for a step."""

FAULT_QUIET_NS = 1_000_000_000
"""How long an acknowledged fault that is found again is not reported."""

CHANNEL_REPORT_NS = 1_000_000_000
"""Period in which a lost channel is reported again."""

CHANNEL_FORGOTTEN_NS = 3 * CHANNEL_REPORT_NS + CHANNEL_REPORT_NS // 2
"""A channel that a PE has not reported for so long is back: three reports may be lost."""

RADIO_WINDOW_PERIODS = 10
"""Periods of a radio over which its gateway measures it."""

RADIO_QUICK_PERIODS = 2
"""Last periods that count alone where they are far worse."""


def late_ns(period_ns: int) -> int:
    """Time after the last beat at which the next one is late: a period and a quarter."""
    return silent_ns(period_ns, 1)


def silent_ns(period_ns: int, misses: int) -> int:
    """Time after the last beat at which `misses` beats have been missed: those periods, and a quarter."""
    return period_ns * misses + slack_ns(period_ns)


def unsent_ns(period_ns: int) -> int:
    """Time after the last frame of a PE at which none is on its way any more; `period_ns`: of the slowest bus."""
    return silent_ns(period_ns, UNSENT_PERIODS)


def heard_ns(period_ns: int, misses: int) -> int:
    """Time within which every node that is alive is heard, though it may have missed `misses` beats."""
    return period_ns * (misses + 1)


def slack_ns(period_ns: int) -> int:
    """How far from its due time a beat may come and still count as in time."""
    return period_ns // 4


def t_lease_ns(period_ns: int) -> int:
    """T_lease on a bus with this period."""
    return LEASE_PERIODS * period_ns
