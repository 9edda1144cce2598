"""Which messages must not be published together, because one of them could then miss its deadline (rule 9).

The response-time analysis names, for each late message, all that it depends on. That set is shrunk here, one message
after the other, to one that is still late: the smaller the set, the more plans its cut rules out at once, and the fewer
searches are needed. Leaving a message out makes no other one later, so what is late in a set is late in every larger
one (a message that comes from farther away counts as larger, too: it brings more jitter).
"""

from collections.abc import Iterable

from heronry_dg.response_times import ResponseTimes
from heronry_dg.traffic import Hop


def deadline_conflicts(times: ResponseTimes, published: Iterable[Hop]) -> list[frozenset[Hop]]:
    """Return sets of published hops that miss a deadline together; none when all deadlines are met."""
    conflicts: list[frozenset[Hop]] = []
    for late in times.late(published):
        if not any(known <= late.causes for known in conflicts):
            conflicts.append(_shrunk(times, late.hop, late.causes))
    return conflicts


def _shrunk(times: ResponseTimes, late: Hop, causes: frozenset[Hop]) -> frozenset[Hop]:
    """Leave out source after source, the least urgent first, as long as the message stays late."""
    kept = causes
    urgency = {hop: times.identifiers[hop.producer, hop.variable] for hop in causes}
    sources = dict.fromkeys((hop.producer, hop.variable) for hop in sorted(causes, key=lambda hop: -urgency[hop]))
    sources.pop((late.producer, late.variable))
    for source in sources:
        fewer = frozenset(hop for hop in kept if (hop.producer, hop.variable) != source)
        if any(still.hop == late for still in times.late(fewer)):
            kept = fewer
    return kept
