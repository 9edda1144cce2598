"""Reports: what this PE tells without being asked, how often, and until when. It does not decide what is true.

    reporting         pages 0 and 1 of the state, in this node's time slot; `Facts` is what they say
    faults            pending ─► acknowledged: faults and requests, repeated until the manager acknowledges them
      error_history     the last errors, newest first, for a CANopen client
    silence_reports   begun, over: inputs and outputs that are silent, one report in a period
    channel_reports   lost, back: channels of a replicated bus

*Who may change it.* Whoever finds a fact hands it over: `modules` a fault or a silence, the driver a lost channel,
`condition` (above the rooms) the facts of the state. An acknowledgement of the manager ends a pending report; CLEAR
takes a fault off the record. Each kind of EMCY stands in `heronry_wire.management` (`FaultCode`).

*What may go wrong.*

    lost       What must arrive is repeated in each period until it is acknowledged; all else is told again in time
    late       A report that waited through a pause is sent once
    doubled    A request has a number, so that it is executed once
    forged     A forged acknowledgement silences a fault for a second
    restart    The record is empty; the manager keeps its own

The protocol: docs/protocol/faults.md and docs/protocol/channels.md.
"""

from heronry_agent.core.reports.channel_reports import ChannelReports
from heronry_agent.core.reports.faults import Faults
from heronry_agent.core.reports.reporting import Facts, Reporting
from heronry_agent.core.reports.silence_reports import SilenceReports

__all__ = ["ChannelReports", "Facts", "Faults", "Reporting", "SilenceReports"]
