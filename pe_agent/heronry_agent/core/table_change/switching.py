"""One step of an epoch makes the table beside the one that flies: the two change places.

Nothing here can fail half way: the table was checked when it came, and the slice when it was staged. In one call of the
core, with no frame in between:

1. The modules that do not go on are stopped (`carried_over`): by their old indices, as in the step BREAK. Unsent data
   of sources that are no longer sent under the same identifier are withdrawn.
2. The contents of the two tables are exchanged; every part that keeps something by index takes the new indices.
3. The driver takes the new indices, too (SwitchTable).
4. The caller takes the activation step: it starts modules at GO, as in any epoch.

A lost ACTIVATE is repeated by LEASE, a doubled one finds the epoch running. A PE that restarts has the table that its
driver has kept, of which the manager learns by the refused slice (protocol rule 5).
"""

from collections.abc import Collection
from dataclasses import replace

from heronry_agent.core.authority import FollowedManager
from heronry_agent.core.carried_over import CarriedOver
from heronry_agent.core.configuration import ActiveConfiguration, Configured, SliceReader, Staging
from heronry_agent.core.forwarding import Gateway
from heronry_agent.core.modules import RunningModules
from heronry_agent.core.table_change.beside import TableBeside
from heronry_agent.core.table_index import TableIndex
from heronry_agent.core.turn import Turn
from heronry_agent.core.vocabulary import SwitchTable
from heronry_wire.configuration_slice import Slice


class TableSwitch:
    """Lets the table beside and the one that flies change places."""

    def __init__(
        self,
        turn: Turn,
        index: TableIndex,
        beside: TableBeside,
        *,
        staging: Staging,
        active_configuration: ActiveConfiguration,
        modules: RunningModules,
        gateway: Gateway,
        followed_manager: FollowedManager,
    ) -> None:
        self._turn, self._index, self._beside, self._staging = turn, index, beside, staging
        self._active, self._modules, self._gateway = active_configuration, modules, gateway
        self._followed = followed_manager

    def carry_out(self, target: Configured, sends: Slice) -> tuple[Configured, Slice]:
        """Fly by the table of `target`, which is the one beside, from now on.

        sends: what this PE sends and forwards. Returns `target`, of which the caller takes a step, and of `sends` what
        goes on under the same identifiers, both in the indices of the table that flies now.
        """
        index, other, staging = self._index, target.table, self._staging
        beside = staging.beside
        assert other is not None
        assert beside is not None
        carried, slow = CarriedOver(index, other), self._modules.rests.slow
        goes_on = self._goes_on(carried, target)
        self._modules.carry_out(self._active.leave(goes_on), None)
        same = {
            source: carried.sources[source]
            for source in (*sends.publish, *sends.forward)
            if source in carried.sources
            and index.identifiers((source,)) == other.identifiers((carried.sources[source],))
        }
        self._turn.withdraw(index.identifiers({*sends.publish, *sends.forward} - same.keys()))
        index.exchange(other)
        self._active.renumber(carried.modules)
        self._modules.carry_over(carried)
        self._gateway.look_beyond()
        self._followed.lease_ns = index.leased_ns
        staging.staged = replace(target, table=None)
        lacking, staging.reader = staging.reader.missing_images, SliceReader(index, beside.missing_images)
        self._modules.rests.slow = self._beside.slow
        self._beside.put(other, lacking, slow)
        self._turn.do(SwitchTable(index.table, {module: carried.modules[module] for module in goes_on}))
        self._modules.lack(beside.missing_images)
        self._turn.note("table", f"the table of {index.table.spec}, which was beside, flies from now on")
        return staging.staged, Slice(
            publish={same[source]: mask for source, mask in sends.publish.items() if source in same},
            forward={same[source]: entry for source, entry in sends.forward.items() if source in same},
        )

    def _goes_on(self, carried: CarriedOver, target: Configured) -> Collection[int]:
        wanted = {module.module: module.mode for module in target.slice.modules}
        live = self._active.live
        return [m for m, mode in live.items() if m in carried.modules and wanted.get(carried.modules[m]) == mode]
