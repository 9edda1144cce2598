"""Campaigns against the processes of devices, with real agents and a manager on a software bus.

    python -m lab.driver_campaigns.ends --number 100      pauses and kills of agents and drivers of a DEMUX's branches
    python -m lab.driver_campaigns.strikes --number 500   drivers that exit, crash, hang, give garbage, flood, are slow

Files stand for the hardware (`hardware`). A campaign prints what it has counted, and ends with 1 if anything was
otherwise than declared.
"""
