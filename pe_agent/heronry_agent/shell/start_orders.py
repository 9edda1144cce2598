"""Converts a StartModule of the core into the orders for the process that runs the module."""

from heronry_agent.core.schedule import NS_MHZ
from heronry_agent.core.vocabulary import StartModule
from heronry_agent.shell.module_runner import Orders


def orders_of(action: StartModule) -> Orders:
    """Give name, image, mode and period of the module that is to run."""
    entry, mode = action.entry, action.entry.modes[action.mode]
    return Orders(entry.name, entry.image, mode.name, NS_MHZ // mode.rate_mhz, entry.device is not None)
