"""The reconfigurations of a feed: what changed in each of them, and which functions were silent during it."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

from heronry_manager.events import Adopted, EpochSeen, Reconfigured
from heronry_tools.watch.sentences import sentence_of
from heronry_tools.watch.snapshot import (
    KEPT_RECONFIGURATIONS,
    Outage,
    Place,
    Reconfiguration,
    Snapshot,
    Times,
)

_KEPT_OUTAGES = 200


def done(before: Snapshot, after: Snapshot, event: Adopted | EpochSeen | Reconfigured) -> Snapshot:
    """Return the snapshot `after` with a new reconfiguration at the end of its list.

    An epoch that a manager adopts is listed too, without times and causes, unless it is the last of the list already.

    before: the snapshot with the configuration that ran before the reconfiguration.
    after: the snapshot with the configuration that runs now.
    event: the event that reports the reconfiguration: `reconfigured`, `epoch_seen` or `adopted`.
    """
    if isinstance(event, Adopted) and after.reconfigurations and after.reconfigurations[-1].epoch == event.epoch:
        return after
    times, t_ns = Times() if isinstance(event, Adopted) else Times(**event.times_ns.by_name()), event.t_ns
    known_ns = event.began_ns if isinstance(event, EpochSeen) else 0
    began_ns = known_ns or t_ns - sum(ns for ns in _known(times))
    was, now = _served(before), _served(after)
    known = after.reconfigurations[-1].after if after.reconfigurations else {}
    old, new = _places(before, known), _places(after, known)
    sentence = sentence_of(event)
    one = Reconfiguration(
        number=after.reconfigurations[-1].number + 1 if after.reconfigurations else 1,
        epoch=event.epoch,
        term=after.manager.term,
        began_ns=began_ns,
        done_ns=t_ns,
        times_ns=times,
        causes=event.causes if isinstance(event, Reconfigured) else (),
        sentence="" if sentence is None else sentence[1],
        moved=tuple(sorted(name for name in old.keys() & new.keys() if old[name].pe != new[name].pe)),
        started=tuple(sorted(new.keys() - old.keys())),
        stopped=tuple(sorted(old.keys() - new.keys())),
        lost=tuple(sorted(name for name in was - now if after.functions[name].wanted)),
        unwanted=tuple(sorted(name for name in was - now if not after.functions[name].wanted)),
        gained=tuple(sorted(now - was)),
        kept=tuple(sorted(was & now)),
        outages=tuple(outage for outage in after.outages if began_ns <= outage.from_ns <= t_ns),
        before=old,
        after=new,
    )
    return replace(after, reconfigurations=(*after.reconfigurations[1 - KEPT_RECONFIGURATIONS :], one))


def _known(times: Times) -> tuple[int, ...]:
    parts = (times.detect, times.decide, times.distribute, times.activate)
    return tuple(ns for ns in parts if ns is not None)


def with_outage(snapshot: Snapshot, outage: Outage) -> Snapshot:
    """Return the snapshot with an outage added, or with the end of an outage that is listed already.

    The outage is also added to the reconfiguration that was under way when the outage began.
    """
    known = _merged(snapshot.outages, outage)[-_KEPT_OUTAGES:]
    reconfigurations = tuple(
        replace(one, outages=_merged(one.outages, outage)) if one.began_ns <= outage.from_ns <= one.done_ns else one
        for one in snapshot.reconfigurations
    )
    return replace(snapshot, outages=known, reconfigurations=reconfigurations)


def _merged(outages: tuple[Outage, ...], one: Outage) -> tuple[Outage, ...]:
    others = (other for other in outages if (other.function, other.from_ns) != (one.function, one.from_ns))
    return (*others, one)


def _served(snapshot: Snapshot) -> set[str]:
    return {name for name, function in snapshot.functions.items() if function.served}


def _places(snapshot: Snapshot, known: Mapping[str, Place]) -> Mapping[str, Place]:
    """Return the PE and the mode of each module that runs.

    If they are the same as in `known`, the result is the mapping `known` itself: the many reconfigurations that
    a snapshot keeps then share one mapping.
    """
    found = {
        name: _place(module.pe, module.mode)
        for name, module in snapshot.modules.items()
        if module.pe is not None and module.mode is not None
    }
    return known if found == known else found


_place = lru_cache(Place)
