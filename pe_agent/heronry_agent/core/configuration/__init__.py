"""Configuration: what this PE is to run next, and how that replaces what runs.

*What is decided.* Two things, one after the other. Staging decides whether the next slice can run here, before
anything changes. Activation decides which modules stop and start at each step.

    staging                nothing ─► collecting ─► staged: PREPARE and the frames of a SLICE, in any order
      slice_reading          whether the bytes are a slice that this PE can run, and the reason if not
    active_configuration   UNCONFIGURED, BROKEN ─► PARTIAL ─► ACTIVE: the steps BREAK, GO and GO_ALL

It says which modules move (`Moves`) and moves none itself: `modules` does that.

*Who may change it.* Accepted commands (`command_acceptance`) prepare and take steps. A module that failed, or that
rests while no manager is heard, is taken out of what runs; only a command brings it back.

*What may go wrong.*

    lost       A missing frame is asked for by page 1 of the state; the manager repeats each command. LEASE names the
               step in each period, and a step contains those before it
    late       An epoch never goes back, and a step is taken once, so an older command changes nothing
    doubled    A frame of a slice that is there already changes nothing
    forged     A slice must have the digest that PREPARE has named. With a key only proven commands come here
    restart    Nothing is staged and nothing runs

The protocol: docs/protocol/reconfiguration.md.
"""

from heronry_agent.core.configuration.active_configuration import ActiveConfiguration, Moves
from heronry_agent.core.configuration.slice_reading import SliceReader
from heronry_agent.core.configuration.staging import Configured, Staging

__all__ = ["ActiveConfiguration", "Configured", "Moves", "SliceReader", "Staging"]
