"""The newest whole state of each module that may run on this PE, and the states that this PE forwards as a gateway.

A state is *heard* if each frame of its round has come from a possible PE of the module. A PE to which no bound of the
response time is known (`late_ns` of the table) keeps no heard state, since its age would be unknown.

A gateway forwards each frame at once to the ports through which other possible PEs are reached that the manager counts
on (ALIVE). Between two PEs there is at most one route, so no frame comes back.
"""

from collections.abc import Collection, Iterator

from heronry_agent.core.vocabulary import KeptState
from heronry_wire.checkpoint_frames import Assembly, SentState, number_of
from heronry_wire.pe_table import CheckpointEntry


class Keeping:
    """Keeps and forwards the states of modules, by index of the module."""

    def __init__(self, entries: Collection[CheckpointEntry], own: Collection[int]) -> None:
        """Begin without a state. `own`: modules that may run on this PE."""
        self._entries = {entry.number: entry for entry in entries}
        self._own = own
        self._assemblies: dict[tuple[int, int], Assembly] = {}  # by number of the module, and sender
        self._kept: dict[int, KeptState] = {}

    def heard(self, node: int, port: int, payload: bytes, arrived_ns: int, *, runs: Collection[int]) -> bool:
        """Take a frame of a PE; returns False if the frame is none of a possible PE on this port.

        arrived_ns: when the frame arrived. runs: modules that run on this PE, whose heard states are not kept.
        """
        entry = self._entries.get(number_of(payload))
        if entry is None or node not in entry.towards[port]:
            return False
        if entry.module not in self._own or entry.module in runs or entry.late_ns is None:
            return True
        key = entry.number, node
        assembly = self._assemblies.get(key)
        if assembly is None:
            assembly = self._assemblies[key] = Assembly(entry.late_ns)
        state = assembly.take(payload, arrived_ns)
        if state is not None:
            self.keep(entry, state, arrived_ns - entry.late_ns)
        return True

    def keep(self, entry: CheckpointEntry, state: SentState, since_ns: int) -> None:
        """Keep a state that was saved at `since_ns` or later, unless the present one is newer; an empty one is none."""
        if not state.data:
            self.discard(entry.module)
            return
        before = self._kept.get(entry.module)
        if before is None or since_ns >= before.since_ns:
            self._kept[entry.module] = KeptState(state, since_ns, since_ns + entry.max_age_ns)

    def of(self, module: int) -> KeptState | None:
        """Return the state of a module; None: there is none."""
        return self._kept.get(module)

    def discard(self, module: int) -> None:
        """Forget the state of a module."""
        self._kept.pop(module, None)

    def ways_on(self, payload: bytes, port: int, alive: frozenset[int]) -> Iterator[tuple[int, int]]:
        """Yield the ports to which a gateway forwards a frame that `heard` has taken from `port`.

        Each is given with the time in ns for which the frame may wait there.

        alive: node-IDs of the PEs on which the manager counts.
        """
        entry = self._entries[number_of(payload)]
        for to, nodes in enumerate(entry.towards):
            if to != port and not alive.isdisjoint(nodes):
                yield to, entry.waits_ns[to]
