"""Break before make, verified from outside: nothing exclusive ever has two drivers.

A *thing* is a DEMUX, an actuator that none stands before, or an identifier on one bus; its holder is the module and PE
that moved it last (where a branch of a DEMUX has no device: that computed for it), or the node that sent it last. A
holder may lose its thing to another one, and may get it back with a later handover. It must not drive it again after
another one took over since the last handover: then both believed that they held it. Modules that drive in turn are
found at the second turn, at the latest, whatever their rates are.

A handover is a GO, or the GO_ALL that follows it for what waited longer, of the newest epoch of its term heard on the
manager's bus. What a term begins with may be any other epoch than the last: a manager that has lost its journal may
begin with an older number, and where a higher term falls silent the one before goes on with its own. BREAK is none:
until GO everything still belongs to the epoch before, and what that epoch gave may drive for the first time when BREAK
is on the bus already (a frame that waits in its sender's controller leaves before its `broken`).

Where no manager has been active for T_lease, and the other holder was not heard for as long, that one may have let go
by itself, and a holder from before may drive again. If it had not, it is seen driving again after that.

Not verified: what a PE drives within T_lease of a stranger's ALIVE that names it. Sent again, an ALIVE is as good as
new to a PE that was cut off when it was sent first. And the manager does not wait for a PE in whose name a stranger has
sent that it started anew, though it may only be unheard (docs/limits.md).
"""

from collections.abc import Iterable

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.steps_seen import Driven, Moved
from heronry_wire.management import Activate, Lease, ManagementMessage, Step, is_newer

_Thing = tuple[str, str | int]
_Holder = tuple[str, str]


class ExclusionCheck(Oracle):
    """Follows what each PE drives."""

    def __init__(self, spec: Spec) -> None:
        super().__init__()
        self._thing_of: dict[str, _Thing] = {m.name: ("actuator", m.device) for m in spec.modules.values() if m.device}
        self._moving = frozenset(self._thing_of)
        for demux in spec.demuxes.values():
            self._thing_of |= dict.fromkeys(demux.branches, ("DEMUX", demux.name))
        self._epoch, self._step = 0, Step.PREPARED  # the one that may begin to drive, and how far it has got
        self._last: dict[int, tuple[int, Step]] = {}  # the same, by term
        self._handover = 0  # counts up
        self._holders: dict[_Thing, _Holder] = {}
        self._lease_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns
        self._leased_ns = 0  # when a manager was heard last
        self._spoke_ns: dict[str, int] = {}  # when each PE was
        self._misled_ns: dict[str, int] = {}  # when a stranger has named each PE, or sent in its name
        self._lost: dict[tuple[_Thing, _Holder], int] = {}  # the handover by which another one has it

    def leased(self, t_ns: int) -> None:
        """A LEASE was heard."""
        self._leased_ns = t_ns

    def said(self, state: StateSaid) -> None:
        """A PE has sent its state."""
        self._spoke_ns[state.pe] = state.t_ns

    def misled(self, t_ns: int, pes: Iterable[str]) -> None:
        """A stranger has sent an ALIVE that names these PEs, or a state of one."""
        self._misled_ns |= dict.fromkeys(pes, t_ns)

    def commanded(self, _t_ns: int, _station: str, message: ManagementMessage) -> None:
        """A manager was heard: it may have let an epoch go."""
        if not isinstance(message, Activate | Lease) or message.step < Step.GO:
            return
        is_first = message.term not in self._last  # of its term
        epoch, step = self._last.get(message.term, (self._epoch, self._step))
        is_newest = is_first or is_newer(message.epoch, epoch)
        is_handover = message.step > step if message.epoch == epoch else is_newest
        if is_handover or is_first:
            self._last[message.term] = message.epoch, message.step
        if is_handover:
            self._epoch, self._step, self._handover = message.epoch, message.step, self._handover + 1

    def moved(self, moved: Moved) -> None:
        """A PE lets the device of a module move."""
        self._follow(moved.t_ns, self._thing_of[moved.module], (moved.module, moved.pe))

    def driven(self, driven: Driven) -> None:
        """A module was stepped that drives: if it has no device, its values are all that there is to see."""
        if driven.module not in self._moving:
            self._follow(driven.t_ns, self._thing_of[driven.module], (driven.module, driven.pe))

    def published(self, sent: Sent) -> None:
        """A data frame was sent."""
        thing = (sent.bus, sent.frame.can_id)
        if self._holders.get(thing) != (sent.sender, ""):
            self._follow(sent.end_ns, thing, (sent.sender, ""))

    def _follow(self, t_ns: int, thing: _Thing, holder: _Holder) -> None:
        before = self._holders.get(thing)
        misled_ns = self._misled_ns.get(holder[1] or holder[0])
        if before == holder or (misled_ns is not None and t_ns - misled_ns <= self._lease_ns):
            return
        self._holders[thing] = holder
        if before is not None:
            self._lost[thing, before] = self._handover
        was_lost = before is not None and self._lost.pop((thing, holder), None) == self._handover
        if before is not None and was_lost and not self._may_have_gone(t_ns, before):
            driver = " on ".join(filter(None, holder))
            rival = " on ".join(filter(None, before))
            story = f"{thing[0]} {thing[1]} is driven by {driver} again, after {rival}, in epoch {self._epoch}"
            self.violations.append(Violation(t_ns, "exclusion", story))

    def _may_have_gone(self, t_ns: int, holder: _Holder) -> bool:
        """Tell whether neither a manager nor this holder is heard: its PE hears no node then, or it drives again."""
        speaker = holder[1] or holder[0]
        heard_ns = max(self._leased_ns, self._spoke_ns.get(speaker, 0))
        return t_ns - heard_ns > self._lease_ns
