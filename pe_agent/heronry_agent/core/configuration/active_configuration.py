"""Which modules run on a PE, and how a new configuration replaces the old one: the PE's half of protocol rule 4.

    UNCONFIGURED  no step has been taken since the start
    BROKEN        step BREAK: modules that the new slice lacks have stopped, and the others are rewired. No new
                  module runs yet, and no data are sent that were not sent before
    PARTIAL       step GO: all modules of the slice run, except DEMUX branches that are new here; those are *held*
    ACTIVE        step GO_ALL, or step GO if no DEMUX branch is new here

In this file a *step* is an activation step: BREAK, GO or GO_ALL. A step contains the steps before it, so a PE that
missed a step takes it together with the next one. A step already taken is not taken again, and the epoch never goes
back. So lost, late and doubled commands do no harm. This holds for ACTIVATE and for LEASE, which names the step in each
period. After a restart of the PE nothing runs.

*A module whose mode changes* is stopped at BREAK and started at GO, because its old mode may read variables that no PE
sends any more. The module is built anew, unless it can go on with its present state. If GO_ALL is the first command
that comes, the module is stopped and started in one step.

*A DEMUX branch that ran on this PE until BREAK* is not held at GO, even in a new mode. The branch may go on, since no
other PE drives that DEMUX. While this PE is in doubt (`output_authorization`), the branch drives nothing.

*A module that failed* stays stopped until a later epoch contains it: the manager has the report, and decides where the
module runs. There is one exception (`forgive`): a new term begins, and the operator has cleared the fault. The manager
of the new term may know neither the fault nor that it was cleared, and may therefore make no new epoch. So the PE
starts the module again in the present epoch.

*A module rests* while it is stopped because no manager is heard. It starts again when a LEASE names this configuration
again (`without_manager`), or when a new configuration contains the module.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field

from heronry_agent.core.configuration.staging import UNCONFIGURED, Configured
from heronry_agent.core.table_index import TableIndex
from heronry_wire.management import NO_EPOCH, Step
from heronry_wire.sansio import require
from heronry_wire.state_frames import PeState


@dataclass(frozen=True, slots=True)
class Moves:
    """Which modules to stop and to start, by index in the table: first `drop` and `stop`, then `start`.

    stop: modules that run and must stop.
    keep: modules in `stop` that will start again in another mode, and keep their state until then.
    drop: modules that were kept before, and whose state is not needed any more.
    start: (module, mode) of each module to start.
    rewire: the epoch is new, so the inputs of all modules change.
    """

    stop: tuple[int, ...] = ()
    keep: frozenset[int] = frozenset()
    drop: tuple[int, ...] = ()
    start: tuple[tuple[int, int], ...] = ()
    rewire: bool = False


@dataclass
class ActiveConfiguration:
    """The configuration that runs on one PE, and how far it is activated.

    live: mode of each module that runs.
    held: DEMUX branches that wait for GO_ALL.
    failed: modules that have failed, and stay stopped.
    """

    index: TableIndex
    running: Configured = UNCONFIGURED
    step: Step = Step.PREPARED
    live: dict[int, int] = field(default_factory=dict)
    held: frozenset[int] = frozenset()
    failed: set[int] = field(default_factory=set)
    resting: frozenset[int] = frozenset()  # modules that stopped because no manager is heard
    _kept: frozenset[int] = frozenset()  # modules that stopped and will start again in another mode
    _wanted: dict[int, int] = field(default_factory=dict)

    @property
    def state(self) -> PeState:
        """The state of this PE, as its state frames report it."""
        if self.running.epoch == NO_EPOCH:
            return PeState.UNCONFIGURED
        if self.step is Step.BREAK:
            return PeState.BROKEN
        return PeState.PARTIAL if self.held else PeState.ACTIVE

    def is_at(self, epoch: int, digest: int) -> bool:
        """Tell whether this PE runs the configuration with this epoch and digest, however far it is activated."""
        return (epoch, digest) == (self.running.epoch, self.running.digest) and epoch != NO_EPOCH

    def advance(self, target: Configured, step: Step) -> Moves | None:
        """Take an activation step of `target`; returns the modules to stop and to start.

        Returns None if this step or a later one of `target` was taken before.

        target: the running configuration, or the staged one, which then becomes the running one.
        """
        rewire = target is not self.running
        if not rewire and step <= self.step:
            return None
        kept = self._kept
        stop = self._break(target) if rewire else ()
        self.step = step
        if step is Step.GO_ALL:
            self.held = frozenset()
        start = self._startable() if step >= Step.GO else ()
        self.live.update(start)
        keep, drop = self._kept.intersection(stop), tuple(sorted(kept - self._kept))
        self._kept = self._kept.difference(self.live)
        return Moves(stop, keep, drop if rewire else (), start, rewire)

    def leave(self, goes_on: Collection[int]) -> Moves:
        """Stop every module that is not in `goes_on`, before another table takes the place of this one."""
        stop = tuple(sorted(self.live.keys() - set(goes_on)))
        for module in stop:
            del self.live[module]
        drop, self._kept = tuple(sorted(self._kept)), frozenset()
        return Moves(stop, drop=drop)

    def renumber(self, modules: Mapping[int, int]) -> None:
        """Give the modules that go on (all that run) the indices that they have in another table."""
        self.live = {modules[module]: mode for module, mode in self.live.items()}

    def rest(self) -> Moves:
        """Stop the expendable modules that run, because no manager is heard; returns them as `Moves`."""
        stop = tuple(sorted(self.expendable_live()))
        for module in stop:
            del self.live[module]
        self.resting |= frozenset(stop)
        return Moves(stop)

    def resume(self) -> Moves:
        """Start the modules again that `rest` has stopped; returns them as `Moves`."""
        start = tuple((module, self._wanted[module]) for module in sorted(self.resting))
        self.live.update(start)
        self.resting = frozenset()
        return Moves(start=start)

    def expendable_live(self) -> frozenset[int]:
        """Expendable modules that run now."""
        expendable = self.running.slice.expendable
        return expendable.intersection(self.live) if expendable else expendable

    def drop(self, module: int) -> bool:
        """Note that a module has failed and stays stopped; tells whether it ran until now."""
        if self.live.pop(module, None) is None:
            return False
        self.failed.add(module)
        return True

    def forgive(self, modules: Iterable[int]) -> Moves:
        """Forget that these modules have failed; returns the modules to start now.

        A DEMUX branch that waits for GO_ALL still waits. While other expendable modules are stopped because no manager
        is heard, an expendable module is not started.
        """
        forgiven = self.failed.intersection(modules)
        self.failed -= forgiven
        if self.resting:
            self.resting |= self.running.slice.expendable & forgiven
        start = self._startable() if self.step >= Step.GO else ()
        self.live.update(start)
        return Moves(start=start)

    def validate(self) -> None:
        """Check that the states of all modules agree with each other and with the activation step.

        For example, no module may be both running and failed. Raises InvariantError.
        """
        live, held, failed, wanted = self.live, self.held, self.failed | self.resting, self._wanted
        require(live.items() <= wanted.items(), "modules {} run, but only {} are wanted", live, wanted)
        require(
            held.isdisjoint(live) and failed.isdisjoint(live),
            "a held or failed module runs: held {}, failed {}, running {}",
            held,
            failed,
            live,
        )
        configured = self.running.epoch != NO_EPOCH
        require(
            configured == (self.step is not Step.PREPARED),
            "epoch {} does not fit activation step {}",
            self.running.epoch,
            self.step,
        )
        accounted = (
            len(live) + len(held) + len(failed) == len(wanted) and held <= wanted.keys() and failed <= wanted.keys()
        )
        require(
            accounted or self.step < Step.GO,
            "of the wanted modules {} some are missing: running {}, held {}, failed {}",
            wanted,
            live,
            held,
            failed,
        )

    def _break(self, target: Configured) -> tuple[int, ...]:
        self._wanted = {module.module: module.mode for module in target.slice.modules}
        before = self.live.keys()
        self.held = frozenset(m for m in self._wanted if self.index.modules[m].demux and m not in before)
        stop = tuple(m for m, mode in self.live.items() if self._wanted.get(m) != mode)
        for module in stop:
            del self.live[module]
        self._kept = frozenset(self._wanted.keys() & (self._kept | set(stop)))
        self.failed.clear()
        self.resting = frozenset()
        self.running = target
        return stop

    def _startable(self) -> tuple[tuple[int, int], ...]:
        idle = self._wanted.keys() - self.live.keys() - self.held - self.failed - self.resting
        return tuple((module, self._wanted[module]) for module in sorted(idle))
