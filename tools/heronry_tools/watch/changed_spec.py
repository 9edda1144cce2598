"""A view goes on when the aircraft has changed to another spec in flight."""

from dataclasses import replace

from heronry_tools.watch.reducer import Reducer, State


def goes_on(before: State, reducer: Reducer) -> State:
    """Return the state with which a view goes on; it keeps what was told.

    before: what the view has shown, of the spec before. reducer: that of the spec that flies now.
    """
    old, state = before.snapshot, reducer.start(before.snapshot.source)
    kept = replace(state.snapshot, events=old.events, told=old.told, t_ns=old.t_ns, began_ns=old.began_ns)
    return replace(state, snapshot=kept)
