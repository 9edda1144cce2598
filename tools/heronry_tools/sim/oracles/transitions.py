"""No bus exceeds its budget during a transition, in whichever order the PEs take the steps.

At the first GO or GO_ALL of an epoch, the oracle knows from state frames what every PE runs; PEs in state BROKEN have
already stopped what they must give up. `heronry_dg.verify_transition` goes through every order in which the PEs may
take the remaining steps. In each order the data must fit on each bus at every moment.

The oracle verifies an epoch only if it knows the configuration that ran before. For this, every PE that takes part in
the epoch and runs anything must be in one of two states:

- BROKEN in the epoch that is verified;
- ACTIVE in an earlier epoch: the same one for all these PEs, and one that the oracle has read back from its frames.

For a radio this oracle uses the whole budget; the oracle `radio` verifies the share that is usable.
"""

from collections.abc import Mapping, Sequence

from heronry_dg.configuration import Configuration
from heronry_dg.model import Spec
from heronry_dg.situation import Situation
from heronry_dg.transition import Transition
from heronry_dg.verify_transition import verify_transition
from heronry_tools.recording.commanded import Epoch
from heronry_tools.sim.oracles.oracle import Oracle, StateSaid
from heronry_tools.sim.oracles.violation import Violation
from heronry_wire.management import NO_EPOCH, Activate, Lease, ManagementMessage, Step
from heronry_wire.state_frames import PeState, StatePage0


class TransitionCheck(Oracle):
    """Verifies that no bus is overloaded by the steps of an epoch that remain, in whatever order they are taken.

    The oracle does this at the first GO or GO_ALL of each epoch. It starts from what each PE runs at that time,
    according to the PE's state frames.
    """

    def __init__(self, spec: Spec, epochs: Mapping[int, Epoch]) -> None:
        """Begin with no state frame seen; the caller adds each activated epoch to `epochs`, under its number."""
        super().__init__()
        self._spec, self._epochs = spec, epochs
        self._node_of = {pe.name: pe.node_id for pe in spec.pes.values()}
        self._told: dict[str, StatePage0] = {}
        self._gone = 0  # the last epoch with a GO or GO_ALL
        self._breaking = 0

    def said(self, state: StateSaid) -> None:
        """Record the last page 0 of a PE, in which the PE reports what it runs."""
        self._told[state.pe] = state.page

    def commanded(self, t_ns: int, _station: str, message: ManagementMessage) -> None:
        """Verify the transition to an epoch at the first ACTIVATE or LEASE with GO or GO_ALL for this epoch."""
        if not isinstance(message, Activate | Lease):
            return
        epoch = self._epochs.get(message.epoch)
        if epoch is None or epoch.number == self._gone or message.step is Step.PREPARED:
            return
        if message.step is Step.BREAK:
            self._breaking = epoch.number
            return
        self._gone = epoch.number
        steps = (Step.GO, Step.GO_ALL) if message.step is Step.GO else (Step.GO_ALL,)
        if epoch.configuration is not None:
            told = {pe: self._told[pe] for pe, node in self._node_of.items() if epoch.has(node) and pe in self._told}
            self.violations += [Violation(t_ns, "transition", story) for story in self._assess(epoch, told, steps)]

    def _assess(self, epoch: Epoch, told: Mapping[str, StatePage0], steps: tuple[Step, ...]) -> list[str]:
        assert epoch.configuration is not None
        broken = {pe for pe, page in told.items() if page.epoch == epoch.number}
        ran = {pe for pe, page in told.items() if page.state is not PeState.UNCONFIGURED}
        before = self._before([told[pe] for pe in ran - broken])
        is_known = all(told[pe].state is PeState.BROKEN for pe in broken) and (
            not broken or self._breaking == epoch.number
        )
        if before is None or before.configuration is None or not is_known:
            return []
        modules = {name: one for name, one in before.configuration.modules.items() if one.pe in ran}
        now = Situation(frozenset(f"pe:{pe}" for pe in self._node_of.keys() - told.keys()))
        way = Transition((Step.BREAK, *steps) if broken else steps, dict.fromkeys(broken, ()), (), (), {})
        found = verify_transition(self._spec, Configuration(modules), epoch.configuration, now, way)
        return [f"from epoch {before.number} to {epoch.number}: {one}" for one in found if one.rule == "t.bus"]

    def _before(self, pages: Sequence[StatePage0]) -> Epoch | None:
        """Return the epoch that all `pages` report as ACTIVE, if they also report the digest of this epoch.

        None: the pages do not agree on one epoch, or the epoch is not known, or it has another digest.
        """
        said = {(page.epoch, page.digest, page.state) for page in pages}
        number, digest, state = next(iter(said), (NO_EPOCH, 0, PeState.UNCONFIGURED))
        before = self._epochs.get(number)
        if len(said) != 1 or state is not PeState.ACTIVE or before is None or before.digest != digest:
            return None
        return before
