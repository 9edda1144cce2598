"""Forwarding: which frames this PE carries from bus to bus, and in which order they wait for a radio.

*What is decided.* For each frame, the ports on which it leaves. On a PE with one bus nothing is forwarded.

    gateway        commands down, states and reports up, data where the slice says: one look-up per frame
    radios         takes the frames to radios out of the actions of a turn, and puts in those that may go now
      radio_port     one frame at a time in the controller, and how fast the radio is
      radio_queue    most urgent first, and only the newest of each kind
      link_meter     the usable bandwidth, measured and never asked of the radio

*Who may change it.* The slice (`gateway.rewire`, with each step of activation), and what comes from each bus. The order
in a queue follows from the identifiers and their classes alone. Whether an exclusive frame may pass is asked of
`authority`.

*What may go wrong.* A frame that was lost or thinned out is followed by a newer one; what may not be lost is never
replaced in a queue. A frame that comes late or twice is forwarded as it comes, since its receiver knows an old one. A
forged frame is forwarded like a true one. After a restart no data are forwarded until there is a slice, and the
bandwidth is measured anew.

The protocol: docs/protocol/radios.md.
"""

from heronry_agent.core.forwarding.gateway import Gateway
from heronry_agent.core.forwarding.radio_queue import CAPACITY
from heronry_agent.core.forwarding.radios import Radios

__all__ = ["CAPACITY", "Gateway", "Radios"]
