"""The period of a module's steps, and how long one step may take."""

from heronry_wire.protocol_times import FRESH_PERIODS

NS_MHZ = 1_000_000_000_000
"""Divided by a rate in mHz, this constant gives the period in ns (10^9 ns/s times 10^3 mHz/Hz)."""

HUNG_NS = 100_000_000


def hung_ns(rate_mhz: int) -> int:
    """Time in ns that a step may spend; after that the module, which runs at `rate_mhz`, counts as hanging."""
    return max(HUNG_NS, FRESH_PERIODS * NS_MHZ // rate_mhz)
