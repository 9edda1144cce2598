"""Converts the core's action StartModule into the order for the process that runs the module."""

from heronry_agent.core.step_times import NS_MHZ
from heronry_agent.core.vocabulary import StartModule
from heronry_agent.shell.module_runner import Orders


def orders_of(action: StartModule) -> Orders:
    """Return the order that starts the module of `action`."""
    entry, mode = action.entry, action.entry.modes[action.mode]
    needed = tuple({leaf.variable: None for leaf in mode.leaves})
    known = tuple({leaf.variable: None for each in entry.modes for leaf in each.leaves})
    return Orders(entry.name, entry.image, mode.name, NS_MHZ // mode.rate_mhz, entry.device, needed, known)
