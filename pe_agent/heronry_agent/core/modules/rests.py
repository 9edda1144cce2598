"""Which branches of DEMUXes have stopped, while their devices have not come to rest yet.

A device with a process of its own takes its safe action a moment after StopModule, or much later if it is slow, hangs
or has to be started again. Until then another branch must not move:

    driving   the module runs, or ran and its device has come to rest; nothing is known of it here
    moving    the module was stopped, and AtRest has not come. Meanwhile page 0 reports the configuration that this PE
              had before (`condition`), so that the manager counts the branch as held, as if BREAK had not come yet; and
              a branch that began meanwhile on this PE is not stepped
    at rest   AtRest has come, or the module runs again, or T_lease has passed: for longer no PE is waited for that may
              drive something exclusive, and a device that hangs may never come to rest. That is noted in the log

When another table takes the place of the one that flies, a device whose module this PE does not have in it is waited
for T_lease, since its AtRest names no module any more.

A late or doubled AtRest changes nothing. A restart of the agent forgets all: its devices begin with the safe action.
"""

from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_wire.sansio import NEVER_NS

_GONE = -1  # stands for the modules that the table which flies does not have on this PE


class Rests:
    """Knows the stopped modules of one PE whose devices still move."""

    def __init__(self, turn: Turn, index: TableIndex) -> None:
        """Begin with devices that are at rest when StopModule has been executed."""
        self._turn, self._index = turn, index
        self.slow: frozenset[int] = frozenset()  # modules whose StopModule AtRest answers
        self._moving: dict[int, int] = {}  # until when each is waited for
        self._waiting: set[int] = set()  # branches that began meanwhile

    @property
    def next_ns(self) -> int:
        """Time in ns at which to call `tick`, if no event comes before."""
        return min(self._moving.values(), default=NEVER_NS)

    @property
    def are_due(self) -> bool:
        """Tell whether a device still moves."""
        return bool(self._moving)

    def hold_back(self, module: int) -> bool:
        """Tell whether a module has to wait, because it began while another device still moved."""
        return module in self._waiting

    def stopped(self, module: int, *, keep: bool = False) -> None:
        """Note that a module is stopped; with `keep` it goes on in another mode, and its device may move until then."""
        if module in self.slow and not keep:
            self._moving[module] = self._turn.now_ns + self._index.lease_ns

    def began(self, module: int) -> None:
        """Note that a module begins."""
        self.came(module)
        if self._moving:
            self._waiting.add(module)

    def came(self, module: int) -> None:
        """Note that a device is at rest, or is driven again; after the last one, page 0 reports what was held back."""
        if self._moving.pop(module, None) is not None and not self._moving:
            self._waiting.clear()
            self._turn.wants_page_0 = True

    def carry_over(self, carried: CarriedOver) -> None:
        """Take the indices of another table, whose contents the index has now; the caller sets which are `slow`."""
        named, moving = carried.named_modules, self._moving
        self._moving = {}
        for module, until_ns in moving.items():
            now = named.get(module, _GONE)
            now = now if now in self._index.modules else _GONE
            self._moving[now] = max(until_ns, self._moving.get(now, until_ns))
        self._waiting = {named[module] for module in self._waiting if module in named}

    def tick(self) -> None:
        """Wait no longer for devices that have not come to rest in time."""
        for module in [module for module, until_ns in self._moving.items() if self._turn.now_ns >= until_ns]:
            if module != _GONE:
                name = self._index.modules[module].name
                self._turn.note("output", f"the device of module {name} does not come to rest")
            self.came(module)
