"""Checkpoints: the states of modules, which this PE sends, keeps, and gives to a module that starts (protocol rule 10).

*What is decided.* When the state of a running module is saved, and its frames are sent; which states that are heard are
believed; with which state, or why without one, a module starts.

    checkpoints    asks the three others; what a start gets, and what is reported of it
      sending        the rounds of the modules that run here
      reports        with which state a module has started, and which state cannot be saved
      keeping        the newest whole state of each module that may run here; what a gateway forwards

*Who may change it.* A state is kept if a module on this PE has saved it, or if a possible PE of the module has sent it
while the module does not run here. A newer one replaces it. A start that uses the state takes it away, unless the
module goes on with its present object.

*A state that makes its module fail.* A module that started from a state is on trial for TRIAL_NS. If it fails
meanwhile, or fails again before its last failure is forgiven (`restarts`), or is given up, all its states are
discarded: those of this PE, and with an empty state, sent once, those of the other possible PEs. So the next start is
one without a state, here or elsewhere. If the empty state is lost, the next PE makes the same experience, and sends it
again. Otherwise a module that fails is restarted from its newest state.

*What may go wrong.*

    lost       A lost frame costs its round (`checkpoint_frames`): the state before it stays, and gets older
    late       The age of a state counts from its arrival, plus the longest time that its last frame may have taken
               since `save` was called. A frame that waits longer for this PE or its bus than this time allows is
               dropped, here and at gateways, and a round that lasts longer is never whole. So no delay makes a state
               look young; only a controller that repeats a frame again and again can. A round that is not sent when
               the next state is saved is cut off. No frame is sent beyond the authorization of this PE's identifiers:
               a PE that may have been replaced sends no states
    doubled    A copy of a frame has no effect
    forged     A forged state is taken as a true one if its CRC is right, and a forged empty one takes the state away:
               checkpoints are data, and have no tag. A PE that runs the module takes no state of it
    restart    All states of this PE are gone. The first new state comes within one period
    crash      Of a sender in a round: the round is never whole, and the state before it counts

The page: docs/checkpoints.md.
"""

from heronry_agent.core.checkpoints.checkpoints import Checkpoints

__all__ = ["Checkpoints"]
