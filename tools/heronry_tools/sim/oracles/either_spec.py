"""While the aircraft changes to another spec, it flies by the one or by the other, and never by a mixture.

The simulator reports which table each PE has (`flies`), and every step of a module (`stepped`). From these and from
the frames of the managers the oracle verifies:

    whole      A PE has the table of one of the two specs, to the last byte.
    mixture    (1) A module that does not go on starts only when no PE that takes part still runs one of the spec
               before: once one PE has stepped such a module of the spec to which the PEs change, no other PE steps one
               of the other spec. A PE takes part if ALIVE named it when the first step of the change was commanded,
               and as long as ALIVE goes on naming it. (A PE that is lost may run on, but what is exclusive.)
               (2) PEs that ALIVE names fly by one spec, except for a bounded time after an epoch was activated or a
               mastership has begun.
               (3) At the end every PE that ALIVE names flies by the spec of the epoch that was activated last.
    missed     A module whose definition is the same in both specs misses no step from the order on, as long as every
               activated configuration has it on the same PE in the same mode. A gap of more than one and a half
               periods is a missed step. A PE steps no branch of a DEMUX while it hears no ALIVE that names it, and
               with a key from the moment at which it believes the next manager until ALIVE names it again: branches
               are verified only where neither can be so.
    given_up   No epoch of the new spec is activated before it is ordered, nor after a manager has said that it has
               given the change up. If a mastership begins while no PE flies by the new spec, the change is given up.
               (A manager that flies by the new spec since an earlier change may activate any epoch of it.)

Rule `missed` is verified only for flights in which nothing was injected that delays steps (`missed_steps`).
"""

from collections.abc import Collection, Iterator

from heronry_dg.configuration import Configuration
from heronry_tools.recording.commanded import Epoch
from heronry_tools.sim.oracles.flown_spec import FlownSpec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS, PATIENCE_PERIODS, START_UP_WINDOW_NS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.pe_table import PeTable
from heronry_wire.state_frames import PeState

DISTURBS_NO_STEP = frozenset(
    (
        *("crash", "reboot", "mute", "deaf", "cut", "loose", "loss", "omission", "doubled", "burst"),
        *("manager_crash", "manager_power", "manager_pause", "manager_cut", "manager_mute", "manager_deaf"),
        *("manager_loose", "manager_clock_jump", "disk_full"),
    )
)
"""Kinds of faults in whose presence a module goes on with its steps, as long as its PE lives."""

_HEARS_ALL = frozenset(("crash", "reboot", *(kind for kind in DISTURBS_NO_STEP if kind.startswith("manager_"))))
_SECOND_NS = 1_000_000_000
_SOON_PERIODS = 3
_WAITED_NS = 50_000_000
_MHZ_NS = 10**12


