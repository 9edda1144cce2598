"""CANopen: this PE as tools of other makers see it. No part of the agent depends on an answer that is given here.

*What is decided.* How a request of a CANopen master (CiA 301) or of a CANaerospace node service is answered.

    canopen_node         hands each service its frames, and sends the answers
    network_management   INITIALISING ─► PRE_OPERATIONAL ◄─► OPERATIONAL, STOPPED: boot-up, heartbeat, NMT commands
    sdo_server           idle ─► one transfer ─► idle: expedited, segmented or by blocks
    object_dictionary    which objects may be read and written, by index
    pe_objects           what each object of a PE says: the parts of the agent are asked when a client asks
    given_table          none ─► given: the table that a client has written, checked for this node
    programs             the door to the loader of code, where this PE has one
    node_services        IDS, NSS, TIS and STS

*Who may change it.* Any node may send these requests, so none of them may stop what a manager has started: NMT moves
only the state of this room, and SDO writes only what is for people. Which objects exist stands in
`heronry_wire.canopen_objects`; a new one needs a line there and its answer in `pe_objects`.

*What may go wrong.* A lost answer ends a transfer by time, and the client tries again. A doubled segment is told by
its toggle bit. With a key NMT and SDO downloads are refused until the manager opens the lock (`authority`). After a
restart the boot-up frame says that everything is forgotten. A failure here affects no other part.

The page: docs/canopen.md.
"""

from heronry_agent.core.canopen.canopen_node import CanopenNode
from heronry_agent.core.canopen.given_table import GivenTable
from heronry_agent.core.canopen.pe_objects import Parts
from heronry_agent.core.canopen.programs import Programs
from heronry_agent.core.canopen.received_parts import ReceivedParts
from heronry_agent.core.canopen.sdo_server import SdoServer

__all__ = ["CanopenNode", "GivenTable", "Parts", "Programs", "ReceivedParts", "SdoServer"]
