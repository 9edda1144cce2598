"""The lines of JSON that a feed has in addition to the manager's events; a feed is what a snapshot is made from.

The manager's events are those of `heronry_manager.core.events`. The additional lines have the same form:

    status, runs, lines_lost    from the manager's driver, to a reader of its events (`follow`)
    resumed                     begins a file of a recording
    feed                        begins a feed
    all other kinds             from the frames of a bus, live or recorded

A reader ignores a kind that it does not know.
"""

from collections.abc import Mapping
from typing import Any

VERSION = 1

OBSERVATIONS: Mapping[str, str] = {
    "status": "status (as 'heronry status --json'), plan (or null), bus (interface, channel): where a reader begins",
    "runs": "epoch, plan: the plan of an epoch that runs from now on",
    "lines_lost": "lines: so many lines were dropped, because this reader was too slow; a new status follows",
    "resumed": "snapshot, plan: everything so far, where older files of a recording may be gone",
    "feed": "source, knows_why, spec, spec_digest: the first line of every feed",
    "bus_seen": "bus, load, peak, bits_per_s, frames_per_s, errors, error_state: the traffic of the last second",
    "heard": "pes, functions: the time of the last frame of each, as far as it is new",
    "pe_seen": "pe, incarnation, epoch, runs, hears_manager, load_percent: a state frame says something new",
    "manager_seen": "node, term: LEASE names another manager or term",
    "epoch_seen": "epoch, plan (or null), began_ns, times_ns: all PEs that are heard run this epoch",
}


def observation(kind: str, t_ns: int, **data: Any) -> dict[str, Any]:
    """Build one observation; raises KeyError for a kind that is not in OBSERVATIONS."""
    _ = OBSERVATIONS[kind]
    return {"v": VERSION, "t_ns": t_ns, "event": kind, **data}
