"""Ends a process together with the process that started it, however that one ends.

A helper whose standard input ends notices only while it runs. The kernel also kills a helper that computes, or that is
stopped (SIGSTOP).

A helper arranges this itself, at its start; so it must not be stopped before. Its parent could arrange it between fork
and exec (`preexec_fn`), but Python code that runs there may hang, and the parent with it, if the parent has threads.
"""

import ctypes
import os
import signal

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def die_with(parent: int, by: signal.Signals = signal.SIGKILL) -> None:
    """Have the kernel kill this process when the process `parent` ends; now, if `parent` has ended already.

    To be used only if the thread of `parent` that started this process lives as long as `parent`: the kernel
    already kills this process when that thread ends.

    by: the signal; one that can be handled lets this process end in order.
    """
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, by)
    if os.getppid() != parent:
        os.kill(os.getpid(), by)  # not SystemExit, which a handler after a fork ignores
