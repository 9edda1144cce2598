"""Times of the protocol: every period, limit and cadence that both sides, the tools and the documents use.

Each time stands here once. `period_ns` is always the heartbeat period of a bus, as the spec gives it. How a name ends
tells what it is:

    _PERIODS   a number of periods
    _NS        a time
    _EVERY     something happens with one frame out of this number

A *beat* is a frame that a node sends in every period: the state of a PE, the LEASE of a manager. These times count from
the last beat of a node. k is the number of beats that a node may miss, as the spec gives it.

    1 1/4 periods     `late_ns`      the next beat is late: the manager sends PING to a PE; on a replicated bus, a
                                     channel without this beat counts as failed for the frames of the beat's identifier
    k + 1/4 periods   `silent_ns`    k beats have not come: a PE is down, a channel is lost
    3 1/4 periods     `unsent_ns`    no frame of a silent PE can be on its way any more

These times count from another event:

    k + 1 periods     `heard_ns`     after a node began to listen: it has heard every node that is alive
    5 periods         `t_lease_ns`   T_lease: how long a PE may drive exclusive outputs without hearing another node

The oracles of the simulator do not use this file. They have numbers of their own (docs/protocol.md, "Times"), so that
they find a wrong number in a core; a test compares both sets of numbers. A time that only one file uses (the patience
of a transmit queue, the window of a radio's outage) is defined in that file.
"""

USUAL_HEARTBEAT_NS = 20_000_000
"""Heartbeat period where a spec gives none, or where there is no spec."""

USUAL_MISSES = 3
"""Beats that a PE may miss before it is down, if a spec gives no number."""

LEASE_PERIODS = 5
"""T_lease, in heartbeat periods."""

IDENTIFIER_PERIODS = 2
"""Periods after a frame of another node in which a PE may send under identifiers that other PEs may also use."""

UNSENT_PERIODS = 3
"""Periods of the slowest bus after which no frame of a silent PE is on its way any more; `unsent_ns` adds a quarter."""

HOLD_DOWN_PERIODS = 10
"""How long a lost PE, channel or radio must be heard without a gap before it is available again."""

LONGEST_HOLD_DOWN_NS = 60_000_000_000
"""Longest hold-down: the hold-down doubles with each loss until it reaches this time."""

FORGIVEN_AFTER_NS = 60_000_000_000
"""After this time without a loss, the next loss no longer doubles the hold-down.

After this time without a failure, a module that was restarted counts as mended, and its restarts count anew.
"""

START_UP_WINDOW_NS = 5_000_000_000
"""How long a manager waits for PEs that it has never heard."""

PATIENCE_PERIODS = 25
"""Time limit, in heartbeat periods, for one answer of a PE. A PE that sends no frame is down long before this limit."""

PLAN_AGAIN_NS = 1_000_000_000
"""Time after a failure of the planner at which the manager repeats its request."""

STATE_PAGE_1_EVERY = 10
"""A PE sends page 1 of its state with every tenth page 0, and when the page changes."""

ANNOUNCED_EVERY = 5
"""With every fifth heartbeat the active manager repeats one of the facts that the standby manager has to know."""

LEARNS_LEASES = 10
"""Time, in multiples of T_lease, in which a standby manager hears all facts that the active manager repeats."""

CANOPEN_HEARTBEAT_NS = 1_000_000_000
"""Period of the CANopen heartbeat of a manager, and of a PE at power-on."""

FRESH_PERIODS = 3
"""Age of a datum, in periods of its source, after which a step treats the datum as absent."""

GATHER_NS = 1_000_000
"""For so long a node may let frames gather before it reads them, while nothing is urgent for it."""

SILENT_PERIODS = 5
"""Periods of its source without a datum after which an input counts as silent, but at least T_lease.

For an output it is the period of its module (`silent_after_ns`).
"""

SILENCE_REPORT_NS = 1_000_000_000
"""Period in which a PE reports again that an input or output is silent."""

FAULT_QUIET_NS = 1_000_000_000
"""For this time after a fault was acknowledged, the PE does not report the same fault again."""

CHANNEL_REPORT_NS = 1_000_000_000
"""Period in which a lost channel is reported again."""

CHANNEL_FORGOTTEN_NS = 3 * CHANNEL_REPORT_NS + CHANNEL_REPORT_NS // 2
"""Time without a report after which a lost channel counts as back, so that three reports may be lost."""

RADIO_WINDOW_PERIODS = 10
"""Number of the radio's heartbeat periods over which its gateway measures the radio."""

RADIO_QUICK_PERIODS = 2
"""Number of last periods whose measurement counts alone if it is at most half of that over RADIO_WINDOW_PERIODS."""


def late_ns(period_ns: int) -> int:
    """Time in ns after the last beat at which the next beat counts as late: 1 1/4 periods."""
    return silent_ns(period_ns, 1)


def silent_ns(period_ns: int, misses: int) -> int:
    """Time in ns after the last beat at which `misses` beats count as missed: (`misses` + 1/4) periods."""
    return period_ns * misses + slack_ns(period_ns)


def unsent_ns(period_ns: int) -> int:
    """Time in ns from the last frame of a silent PE until no frame of that PE can be on its way any more.

    period_ns: heartbeat period of the slowest bus between the PE and the listener.
    """
    return silent_ns(period_ns, UNSENT_PERIODS)


def heard_ns(period_ns: int, misses: int) -> int:
    """Time in ns in which a new listener hears every node that is alive, even if `misses` beats are lost."""
    return period_ns * (misses + 1)


def slack_ns(period_ns: int) -> int:
    """Largest deviation in ns of a beat that is still in time: a quarter of a period."""
    return period_ns // 4


def silent_after_ns(period_ns: int, lease_ns: int) -> int:
    """Time in ns without a datum after which an input or output counts as silent.

    period_ns: period of the source. lease_ns: T_lease of the PE.
    """
    return max(SILENT_PERIODS * period_ns, lease_ns)


def t_lease_ns(period_ns: int) -> int:
    """Return T_lease in ns, for a bus with this heartbeat period."""
    return LEASE_PERIODS * period_ns
