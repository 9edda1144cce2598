"""Epochs: how an epoch is made of a plan, and which epochs are remembered.

An epoch is a plan that was compiled and given a number (`numbering`). It has participants: the PEs that are available
when it is opened. A participant is *awaited* (the epoch waits for its answers) if the manager reaches this PE by wire
alone, and still has a route to it in the situation of the plan. So no epoch waits for a PE beyond a dead gateway, even
if state frames of this PE still come. `epoch` says how an epoch proceeds.

A late PE may still run an old epoch; its state frames name the number of that epoch. So some epochs are remembered
after the next one has replaced them: they tell what such a PE drives. The epoch that was activated or adopted last is
also remembered over a restart (`memory`).
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from heronry_dg.configuration import Configuration, Running
from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_dg.situation import survivors
from heronry_manager.contingency.configuration_code import ConfigurationCode
from heronry_manager.core.epochs.epoch import Cause, Epoch, Participant, Stage
from heronry_manager.core.epochs.numbering import EpochNumbers
from heronry_manager.core.epochs.observation import Observations
from heronry_manager.core.membership import Exclusion, Health
from heronry_manager.core.memory import Runs
from heronry_manager.core.tables import CompiledConfiguration, Compiler, ContingencyNumbers
from heronry_manager.core.topology import reached_by_wire
from heronry_manager.core.turn import Turn
from heronry_wire.management import is_newer

_REMEMBERED = 8


@dataclass(frozen=True, slots=True)
class ModuleChanges:
    """The modules that have moved to another PE, the new ones, and those that no longer run; each is sorted."""

    moved: tuple[str, ...]
    started: tuple[str, ...]
    stopped: tuple[str, ...]


class Epochs:
    """Makes epochs of plans, and remembers the epochs that a PE may still run."""

    def __init__(
        self,
        turn: Turn,
        spec: Spec,
        health: Health,
        exclusion: Exclusion,
        observed: Observations,
        *,
        compiler: Compiler,
        on_board: ContingencyNumbers | None,
        frames_per_command: int,
    ) -> None:
        """Begin without an epoch.

        compiler: that of `spec`.
        on_board: the configurations that a PREPARE can name by number; None: there are none.
        frames_per_command: 1, or 2 if a TAG follows each command. Slices are then sent at half the rate, since slices
            and their TAGs together may take only half of the bus.
        """
        self._turn, self._spec, self._health, self._exclusion = turn, spec, health, exclusion
        self._observed, self._on_board = observed, on_board
        self.bitrate = spec.buses[spec.manager.bus].bitrate // frames_per_command
        self.wired = reached_by_wire(spec)
        self._compiler, self._code = compiler, ConfigurationCode(spec)
        self.numbers = EpochNumbers(turn)
        self._known: dict[int, Epoch] = {}  # epochs that were activated or adopted

    def compiled(self, configuration: Configuration) -> CompiledConfiguration:
        """Compile a configuration into the slices of the PEs."""
        return self._compiler.configuration(configuration)

    def decoded(self, runs: Runs) -> Configuration:
        """Decode the configuration of an epoch, as the journal keeps it or as another manager has announced it."""
        return self._code.decode(bytes.fromhex(runs.row))

    # Making an epoch

    def open(self, plan: Plan, causes: Iterable[Cause]) -> Epoch:
        """Open a new epoch for a plan, with a number newer than all that were used or seen."""
        compiled = self.compiled(plan.configuration)
        number = self.numbers.next(self._observed.newest_epoch())
        return self._made(number, plan, compiled, tuple(causes), Stage.PREPARING)

    def running(self, number: int, plan: Plan, compiled: CompiledConfiguration) -> Epoch:
        """Make an epoch with this number for a configuration that the PEs run already."""
        return self._made(number, plan, compiled, (), Stage.DONE)

    def _made(
        self, epoch: int, plan: Plan, compiled: CompiledConfiguration, causes: tuple[Cause, ...], stage: Stage
    ) -> Epoch:
        number = 0 if self._on_board is None else self._on_board.number(plan.configuration)
        return Epoch(
            term=self._turn.term,
            epoch=epoch,
            plan=plan,
            compiled=compiled,
            placed=self._exclusion.tokens(plan.configuration),
            participants=self.participants(self._health.available(), plan, number),
            bitrate=self.bitrate,
            started_ns=self._turn.now_ns,
            causes=causes,
            stage=stage,
            contingency=number,
        )

    def participants(self, pes: Iterable[str], plan: Plan, contingency: int) -> list[Participant]:
        """Make these PEs participants of an epoch for this plan.

        The epoch awaits each of these PEs that the manager reaches by wire alone, if the PE is up in the situation of
        the plan and still has a route to the manager. If no available PE is up and has such a route, the epoch awaits
        every one of these PEs that the manager reaches by wire alone.

        contingency: number of the contingency that equals the plan; 0 if the plan is no contingency.
        """
        reached = survivors(self._spec, plan.now).pe_cpu_millis.keys()
        reaches_nobody = not any(pe in reached for pe in self._health.available())
        return [
            self._participant(pe, contingency, awaited=pe in self.wired and (reaches_nobody or pe in reached))
            for pe in pes
        ]

    def _participant(self, pe: str, contingency: int, *, awaited: bool) -> Participant:
        seen = self._observed.of[pe]
        known = self._known.get(seen.epoch)
        node = self._spec.pes[pe].node_id
        return Participant(
            pe=pe,
            node=node,
            period_ns=self._health.period_ns(pe),
            awaited=awaited,
            runs_digest=known.compiled.slice_digests[node] if known is not None and seen.configured else None,
            on_board=self._on_board is not None and self._on_board.holds(pe, contingency),
        )

    # Remembered epochs

    def known(self, number: int) -> Epoch | None:
        """Return the epoch with this number; None: it is not remembered."""
        return self._known.get(number)

    def placed_since(self, epoch: Epoch) -> Iterator[Mapping[str, set[str]]]:
        """Yield the tokens that each remembered epoch newer than `epoch` places, by PE."""
        return (one.placed for one in self._known.values() if is_newer(one.epoch, epoch.epoch))

    def remember(self, epoch: Epoch) -> None:
        """Remember an epoch that was activated or adopted, and keep it in the journal for the time after a restart.

        Of the epochs that no available PE shows any more, only the last few stay remembered.
        """
        row = self._code.encode(epoch.configuration).hex()
        self._turn.keep(Runs(epoch.epoch, epoch.compiled.digest, row))
        self._known[epoch.epoch] = epoch
        shown = {self._observed.of[pe].epoch for pe in self._health.available()}  # epochs that PEs still run
        for forgotten in [number for number in self._known if number not in shown][:-_REMEMBERED]:
            del self._known[forgotten]


def module_changes(before: Configuration | None, after: Configuration) -> ModuleChanges:
    """List the modules that are moved, started and stopped between two configurations.

    before: the former configuration; None: nothing ran.
    """
    old: Mapping[str, Running] = {} if before is None else before.modules
    new = after.modules
    return ModuleChanges(
        moved=tuple(sorted(module for module in old.keys() & new.keys() if old[module].pe != new[module].pe)),
        started=tuple(sorted(new.keys() - old.keys())),
        stopped=tuple(sorted(old.keys() - new.keys())),
    )
