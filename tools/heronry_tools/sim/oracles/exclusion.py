"""Break before make: nothing exclusive ever has two drivers.

What is exclusive is called a *thing* here, and each thing has a *holder*:

    thing                                               holder
    an identifier on one bus                            the node that has sent the identifier last
    the branches of a DEMUX; the ends of its `to`;      the module, with its PE, that has moved the thing last. If the
    an actuator                                         module has no device, each of its steps counts as a movement

Another holder may take a thing over. After that the former holder may drive the thing again only if there was a
handover in between. Without a handover, two holders have driven the thing at one time. So if two modules drive a thing
alternately, the oracle detects this when the first module drives again, whatever their rates are.

A *handover* is a GO of the newest epoch of its term, or the GO_ALL that follows this GO, for outputs that had to wait.

- The first epoch of a term may have any number: a manager that has lost its journal may begin with a low number.
- Each term has its own newest epoch. So after the manager of a higher term has fallen silent, the manager of a lower
  term may continue with its own numbers.
- BREAK is no handover. Until GO every thing belongs to the epoch before. A holder of that epoch may even drive for the
  first time after BREAK, since its frame may have waited in its controller.

A holder whose PE has fallen silent may have released its thing by itself. This is possible if, for T_lease, no manager
was active and this PE was not heard. Then the former holder may drive again without a handover. If the silent holder
has not released the thing, the oracle detects this when the silent holder drives next.

The oracle does not verify what a PE drives within T_lease after one of these frames of a foreign node:

- an ALIVE that names the PE. The foreign node may repeat an ALIVE that a manager sent while the PE was cut off; the PE
  then takes the repetition for a new ALIVE;
- a state in the name of the PE, which shows a restart. The manager then does not wait for the PE, though the PE may
  still run unheard (docs/limits.md).
"""

from collections.abc import Iterable, Iterator

from heronry_dg.model import Spec
from heronry_tools.sim.oracles.limits import LEASE_PERIODS
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.steps_seen import Driven, Moved
from heronry_wire.management import Activate, Lease, ManagementMessage, Step, is_newer

_Thing = tuple[str, str | int]
_Holder = tuple[str, str]


def _exclusive(spec: Spec) -> Iterator[tuple[str, _Thing]]:
    """Yield each module with each exclusive thing that it drives."""
    for demux in spec.demuxes.values():
        yield from ((module, ("DEMUX", demux.name)) for module in demux.branches)
        yield from ((module, ("end of DEMUX", demux.name)) for module in demux.to)
    yield from ((m.name, ("actuator", m.device)) for m in spec.modules.values() if m.device)


class ExclusionCheck(Oracle):
    """Records who holds each exclusive output and identifier, and verifies that none has two holders at a time."""

    def __init__(self, spec: Spec, *others: Spec) -> None:
        """Begin with no holder; others: specs by which PEs may fly later in the same flight."""
        super().__init__()
        specs = (spec, *others)
        self._moving = frozenset(m.name for one in specs for m in one.modules.values() if m.device)
        self._things_of: dict[str, dict[_Thing, None]] = {}
        for module, thing in (found for one in specs for found in _exclusive(one)):
            self._things_of.setdefault(module, {})[thing] = None
        self._epoch, self._step = 0, Step.PREPARED  # the newest epoch, and its last step
        self._last: dict[int, tuple[int, Step]] = {}  # the same, by term
        self._handover = 0  # number of handovers so far
        self._holders: dict[_Thing, _Holder] = {}
        self._lease_ns = LEASE_PERIODS * spec.buses[spec.manager.bus].heartbeat_ns
        self._leased_ns = 0  # when a manager was heard last
        self._spoke_ns: dict[str, int] = {}  # when each PE was heard last
        self._misled_ns: dict[str, int] = {}  # when a foreign node has named each PE, or sent in its name
        self._lost: dict[tuple[_Thing, _Holder], int] = {}  # the handover after which another holder took it

    def leased(self, t_ns: int) -> None:
        """Record that a manager was heard at `t_ns`.

        A holder may have released a thing by itself only after T_lease in which no manager was heard.
        """
        self._leased_ns = t_ns

    def said(self, state: StateSaid) -> None:
        """Record when a PE was heard: after T_lease without being heard, it may have released its things by itself.

        A *thing* is an exclusive output or identifier (see the head of this file).
        """
        self._spoke_ns[state.pe] = state.t_ns

    def misled(self, t_ns: int, pes: Iterable[str]) -> None:
        """Record that a foreign node has named these PEs in an ALIVE, or has sent a state in the name of one."""
        self._misled_ns |= dict.fromkeys(pes, t_ns)

    def commanded(self, _t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Count a handover: an ACTIVATE or LEASE takes the newest epoch of its term to GO, or further to GO_ALL.

        A repeated command with the same step is no handover. After a handover, a former holder of an exclusive
        output or identifier may drive it again.
        """
        if not isinstance(message, Activate | Lease) or message.step < Step.GO:
            return
        is_first = message.term not in self._last  # the first epoch of its term
        epoch, step = self._last.get(message.term, (self._epoch, self._step))
        is_newest = is_first or is_newer(message.epoch, epoch)
        is_handover = message.step > step if message.epoch == epoch else is_newest
        if is_handover or is_first:
            self._last[message.term] = message.epoch, message.step
        if is_handover:
            self._epoch, self._step, self._handover = message.epoch, message.step, self._handover + 1

    def moved(self, moved: Moved) -> None:
        """Make a module the holder of its exclusive outputs: a violation if another took them without a handover."""
        for thing in self._things_of[moved.module]:
            self._follow(moved.t_ns, thing, (moved.module, moved.pe))

    def driven(self, driven: Driven) -> None:
        """Make a module without a device the holder of its exclusive outputs, since it executes a step.

        A violation is found as in `moved`, which does the same for a module with a device.
        """
        if driven.module not in self._moving:
            for thing in self._things_of[driven.module]:
                self._follow(driven.t_ns, thing, (driven.module, driven.pe))

    def published(self, sent: Sent) -> None:
        """Make the sender of a data frame the holder of the frame's identifier on this bus.

        It is a violation if another node took the identifier from this sender, and no handover came since.
        """
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
        """Tell whether `holder` may have stopped driving its exclusive thing although there was no handover.

        The answer is yes if, for T_lease, neither a manager nor the holder's PE was heard.
        """
        speaker = holder[1] or holder[0]
        heard_ns = max(self._leased_ns, self._spoke_ns.get(speaker, 0))
        return t_ns - heard_ns > self._lease_ns
