"""Ends a process that an agent has started, when the agent ends."""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def die_with(agent: int, by: signal.Signals = signal.SIGKILL) -> None:
    """Have the kernel send a signal to this process when the process `agent` ends; exit if `agent` has ended already.

    The process gets the signal also in the middle of a computation; a program that it has started does not get it.
    """
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, by)
    if os.getppid() != agent:
        sys.exit(1)
