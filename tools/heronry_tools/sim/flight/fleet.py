"""The PEs of one simulated flight: they start, die, restart, are cut off, and may get the table of another spec."""

import hashlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from random import Random
from typing import Any

from heronry_agent.core.authority import Secret
from heronry_agent.core.vocabulary import ModuleEvent
from heronry_tools.aircraft.plant import PlantOfDevices
from heronry_tools.sim.flight.truth import Truth
from heronry_tools.sim.flight.wiring import Wiring
from heronry_tools.sim.oracles.checks import Checks
from heronry_tools.sim.world.clock import Clock
from heronry_tools.sim.world.local_clock import LocalClocks
from heronry_tools.sim.world.simulated_blank import SimulatedBlank
from heronry_tools.sim.world.simulated_loader import CodeDisk, SimulatedLoader, active_code
from heronry_tools.sim.world.simulated_pe import SimulatedPe
from heronry_wire.authentication import Key
from heronry_wire.pe_table import PeTable

_CLOCKS_APART_NS = 1_000_000_000
_OTHER_DIGEST = "0" * 64


class Fleet:
    """All PEs of a flight; `running` has those that are alive, by name."""

    def __init__(
        self,
        clock: Clock,
        clocks: LocalClocks,
        wiring: Wiring,
        world: PlantOfDevices,
        *,
        tables: Mapping[str, PeTable],
        checks: Checks,
        truth: Truth,
        seed: int,
        key: Key | None,
        absent: Collection[str],
        has_loaders: bool = False,
        may_change: bool = False,
    ) -> None:
        """Create the PEs, without starting one.

        tables: the table of each PE
        key: the key of managers and PEs; None without authentication
        absent: PEs that only `arrive` starts
        has_loaders: whether PEs take code over the bus
        may_change: whether the flight has a reload: PEs may get the tables of another spec
        """
        self.running: dict[str, SimulatedPe] = {}
        self.blanks: dict[str, SimulatedBlank] = {}  # nodes that wait for their table, by the name of their PE
        self.broken_modules: dict[str, str] = {}  # by module or NAME@PE: how it fails, or which phase it requests
        self.tables = tables
        self._kept: dict[str, PeTable] = {}  # the table by which a PE flew last, if it was brought in flight
        self._may_change = may_change
        self._clock, self._clocks = clock, clocks
        self._wiring, self._world = wiring, world
        self._checks, self._truth = checks, truth
        self._seed, self._key = seed, key
        self._absent = set(absent)
        self._stale: set[str] = set()  # PEs with the table of another spec
        self._blank: set[str] = set()  # PEs that start without a table
        self._lacking: dict[str, set[str]] = {pe: set() for pe in tables}  # modules whose code is missing
        self._other_code: dict[str, set[str]] = {pe: set() for pe in tables}  # images in another version
        self._incarnations = dict.fromkeys(tables, 0)
        self._code_disks = {pe: CodeDisk() for pe in tables} if has_loaders else {}
        for pe in tables:
            truth.failed(f"pe:{pe}")

    @property
    def data_identifiers(self) -> list[int]:
        """Return the identifiers of all data of the spec."""
        return sorted(source.identifier for source in next(iter(self.tables.values())).sources)

    def kill(self, pe: str) -> None:
        """Let a PE die now; no effect on a dead PE."""
        waiting = self.blanks.pop(pe, None)
        if waiting is not None:
            waiting.stop()
        dead = self.running.pop(pe, None)
        if dead is not None:
            dead.stop()
            self._checks.pe_died(pe)
            self._truth.failed(f"pe:{pe}")

    def restore(self, pe: str) -> None:
        """Start a PE as a new incarnation with a new clock; no effect on a PE that runs or is absent."""
        if pe in self.running or pe in self.blanks or pe in self._absent:
            return
        self._incarnations[pe] += 1
        if pe in self._blank:
            self._wait(pe)
        else:
            self._fly(pe)

    def _wait(self, pe: str) -> None:
        """Start a node without a table; when it has taken one, the PE flies with it."""

        def took(table: PeTable) -> None:
            del self.blanks[pe]
            self._kept[pe] = table
            self._checks.took_table(self._clock.now_ns, pe, table)
            self._fly(pe)

        self.blanks[pe] = SimulatedBlank(
            self._clock,
            self._clocks.draw(_CLOCKS_APART_NS),
            self.tables[pe],
            self._wiring.wires,
            secret=self._secret(pe),
            witness=self._checks.copied,
            came=lambda received: self._checks.table_came(self._clock.now_ns, pe, received),
            took=took,
        )

    def _fly(self, pe: str) -> None:
        self._truth.mended(f"pe:{pe}")
        if pe not in self._stale:
            self._truth.is_back(f"pe:{pe}")
        self.running[pe] = SimulatedPe(
            self._clock,
            self._clocks.draw(_CLOCKS_APART_NS),
            self._table(pe),
            self._wiring.wires,
            incarnation=self._incarnations[pe] % 256,
            secret=self._secret(pe),
            world=self._world,
            drive=self._checks.driven,
            look=self._checks.looked,
            withheld=self._checks.withheld,
            state=self._checks.state_seen,
            move=self._checks.moved,
            broken=self.broken_modules,
            broke=lambda module: self._truth.broke(module, pe),
            witness=self._checks.copied,
            lacks=frozenset(self._lacking[pe]),
            other_code=self._other_code[pe],
            loader=partial(self._loader, pe) if pe in self._code_disks else None,
            **(self._of_change(pe) if self._may_change else {}),
        )

    def _of_change(self, pe: str) -> dict[str, Any]:
        """Return what a PE tells in a flight with a reload."""
        checks, clock = self._checks, self._clock

        def switched(table: PeTable) -> None:
            self._kept[pe] = table
            checks.flies(clock.now_ns, pe, table)

        def took(table: PeTable) -> None:
            checks.took_table(clock.now_ns, pe, table)
            checks.pe_died(pe)
            self._kept[pe] = table
            self._stale.discard(pe)
            self._incarnations[pe] += 1
            self._fly(pe)

        if pe not in self._stale:
            checks.flies(clock.now_ns, pe, self._table(pe))
        return {
            "switched": switched,
            "took": took,
            "stepped": lambda module: checks.stepped(clock.now_ns, pe, module),
        }

    def arrive(self, pe: str) -> None:
        """Start a PE, even if it has been absent so far; no effect on a PE that runs."""
        self._absent.discard(pe)
        self.restore(pe)

    def make_stale(self, pe: str) -> None:
        """Let a PE start with the table of another spec next time.

        From now on the PE counts as down, since it can run nothing with that table.
        """
        self._stale.add(pe)
        self._truth.failed(f"pe:{pe}")

    def make_fresh(self, pe: str) -> None:
        """Let a PE use the right table again from its next start on; this ends `make_stale`."""
        self._stale.discard(pe)

    def make_blank(self, pe: str) -> None:
        """Let a PE start without a table from now on, each time; while it waits it counts as down."""
        self._blank.add(pe)

    def lacks(self, pe: str, module: str) -> None:
        """Remove the code of a module from a PE."""
        disk = self._code_disks.get(pe)
        if disk is not None and active_code(disk) is not None:
            return  # its bundle holds the code of every module
        self._lacking[pe].add(module)
        self._checks.lacks_code(self._clock.now_ns, pe, module)
        self._truth.lacks(module, pe)
        if pe in self.running:
            self.running[pe].lack(module)

    def change_code(self, pe: str, module: str) -> None:
        """Put another version of a module's code on a PE: the module runs it there from its next start on."""
        self._other_code[pe].add(self._image(pe, module))

    def put_back_code(self, pe: str, module: str) -> None:
        """Put the present version of a module's code back on a PE: the module runs it from its next start on."""
        self._other_code[pe].discard(self._image(pe, module))

    def _image(self, pe: str, module: str) -> str:
        return next(entry.image for entry in self.tables[pe].modules if entry.name == module)

    def waits_for_code(self) -> list[str]:
        """Return the PEs that run, lack code, and have a loader by which it may come."""
        return [pe for pe in self._code_disks if pe in self.running and self._lacking[pe]]

    def code_brought(self, pe: str) -> None:
        """Note that a manager says that code has come to a PE; if its disk has it, the faults that its lack was end."""
        if not self._checks.code_brought(self._clock.now_ns, pe, active_code(self._code_disks[pe])):
            return
        modules, self._lacking[pe] = self._lacking[pe], set()
        for module in modules:
            self._truth.has_code(self._clock.now_ns, module, pe)

    def _loader(self, pe: str, give: Callable[[ModuleEvent], None]) -> SimulatedLoader:
        """Start the loader of a PE from what its disk has."""

        def came(content: bytes) -> frozenset[str]:
            self._checks.code_came(self._clock.now_ns, pe, content)
            return frozenset(entry.image for entry in self.tables[pe].modules if entry.name in self._lacking[pe])

        chance = Random(f"{self._seed} {pe} {self._incarnations[pe]}")
        return SimulatedLoader(self._clock, self._code_disks[pe], chance, give, came)

    def cut(self, pe: str) -> None:
        """Break the wires of a running PE, or of a node that waits in its place; no effect on a dead PE."""
        node = self.running.get(pe) or self.blanks.get(pe)
        if node is not None:
            node.wire(cut_off=True)
            self._truth.cut(f"pe:{pe}")

    def mend(self, pe: str) -> None:
        """Repair the wires of a PE that was cut off."""
        node = self.running.get(pe) or self.blanks.get(pe)
        if node is not None:
            node.wire(cut_off=False)
        self._truth.mended(f"pe:{pe}")

    def _table(self, pe: str) -> PeTable:
        table = self._kept.get(pe, self.tables[pe]).compiled_form
        return replace(table, spec_digest=_OTHER_DIGEST) if pe in self._stale else table

    def _secret(self, pe: str) -> Secret | None:
        salt = f"{self._seed} {pe} {self._incarnations[pe]}".encode()
        return None if self._key is None else Secret(self._key, hashlib.sha256(salt).digest()[:16])
