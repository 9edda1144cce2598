"""A page that applies every change holds what the snapshot says."""

import json
from itertools import pairwise

from heronry_tools.watch.reducer import Reducer
from heronry_tools.web.changes import change, plain
from web.flight import big_blue, flown


def as_sent(value):
    return json.loads(json.dumps(value))


def applied(known, sent):
    """What `page/store.js` does."""
    known = {**known, **sent["set"]}
    for name, entries in sent["merge"].items():
        known[name] = {**known[name], **entries}
    for part, entries in sent["graph"].items():
        known["graph"] = {**known["graph"], part: {**known["graph"][part], **entries}}
    for name, most in (("told", 500), ("reconfigurations", 100)):
        if name in sent:
            numbered = {one["number"]: one for one in [*known[name], *sent[name]]}
            known[name] = [numbered[number] for number in sorted(numbered)][-most:]
    return known


def snapshots():
    reducer = Reducer(big_blue())
    state = reducer.start("simulator")
    yield state.snapshot
    for event in flown():
        state = reducer.after(state, event)
        yield state.snapshot


def test_all_changes_of_a_flight_lead_to_its_last_snapshot():
    every = list(snapshots())
    assert len(every[-1].reconfigurations) >= 4
    known = as_sent(plain(every[0]))
    for before, after in pairwise(every):
        known = applied(known, as_sent(change(before, after)))
        assert known["graph"] == plain(after.graph)
    assert known == as_sent(plain(every[-1]))


def test_one_change_may_leave_out_what_was_between():
    every = list(snapshots())
    for at in range(0, len(every), 25):
        known = as_sent(plain(every[at]))
        assert applied(known, as_sent(change(every[at], every[-1]))) == as_sent(plain(every[-1]))


def test_what_is_the_same_is_not_sent():
    last = list(snapshots())[-1]
    assert change(last, last) == {"set": {}, "merge": {}, "graph": {}}
