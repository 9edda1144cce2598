"""How late processes run on this computer under its present load, and the heartbeat period that nodes can keep here.

The measurement is a short rehearsal with as many processes as there will be in the flight. Each process wakes at
regular times, computes for a moment, and notes how late it ended, without the time that its own computation took. A
single process that only sleeps would be no measure: the kernel lets it run at once, while many processes have to wait
for each other.

A node that is late by L sends its state L late. With the heartbeat period P, other nodes then hear nothing from it for
P + L. The manager takes a node for lost after 3.25 P of silence, so P must be more than L / 2.25. With a period of 2 L,
the node may become more than four times as late as in the rehearsal. This is a reserve, since the rehearsal is short
and may not meet the worst case.

A page and the browser that shows it come later, and take more than the nodes. So a rehearsal for them has processes
beside it that compute without end, each in a session of its own: Linux shares the processors among sessions first.
"""

import os
import time
from contextlib import suppress
from dataclasses import replace

from heronry_dg.model import Spec
from heronry_wire.protocol_times import USUAL_HEARTBEAT_NS

LONGEST_HEARTBEAT_NS = 16 * USUAL_HEARTBEAT_NS
_GRID_NS, _WORK_NS = 10_000_000, 400_000  # about what an agent of the shipped aircraft takes


def latest_wake_up_ns(processes: int, seconds: float, niceness: int = 0, beside: int = 0) -> int:
    """Let `processes` processes wake at regular times for `seconds` s; return the greatest lateness of all, in ns.

    niceness: nice value of these processes (setpriority(2)); a negative value is ignored if this user may not set it.
    beside: how many processes compute without end meanwhile, each in a session of its own.
    """
    end_ns = time.monotonic_ns() + round(seconds * 1e9)
    pipe, theirs = os.pipe()
    children = []
    try:
        for _ in range(beside):
            child = os.fork()
            if child == 0:
                _compute(end_ns)
            children.append(child)
        for _ in range(processes):
            child = os.fork()
            if child == 0:
                _rehearse(theirs, end_ns, niceness)
            children.append(child)
    finally:
        os.close(theirs)
        with os.fdopen(pipe, "rb") as answers:
            worst_ns = max((int(answer) for answer in answers), default=0)
        for child in children:
            os.waitpid(child, 0)
    return worst_ns


def kept_heartbeat_ns(late_ns: int) -> int:
    """Return the heartbeat period that a node can keep if it is up to `late_ns` late.

    The usual period is doubled until it is at least twice `late_ns`. The result is never longer than
    LONGEST_HEARTBEAT_NS, even if the node cannot keep that period.
    """
    period_ns = USUAL_HEARTBEAT_NS
    while period_ns < 2 * late_ns and period_ns < LONGEST_HEARTBEAT_NS:
        period_ns *= 2
    return period_ns


def with_heartbeat(spec: Spec, at_least_ns: int) -> Spec:
    """Return the spec with each heartbeat period that is shorter than `at_least_ns` lengthened to it.

    The digest of the spec stays the same.
    """
    slower = (replace(bus, heartbeat_ns=max(bus.heartbeat_ns, at_least_ns)) for bus in spec.buses.values())
    return replace(spec, buses={bus.name: bus for bus in slower})


def _compute(end_ns: int) -> None:
    """Compute in this child process until `end_ns`, in a session of its own, and exit."""
    try:
        os.setsid()
        while time.monotonic_ns() < end_ns:
            pass
    finally:
        os._exit(0)


def _rehearse(pipe: int, end_ns: int, niceness: int) -> None:
    """Work periodically in this child process until `end_ns`, write its largest lateness (ns), and exit.

    pipe: file descriptor to which the lateness is written.

    niceness: nice value for this process; ignored if this user may not set it.
    """
    worst_ns = max(0, time.monotonic_ns() - end_ns)  # a process that begins after the end is late, too
    try:
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, niceness)
        due_ns = time.monotonic_ns() + _GRID_NS
        while due_ns < end_ns:
            time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
            used_ns = time.thread_time_ns()
            while time.thread_time_ns() - used_ns < _WORK_NS:
                pass
            worst_ns = max(worst_ns, time.monotonic_ns() - due_ns - _WORK_NS)
            due_ns = max(due_ns + _GRID_NS, time.monotonic_ns())
        os.write(pipe, b"%d\n" % worst_ns)
    finally:
        os._exit(0)
