"""Makes the objects of a manager's core that process frames, each after the objects that it needs."""

from heronry_manager.core.heartbeat.beat import Beat
from heronry_manager.core.intake.reactions import Reactions
from heronry_manager.core.knowledge import Knowledge
from heronry_manager.core.mastership.claim import Claim
from heronry_manager.core.planning.replanning import Replanning
from heronry_manager.core.planning.requests import Planning
from heronry_manager.core.settings import ManagerSettings
from heronry_manager.core.turn import Turn


class Parts:
    """The objects of a manager's core that `pe_reports`, `succession` and `inbound` call to process frames."""

    def __init__(self, settings: ManagerSettings, turn: Turn) -> None:
        self.settings, self.turn = settings, turn
        self.claim = Claim(settings, turn)
        self.known = Knowledge(settings, turn, self.claim)
        self.beat = Beat(settings, turn, self.known)
        self.replanning = Replanning(settings, turn, self.claim, self.known, Planning(turn))
        self.reactions = Reactions(turn, self.claim, self.known, self.beat, self.replanning)