class EitherSpecCheck(Oracle):
    """Verifies that the PEs fly by the old spec or by the new one, and that what is the same goes on."""

    def __init__(self, old: FlownSpec, new: FlownSpec, *, has_key: bool = False) -> None:
        """Begin with no PE; `old`: by which the managers start."""
        super().__init__()
        self._exclusive, self._has_key = old.exclusive | new.exclusive, has_key
        self._lease_ns = LEASE_PERIODS * old.spec.buses[old.spec.manager.bus].heartbeat_ns
        self._began_ns: list[int] = []  # when each mastership began
        self._specs = {old.spec.digest: old, new.spec.digest: new}
        self._old, self._new = old.spec.digest, new.spec.digest
        self._same = {pe: old.goes_on(new, pe) for pe in old.tables}
        heartbeat_ns = self._lease_ns // LEASE_PERIODS
        self._named_ns: dict[str, int] = {}  # by PE: when ALIVE named it last
        self._unnamed: list[tuple[str, int, int]] = []  # times (from, to) in which no ALIVE named a PE
        self._soon_ns = _SOON_PERIODS * heartbeat_ns
        self._patience_ns = PATIENCE_PERIODS * heartbeat_ns + _SECOND_NS
        self._flown: dict[str, str] = {}  # by PE that lives: digest of the spec of its table
        self._changed_ns: dict[str, int] = {}  # by PE or station: when it has changed in flight
        self._of_manager: dict[str, str] = {}  # by station of a manager: digest of its spec
        self._runs: set[str] = set()  # PEs that report that they follow an epoch
        self._named: frozenset[str] = frozenset()  # by the last ALIVE
        self._is_ordered = False  # the change, and it is not given up
        self._is_under_way = False  # the reload, from its order on
        # Of the present change:
        self._to: str | None = None
        self._takes_part: frozenset[str] = frozenset()
        self._has_begun = False  # a PE has stepped a module that only `_to` has
        self._mixed_until_ns = 0  # until then PEs may fly by different specs
        # Of steps:
        self._stepped_ns: dict[tuple[str, str], int] = {}  # by PE and module
        self._activated: list[tuple[int, FlownSpec, Configuration | None]] = []
        self._missed: list[tuple[str, str, Violation]] = []  # each with its PE and its module

    # What the operator and the managers do

    def reload_ordered(self) -> None:
        """Note that a manager has accepted the order to change to the new spec."""
        self._is_ordered = self._is_under_way = True

    def reload_over(self, *, is_given_up: bool) -> None:
        """Note that a manager says that the change is given up, or that the aircraft flies by the new spec."""
        self._is_ordered = not is_given_up

    def changes(self, t_ns: int, to: str) -> None:
        """Verify the first step of an epoch of another spec than that of the epoch before; `to`: digest of the spec."""
        if to == self._new and not self._is_ordered and self._new not in self._of_manager.values():
            self._tell(t_ns, "given_up", "the PEs change to the new spec, which is not ordered, or was given up")
        self._to, self._has_begun = to, False
        self._takes_part = self._named & self._runs

    def activated(self, t_ns: int, epoch: Epoch) -> None:
        """Keep the configuration of an epoch; from its activation on PEs may differ for a while."""
        flown = self._specs[self._old if self._to is None else self._to]
        self._activated.append((t_ns, flown, epoch.configuration))
        self._mixed_until_ns = max(self._mixed_until_ns, t_ns + self._patience_ns)

    def began(self, t_ns: int) -> None:
        """Note that a mastership begins: its manager may first have to wait for PEs, and to bring them back."""
        self._began_ns.append(t_ns)
        self._mixed_until_ns = t_ns + START_UP_WINDOW_NS + self._patience_ns
        if self._new not in self._flown.values():
            self._is_ordered = False

    def alive(self, t_ns: int, pes: frozenset[str]) -> None:
        """Verify that the PEs that a manager names as available fly by one spec."""
        if pes != self._named:
            self._mixed_until_ns = max(self._mixed_until_ns, t_ns + self._patience_ns)
        self._named, self._takes_part = pes, self._takes_part & pes
        for pe in pes:
            named_ns, self._named_ns[pe] = self._named_ns.get(pe, 0), t_ns
            if t_ns - named_ns > self._soon_ns:
                self._unnamed.append((pe, named_ns, t_ns))
        if t_ns > self._mixed_until_ns and len({self._flown[pe] for pe in self._flying()}) > 1:
            self._mixed_until_ns = t_ns + self._patience_ns  # tell it again later, not at every ALIVE
            self._tell(t_ns, "mixture", f"for too long: {self._who_flies_what()}")

    # What PEs do

    def speaks(self, t_ns: int, node: str, digest: str) -> bool:
        """Tell whether the indices in the frames of a PE, or of the manager at a station, are those of this spec.

        For a moment after a node has changed, its frames may have waited in its controller, and are of neither.
        """
        waited = t_ns - self._changed_ns.get(node, -_WAITED_NS) < _WAITED_NS
        return self._flown.get(node, self._of_manager.get(node, digest)) == digest and not waited

    def manager_flies(self, t_ns: int, station: str, digest: str) -> None:
        """Note the spec of the manager at a station."""
        if self._of_manager.get(station, digest) != digest:
            self._changed_ns[station] = t_ns
        self._of_manager[station] = digest

    def flies(self, t_ns: int, pe: str, table: PeTable) -> None:
        """Verify the table with which a PE starts, or which takes the place of its table in flight."""
        text = table.to_json()
        found = next((digest for digest, flown in self._specs.items() if flown.texts.get(pe) == text), None)
        if found is None:
            self._tell(t_ns, "whole", f"{pe} has a table that is whole in neither spec")
            found = table.spec_digest
        if self._flown.get(pe, found) != found:
            self._changed_ns[pe] = t_ns
        self._flown[pe] = found

    def gone(self, pe: str) -> None:
        """Note that a PE has died."""
        self._flown.pop(pe, None)
        self._runs.discard(pe)
        self._stepped_ns = {key: t_ns for key, t_ns in self._stepped_ns.items() if key[0] != pe}

    def said(self, state: StateSaid) -> None:
        """Note whether a PE follows an epoch."""
        if state.page.state is PeState.UNCONFIGURED:
            self._runs.discard(state.pe)
        else:
            self._runs.add(state.pe)

    def stepped(self, t_ns: int, pe: str, module: str) -> None:
        """Verify a step of a module."""
        if module in self._same[pe]:
            if self._is_under_way:
                self._look_for_gap(t_ns, pe, module)
            return
        flown = self._flown.get(pe)
        if self._to is None or flown is None:
            return
        if flown == self._to:
            self._has_begun = True
        elif self._has_begun and pe in self._takes_part:
            self._takes_part -= {pe}  # tell it once
            story = f"{pe} steps {module} of {self._name(flown)}, after a PE has begun with {self._name(self._to)}"
            self._tell(t_ns, "mixture", story)

    # What was found

    def unsettled(self, t_ns: int) -> Iterator[Violation]:
        """Yield a violation for each available PE that does not fly by the spec of the epoch activated last."""
        wanted = self._old if self._to is None else self._to
        for pe in sorted(self._flying()):
            if self._flown[pe] != wanted:
                yield Violation(t_ns, "mixture", f"{pe} flies by {self._name(self._flown[pe])}, not by the other")

    def missed_steps(self, kinds: Collection[str]) -> list[Violation]:
        """Return a violation for each missed step; `kinds`: of all faults that were injected."""
        if not DISTURBS_NO_STEP.issuperset(kinds):
            return []
        hears_all = _HEARS_ALL.issuperset(kinds)
        return [
            one
            for pe, module, one in self._missed
            if module not in self._exclusive or (hears_all and not self._may_hold_back(pe, one))
        ]

    def _may_hold_back(self, pe: str, missed: Violation) -> bool:
        """Tell whether a PE may have held back what is exclusive when it missed a step."""
        first_ns, last_ns = missed.since_ns or 0, missed.t_ns + self._lease_ns
        unnamed = [*self._unnamed, (pe, self._named_ns.get(pe, 0) + self._soon_ns, last_ns + 1)]
        is_new_term = self._has_key and any(first_ns <= began_ns <= last_ns for began_ns in self._began_ns)
        return is_new_term or any(
            one == pe and from_ns <= last_ns and first_ns <= to_ns for one, from_ns, to_ns in unnamed
        )

    def _look_for_gap(self, t_ns: int, pe: str, module: str) -> None:
        before_ns = self._stepped_ns.get((pe, module))
        self._stepped_ns[pe, module] = t_ns
        if before_ns is None:
            return
        rate_mhz = self._rate_mhz(before_ns, t_ns, pe, module)
        if rate_mhz is not None and (t_ns - before_ns) * rate_mhz > _MHZ_NS * 3 // 2:
            story = f"{module} on {pe}, which is the same in both specs, made no step for {(t_ns - before_ns) / 1e6} ms"
            self._missed.append((pe, module, Violation(t_ns, "missed", story, before_ns)))

    def _rate_mhz(self, from_ns: int, to_ns: int, pe: str, module: str) -> int | None:
        """Return the rate of a module that ran on a PE in one mode from `from_ns` to `to_ns`; None: it did not."""
        modes = set()
        rate_mhz = 0
        for activated_ns, flown, configuration in reversed(self._activated):
            if activated_ns > to_ns:
                continue
            running = None if configuration is None else configuration.modules.get(module)
            if running is None or running.pe != pe:
                return None
            modes.add(running.mode)
            rate_mhz = flown.spec.modules[module].modes[running.mode].rate_mhz
            if activated_ns <= from_ns:
                break
        return rate_mhz if len(modes) == 1 else None

    def _flying(self) -> frozenset[str]:
        return self._named & self._runs & self._flown.keys()

    def _who_flies_what(self) -> str:
        return ", ".join(f"{pe} flies by {self._name(self._flown[pe])}" for pe in sorted(self._flying()))

    def _name(self, digest: str) -> str:
        return "the new spec" if digest == self._new else "the old spec"

    def _tell(self, t_ns: int, rule: str, story: str) -> None:
        self.violations.append(Violation(t_ns, rule, story))
