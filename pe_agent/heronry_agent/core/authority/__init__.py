"""Authority: which commands this PE accepts, and whether it may drive what must never have two drivers.

*What is decided.* Whose word counts, and for how long. Everything that a PE does on command, or to something exclusive,
is asked here first.

    followed_manager       the manager of the highest term, and whether its lease still runs
    authenticity           with a key: which commands a holder of the key has sent, and since when this PE is overtaken
      nonces                 numbers used once, which a WELCOME must answer
      passing_welcomes       WELCOMEs for other nodes, which a gateway cannot check
      state_seal             the session with the manager, and the tags of this PE's own states
    output_authorization   whether an exclusive output may be driven at this moment
    exclusive_frames       which data frames are exclusive, and when those that wait for the bus are withdrawn
    twin                   with a key: whether another PE already has this node-ID. Only a PE that starts asks

*Who may change it.* Frames of other nodes, and the time. The authorization is computed from the time of each question,
so a pause of the process needs no event. The steps that a PE takes (`configuration`) end that it is overtaken.

*What may go wrong.*

    lost       A lost LEASE, ALIVE or TAG can only take a right away. The next one, a period later, gives it back
    late       A command counts from its own arrival, whenever its TAG comes. A nonce serves for T_lease
    doubled    A number of a command counts once
    forged     Without a key a forged ALIVE could release outputs, and a forged LEASE holds them back until the next
               true one. With a key forged commands are refused and counted
    restart    Nothing is followed, authorized or proven until frames have shown it

The protocol: docs/protocol/exclusion.md and docs/protocol/authentication.md.
"""

from heronry_agent.core.authority.authenticity import Authenticity, Secret
from heronry_agent.core.authority.exclusive_frames import ExclusiveFrames
from heronry_agent.core.authority.followed_manager import NO_TERM, FollowedManager
from heronry_agent.core.authority.output_authorization import OutputAuthorization
from heronry_agent.core.authority.twin import Twin, TwinProof

__all__ = [
    "NO_TERM",
    "Authenticity",
    "ExclusiveFrames",
    "FollowedManager",
    "OutputAuthorization",
    "Secret",
    "Twin",
    "TwinProof",
]
