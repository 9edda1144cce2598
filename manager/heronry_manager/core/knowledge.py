"""What a manager knows until it falls silent, or becomes a standby manager: then the manager forgets it.

The objects stay the same for as long as the manager runs. When the manager forgets, each begins anew, with what
`memory` holds. Whoever needs one of them is given it once.

    health          which PEs are available
    exclusion       what silent PEs may still drive
    situation       what has failed, what is limited, and the phase
    deployment      what runs, what is being prepared, and what each PE reports that it runs
    advice          the last advice of a manager that only advises
    following       what the other manager, if that one is active, sends and does
    held_outputs    which PEs hold exclusive outputs back
    silences        which inputs and outputs of running modules are silent
    script          the configuration that a script of the operator has ordered
    authenticity    with a key: what has been proven; None without a key
    details         what PEs store for people to read. No decision depends on it, and the manager does not forget it
    served          to which PE a table or code is on its way; what is read from it for `details` waits
    unknown_nodes   which nodes the spec does not have. No decision depends on it
    bringing        which PEs wait without a table. It forgets by itself when the manager is not active
    code            which PEs lack code, and what is on its way to them. It forgets by itself, too
"""

from heronry_manager.core.authentication import Authenticity
from heronry_manager.core.epochs import Advice, Deployment, HeldOutputs, Silences
from heronry_manager.core.mastership import Claim, Following, Mastership
from heronry_manager.core.membership import Exclusion, Health
from heronry_manager.core.provisioning import CodeBringing, TableBringing, UnknownNodes
from heronry_manager.core.reports import PeDetails
from heronry_manager.core.sdo_client import ObjectReader, OneServed
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.situation import HeldScript, KnownSituation
from heronry_manager.core.turn import Turn
from heronry_wire.sansio import require


class Knowledge:
    """The objects of the core that hold what the manager knows."""

    def __init__(self, settings: ManagerSettings, turn: Turn, claim: Claim) -> None:
        """Make each object after those that it needs."""
        self._settings, self._turn, self._claim = settings, turn, claim
        spec, key, compiler, on_board = settings.spec, settings.key, settings.compiler, settings.on_board
        self.health = Health(spec, turn.now_ns, settings.window_ns)
        self.exclusion = Exclusion(spec, tells_departures=settings.tells_departures)
        self.situation = KnownSituation(spec, turn, self.health)
        self.deployment = Deployment(
            turn,
            spec,
            self.health,
            self.exclusion,
            compiler=compiler,
            on_board=on_board,
            frames_per_command=1 if key is None else 2,
        )
        self.advice = Advice(turn, self.health, self.deployment)
        self.following = Following(
            spec, turn, self.situation, self.exclusion, settings.window_ns, compiler=compiler, on_board=on_board
        )
        self.held_outputs = HeldOutputs(spec, turn, self.health, self.deployment)
        self.silences = Silences(
            spec, turn, self.health, self.deployment, failed=lambda: self.situation.failed.elements
        )
        self.script = HeldScript(spec, turn)
        self.authenticity: Authenticity | None = None
        if key is not None:
            self.authenticity = Authenticity(spec, turn, key, digest_of=self._digest_of, speaks=claim.speaks)
        reader = ObjectReader(turn.do)
        self.served = OneServed(reader)
        self.details = PeDetails(settings, turn, claim, reader)
        self.bringing = TableBringing(
            settings,
            turn,
            claim,
            self.health,
            deployment=self.deployment,
            situation=self.situation,
            served=self.served,
        )
        self.unknown_nodes = UnknownNodes(settings, turn, claim)
        self.code = CodeBringing(
            settings,
            turn,
            claim,
            self.health,
            self.deployment,
            situation=self.situation,
            served=self.served,
        )

    def forget(self) -> None:
        """Forget what this manager knows, except what `memory` and `details` hold."""
        self.health.forget(self._turn.now_ns)
        self.exclusion.forget()
        self.situation.forget()  # after `health`: a PE with a remembered fault is barred there
        self.deployment.forget()
        self.advice.forget()
        self.following.forget()
        self.held_outputs.forget()
        self.silences.forget()
        self.script.forget()
        if self.authenticity is not None:
            self.authenticity.forget()

    def _digest_of(self, epoch: int) -> int | None:
        """Return the digest of an epoch of this manager, or of one that it followed; None: not known."""
        known = self.deployment.digest_of(epoch)
        return self.following.digest_of(epoch) if known is None else known

    def unknown_epoch(self) -> int | None:
        """Return the running epoch if this manager does not know its configuration; else None."""
        return self.deployment.unknown_epoch(self.following.leased_epoch())

    def validate(self) -> None:
        """Check the invariants of what is known; raises InvariantError, which lists the recent events."""
        self.deployment.validate()
        if not self._settings.advise:
            self._validate_memory()
        if self._claim.state in (Mastership.LISTENING, Mastership.STANDBY):
            opened = self.deployment.next or self.deployment.current
            require(opened is None, "a manager that is not active has an epoch: {}", self._turn.recent)

    def _validate_memory(self) -> None:
        """Check that the memory agrees with what this manager knows, in all that a restart must restore.

        This is the phase, the latched faults, the losses of each PE in quarantine, and the current epoch with
        its digest. Raises InvariantError if the memory differs in one of them.
        """
        memory, situation, recent = self._turn.memory, self.situation, self._turn.recent
        current, runs = self.deployment.current, memory.runs
        require(memory.phase in (None, situation.phase), "the phase is not remembered: {}", recent)
        require(memory.latched.keys() == situation.failed.elements, "latched faults are not remembered: {}", recent)
        pes = filter(self.health.is_quarantined, self._settings.spec.pes)
        quarantined = {pe: self.health.losses(pe) for pe in pes}
        require(memory.quarantined == quarantined, "quarantines are not remembered: {}", recent)
        if current is not None:
            told = runs is not None and (runs.epoch, runs.digest) == (current.epoch, current.compiled.digest)
            require(told, "what runs is not remembered: {}", recent)
