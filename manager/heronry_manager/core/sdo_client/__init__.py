"""SDO clients: they read and write objects of PEs (CiA 301, 7.2.4), one value at a time. They decide nothing.

    object_reader    idle ─► opened ─► segments: reads objects, one at a time, and gives way to other clients
    one_served       free ─► served: one node is brought something at a time, and reading waits for it
    block_download   opened ─► sending ─► ended: writes one value into one node by block transfer

*Who may change it.* The rooms that have a client: `reports` reads what is for people, `provisioning` brings tables.

*What may go wrong.* A lost answer ends a try after a second. SDO proves nothing: a late, doubled or forged answer may
give a wrong value, or end a transfer. Each room says what follows for it. A restart forgets every transfer.
"""

from heronry_manager.core.sdo_client.block_download import BlockDownload, Outcome
from heronry_manager.core.sdo_client.object_reader import ObjectReader
from heronry_manager.core.sdo_client.one_served import OneServed

__all__ = ["BlockDownload", "ObjectReader", "OneServed", "Outcome"]
