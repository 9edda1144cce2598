"""What a part of intake is given that carries out, in the whole core, what other nodes have sent."""

from heronry_manager.core.heartbeat import Beat
from heronry_manager.core.intake.reactions import Reactions
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.mastership import Claim
from heronry_manager.core.planning import Replanning
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn


class Hearer:
    """Knows the rooms that are told what was heard."""

    def __init__(
        self,
        settings: ManagerSettings,
        turn: Turn,
        claim: Claim,
        known: Knowledge,
        *,
        beat: Beat,
        replanning: Replanning,
        reactions: Reactions,
    ) -> None:
        self._settings, self._turn, self._claim, self._known = settings, turn, claim, known
        self._beat, self._replanning, self._reactions = beat, replanning, reactions
        self._health, self._exclusion, self._situation = known.health, known.exclusion, known.situation
        self._deployment, self._following = known.deployment, known.following
