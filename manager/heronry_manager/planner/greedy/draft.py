"""A configuration in the making, in which every change can be undone.

A draft holds which modules run (in which mode, on which PE), which producer feeds each leaf, and what is left of every
capacity. These are plain lists of integers, changed in place. Each change is written to a trail; `undo` goes back to a
mark in the trail. So the cost of a try depends only on the changes that the try makes.

How a draft satisfies the rules of docs/semantics.md, section 3:

    1, 4, 7, 8   always: a module is started only where it `fits`, and a wire is made only if the buses have room for it
    2            always: each wire joins a running producer, in a mode that the leaf accepts, to a running consumer
    3            by the caller of `start`, which must wire the needs of the module
    5            by `sweep`
"""

from collections.abc import Callable
from typing import Final

from heronry_manager.planner.greedy.scene import Scene
from heronry_manager.planner.greedy.tables import Tables

_STARTED: Final = 0
_STOPPED: Final = 1
_WIRED: Final = 2
_UNWIRED: Final = 3

Publication = tuple[int, int, int]  # module, variable, bus
MayPublish = Callable[["Draft", list[Publication]], bool]


class Draft:
    """A configuration in the making: the modules that run so far, their wires, and the capacities that are left."""

    __slots__ = (
        "_cpu_of",
        "_flash_of",
        "_kept",
        "_leaves_of",
        "_load",
        "_ram_of",
        "_rivals",
        "_route",
        "_separate",
        "_together",
        "_trail",
        "_variable",
        "bus_room",
        "consumers",
        "cpu",
        "feeder",
        "flash",
        "may_publish",
        "mode",
        "on",
        "pe",
        "published",
        "ram",
        "refused",
        "running",
        "tables",
    )

    def __init__(self, tables: Tables, scene: Scene, may_publish: MayPublish | None = None) -> None:
        """Begin with a draft in which no module runs.

        may_publish: called before each new message on a bus, and may forbid it; None: every message is allowed.
        """
        self.tables = tables
        self.may_publish = may_publish
        self.mode = [-1] * len(tables.numbers.modules)
        self.pe = [-1] * len(tables.numbers.modules)
        self.cpu = list(scene.cpu)  # left, by PE
        self.ram = list(tables.sizes.pe_ram)
        self.flash = list(tables.sizes.pe_flash)
        self.bus_room = list(scene.bus_room)  # left, by bus
        self.on = [0] * len(tables.numbers.pes)  # set of modules
        self.running = 0  # set of modules
        self.feeder = [-1] * len(tables.leaves.mode)  # module that feeds a leaf
        self.consumers: list[dict[int, None]] = [{} for _ in tables.numbers.modules]  # module -> leaves, in order
        self.published: dict[Publication, int] = {}  # number of leaves that read it from there
        self.refused = False  # a bus or a placement rule refused a try: another PE may fit
        self._trail: list[tuple[int, ...]] = []
        self._cpu_of, self._ram_of, self._flash_of = tables.sizes.cpu, tables.sizes.ram, tables.sizes.flash
        self._separate, self._together, self._rivals = tables.rules.separate, tables.rules.together, tables.rules.rivals
        self._route, self._load, self._variable = tables.routes.route, tables.routes.load, tables.leaves.variable
        self._leaves_of = tables.leaves.of_mode
        self._kept = scene.kept  # of modules with a checkpoint: what these take of the buses, by PE

    # The trail

    def mark(self) -> int:
        """Return a mark, with which `undo` comes back to the present state."""
        return len(self._trail)

    def undo(self, mark: int) -> None:
        """Undo all changes since the method `mark` has returned this mark."""
        trail = self._trail
        while len(trail) > mark:
            kind, *what = trail.pop()
            if kind == _STARTED:
                self._leave(what[0])
            elif kind == _STOPPED:
                self._enter(*what)
            elif kind == _WIRED:
                self._unlink(*what)
            else:
                self._link(*what)

    # Running

    def fits(self, module: int, mode: int, pe: int) -> bool:
        """Tell whether a module that is not running may run in a mode on `pe`, one of the `hosts` of the mode.

        There must be room, no placement rule may forbid it, and no rival of the module may run.
        """
        if (
            self._cpu_of[mode] > self.cpu[pe]
            or self._ram_of[mode] > self.ram[pe]
            or self._flash_of[module] > self.flash[pe]
        ):
            return False
        here = self.on[pe]
        if here & self._separate[module] or self._together[module] & self.running & ~here:
            self.refused = True
            return False
        if self._kept and any(load > self.bus_room[bus] for bus, load in self._keeps(module, pe)):
            self.refused = True
            return False
        return not self._rivals[module] & self.running

    def _keeps(self, module: int, pe: int) -> tuple[tuple[int, int], ...]:
        """Return what the checkpoints of a module on `pe` take: (bus, load) for each bus."""
        found = self._kept.get(module)
        return () if found is None else found[pe]

    def start(self, module: int, mode: int, pe: int) -> None:
        """Start a module on a PE where it `fits`; it has no wires yet."""
        self._enter(module, mode, pe)
        self._trail.append((_STARTED, module))

    def stop(self, module: int) -> None:
        """Stop a module; the caller has removed all wires of the module before."""
        self._trail.append((_STOPPED, module, self.mode[module], self.pe[module]))
        self._leave(module)

    def _enter(self, module: int, mode: int, pe: int) -> None:
        self.mode[module] = mode
        self.pe[module] = pe
        self.cpu[pe] -= self._cpu_of[mode]
        self.ram[pe] -= self._ram_of[mode]
        self.flash[pe] -= self._flash_of[module]
        bit = 1 << module
        self.on[pe] |= bit
        self.running |= bit
        if self._kept:
            for bus, load in self._keeps(module, pe):
                self.bus_room[bus] -= load

    def _leave(self, module: int) -> None:
        mode, pe = self.mode[module], self.pe[module]
        self.mode[module] = self.pe[module] = -1
        self.cpu[pe] += self._cpu_of[mode]
        self.ram[pe] += self._ram_of[mode]
        self.flash[pe] += self._flash_of[module]
        bit = 1 << module
        self.on[pe] ^= bit
        self.running ^= bit
        if self._kept:
            for bus, load in self._keeps(module, pe):
                self.bus_room[bus] += load

    # Wires

    def wire(self, leaf: int, consumer: int, producer: int) -> bool:
        """Wire a leaf of a running module to a running producer whose mode the leaf accepts.

        False: a bus has no room, or `may_publish` forbids a new message.
        """
        route = self._route[self.pe[producer]][self.pe[consumer]]
        if route and not self._room_on(route, producer, self._variable[leaf]):
            self.refused = True
            return False
        self._link(leaf, consumer, producer)
        self._trail.append((_WIRED, leaf, consumer, producer))
        return True

    def unwire(self, leaf: int, consumer: int) -> None:
        """Remove the wire to a leaf of `consumer`; the leaf must be wired."""
        producer = self.feeder[leaf]
        self._trail.append((_UNWIRED, leaf, consumer, producer))
        self._unlink(leaf, consumer, producer)

    def _room_on(self, route: tuple[int, ...], producer: int, variable: int) -> bool:
        published, bus_room = self.published, self.bus_room
        new = [bus for bus in route if (producer, variable, bus) not in published]
        if not new:
            return True
        load = self._load[variable][self.mode[producer]]
        if any(load > bus_room[bus] for bus in new):
            return False
        return self.may_publish is None or self.may_publish(self, [(producer, variable, bus) for bus in new])

    def _link(self, leaf: int, consumer: int, producer: int) -> None:
        self.feeder[leaf] = producer
        self.consumers[producer][leaf] = None
        route = self._route[self.pe[producer]][self.pe[consumer]]
        if route:
            variable, published = self._variable[leaf], self.published
            for bus in route:
                key = (producer, variable, bus)
                if key in published:
                    published[key] += 1
                else:
                    published[key] = 1
                    self.bus_room[bus] -= self._load[variable][self.mode[producer]]

    def _unlink(self, leaf: int, consumer: int, producer: int) -> None:
        self.feeder[leaf] = -1
        del self.consumers[producer][leaf]
        route = self._route[self.pe[producer]][self.pe[consumer]]
        if route:
            variable, published = self._variable[leaf], self.published
            for bus in route:
                key = (producer, variable, bus)
                if published[key] == 1:
                    del published[key]
                    self.bus_room[bus] += self._load[variable][self.mode[producer]]
                else:
                    published[key] -= 1

    # Larger changes

    def drop_inputs(self, module: int) -> None:
        """Remove all wires to a module."""
        feeder = self.feeder
        for leaf in self._leaves_of[self.mode[module]]:
            if feeder[leaf] >= 0:
                self.unwire(leaf, module)

    def move(self, module: int, pe: int) -> bool:
        """Move a running module with all its wires to another PE; False: it does not fit, and nothing has changed."""
        mark, mode = self.mark(), self.mode[module]
        ends = [(leaf, module, self.feeder[leaf]) for leaf in self._leaves_of[mode] if self.feeder[leaf] >= 0]
        leaf_module = self.tables.leaves.module
        ends += [(leaf, leaf_module[leaf], module) for leaf in self.consumers[module] if leaf_module[leaf] != module]
        for leaf, consumer, _ in ends:
            self.unwire(leaf, consumer)
        self.stop(module)
        if self.fits(module, mode, pe):
            self.start(module, mode, pe)
            if all(self.wire(leaf, consumer, producer) for leaf, consumer, producer in ends):
                return True
        self.undo(mark)
        return False

    def sweep(self, outputs: int) -> None:
        """Stop all modules that serve no function (semantics rule 5).

        A module serves if it is one of `outputs`, or if its data reach a running module of `outputs` over wires.

        outputs: the set of the output modules of functions, as bits by number of the module.
        """
        mode, feeder, leaves_of = self.mode, self.feeder, self._leaves_of
        serving = frontier = self.running & outputs
        while frontier:
            low = frontier & -frontier
            frontier ^= low
            for leaf in leaves_of[mode[low.bit_length() - 1]]:
                producer = feeder[leaf]
                if producer >= 0 and not serving >> producer & 1:
                    serving |= 1 << producer
                    frontier |= 1 << producer
        idle = left = self.running & ~serving
        while left:  # first all wires: idle modules may feed each other
            low = left & -left
            left ^= low
            self.drop_inputs(low.bit_length() - 1)
        while idle:
            low = idle & -idle
            idle ^= low
            self.stop(low.bit_length() - 1)
