"""A partition as its agent sees it: a process with one socket, a memory limit, and a measure of the time it spends.

No method ever waits. A packet is sent immediately; if the partition does not read, it is given up. A process is reaped
when the kernel reports its end. The process is started by exec, not by fork: so it inherits no bus, no key and no
table, and is smaller. Its environment has only what Python needs. It has a lower priority than its agent, so that
heartbeats go first.

The orders of one turn of the agent form one packet. For GATHER_NS after the packet the answers do not wake the agent.
So the steps of several modules, and of several partitions, wake the agent once and not once each.

The time that a step has *spent* does not include waiting for a processor. For a finished step the kernel has counted
that wait (schedstat). For an unfinished step the present wait is not counted yet: if the process is ready to run, only
its processor time counts. If the kernel does not count waiting, only processor time is known. The waiting time before a
step is read once in SAMPLE_NS, and again after a late step. The waits in the steps since the last reading are
subtracted as well, which favours the module. The agent too may have to wait for a processor. So a step begins when its
order was sent, and ends when its answer has arrived, whether the agent has read it or not.

When the code has been loaded, the agent sets RLIMIT_DATA. The limit is the memory that the process holds, plus the RAM
that the spec gives its modules, plus SLACK_BYTES for the interpreter, which spec authors do not count. A module that
exceeds the limit gets a MemoryError in its own step, or the process ends in C code. If the agent has control groups
(`partition_groups`), the same limit holds for the partition with its child processes and shared memory; the kernel
kills a partition that exceeds it.
"""

import os
import resource
import signal
import socket
import sys
import time
from collections import Counter, deque
from contextlib import suppress
from dataclasses import dataclass

from heronry_agent.shell.partition_groups import PartitionGroups
from heronry_agent.shell.partition_messages import ANSWER_BYTES, SOCKET, Order, encode_orders

SLACK_BYTES = 8 * 1024 * 1024
GATHER_NS = 1_000_000
SAMPLE_NS = 1_000_000_000

_INHERITED = ("HOME", "LANG", "LD_LIBRARY_PATH", "PATH", "TZ", "VIRTUAL_ENV")
_STATM_DATA, _PAGE_BYTES = 5, os.sysconf("SC_PAGE_SIZE")
_CPU_CLOCK = 2  # clock number of a process's CPU time, as clock_getcpuclockid(3) makes it
_RUNNABLE = "R"
_STANDS_BACK = 5  # steps of "niceness"


@dataclass(slots=True)
class _PendingStep:
    """A step that has not been answered."""

    module: int
    release: int
    since_ns: int | None = None  # when the order was sent, or the step before ended; None: not sent yet
    cpu_ns: int = 0  # processor time of the partition at that time
    is_wanted: bool = True  # false if its module has been stopped since


class PartitionProcess:
    """The process of a partition, from its exec to its end."""

    def __init__(self, name: str, ram: int, groups: PartitionGroups | None = None) -> None:
        """Start the process; `ram` is the RAM in bytes that the spec gives its modules. Raises OSError."""
        self.name, self._ram, self._groups = name, ram, groups
        self.loading = True
        self.broken: str | None = None  # why the partition cannot be used any more
        self.refusals_due: Counter[int] = Counter()  # STARTs that the partition may still refuse, by module
        self._pending: deque[_PendingStep] = deque()
        self._orders: list[Order] = []  # to be sent when the turn ends
        self._waited_before_ns = 0  # the process's waiting time when last read, between two steps
        self._sample_ns = 0  # when to read the waiting time again
        self.gathers = False  # not to be selected on: the answers are read together at `look_ns`
        self.look_ns = 0
        self._begun_ns = time.monotonic_ns()
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        with theirs:
            self.pid = _spawn(name, theirs.fileno())
        self._group = None if groups is None else groups.enclose(self.pid)
        os.setpriority(os.PRIO_PROCESS, self.pid, os.getpriority(os.PRIO_PROCESS, 0) + _STANDS_BACK)
        self._schedstat = _open(f"/proc/{self.pid}/schedstat")

    def fileno(self) -> int:
        """File descriptor of the socket, for select."""
        return self._socket.fileno()

    @property
    def owes(self) -> bool:
        """Tell whether the partition has not answered an order yet."""
        return self.loading or bool(self._pending)

    @property
    def computing(self) -> int | None:
        """Module whose step the partition computes; None when there is no step to answer."""
        return self._pending[0].module if self._pending else None

    def send(self, order: Order) -> None:
        """Queue an order for the next `flush`."""
        self._orders.append(order)

    def flush(self, now_ns: int) -> None:
        """Send the queued orders as one packet; a partition that cannot take it is broken."""
        if not self._orders:
            return
        orders, self._orders = self._orders, []
        if self._pending:
            self.gathers, self.look_ns = True, now_ns + GATHER_NS
        cpu_ns = self._cpu_ns() if self._pending else 0
        try:
            self._socket.send(encode_orders(orders))
        except BlockingIOError:
            self.broken = "it does not read its orders"
        except OSError:
            pass  # the process has ended, which the socket will show
        told_ns = time.monotonic_ns()
        for pending in self._pending:
            if pending.since_ns is None:
                pending.since_ns, pending.cpu_ns = told_ns, cpu_ns

    def expect(self, module: int, release: int, now_ns: int) -> None:
        """Note that a step has been ordered."""
        if not self._pending and now_ns >= self._sample_ns:
            self._waited_before_ns, self._sample_ns = self._waited_ns(), now_ns + SAMPLE_NS
        self._pending.append(_PendingStep(module, release))

    def answered(self, module: int, release: int, ended_ns: int, period_ns: int) -> int | None:
        """Take the answer to a step.

        Gives the time in ns that the step has spent, or None if no such step was ordered.
        """
        if not self._pending or (self._pending[0].module, self._pending[0].release) != (module, release):
            return None
        pending = self._pending.popleft()
        if self._pending and self._pending[0].since_ns is not None:
            self._pending[0].since_ns = max(self._pending[0].since_ns, ended_ns)
            self._pending[0].cpu_ns = self._cpu_ns()
        took_ns = max(0, ended_ns - (pending.since_ns or ended_ns))
        if took_ns <= period_ns:
            return took_ns
        if self._schedstat is None:
            return self._cpu_ns() - pending.cpu_ns
        self._sample_ns = 0  # read the waiting time before the next step
        return max(0, took_ns - (self._waited_ns() - self._waited_before_ns))

    def disown(self, module: int) -> None:
        """Mark the steps of a module that has been stopped: their answers are not wanted."""
        for pending in self._pending:
            pending.is_wanted = pending.is_wanted and pending.module != module

    def unwanted(self, now_ns: int) -> tuple[int, int] | None:
        """Give a stopped module that still computes, and the ns that its step has spent; None if there is none."""
        if not self._pending or self._pending[0].is_wanted:
            return None
        first = self._pending[0]
        return first.module, self.spent_ns(first.module, first.release, now_ns)

    def spent_ns(self, module: int, release: int, now_ns: int) -> int:
        """Time in ns that an unfinished step has spent; 0 if it has not begun, or its answer has arrived."""
        if (
            self.loading
            or not self._pending
            or (self._pending[0].module, self._pending[0].release) != (module, release)
        ):
            return 0
        pending = self._pending[0]
        if pending.since_ns is None or self._has_spoken():
            return 0
        if self._schedstat is None or _state(self.pid) == _RUNNABLE:
            return self._cpu_ns() - pending.cpu_ns
        return max(0, now_ns - pending.since_ns - (self._waited_ns() - self._waited_before_ns))

    def loading_ns(self, now_ns: int) -> int:
        """Time in ns that the process has spent since its start, without waiting for a processor."""
        if self._schedstat is None or _state(self.pid) == _RUNNABLE:
            return self._cpu_ns()
        return now_ns - self._begun_ns - self._waited_ns()

    def _has_spoken(self) -> bool:
        """Tell whether there is an answer to read, or the process has ended."""
        try:
            self._socket.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            pass  # the process has ended
        return True

    def receive(self) -> bytes | None:
        """Read the next packet; None if there is none, or the process has ended (`broken` is set then)."""
        try:
            packet = self._socket.recv(ANSWER_BYTES + 1)
        except BlockingIOError:
            return None
        except OSError:
            packet = b""
        if not packet:
            self.broken = self.broken or ""
            return None
        return packet

    def limit_memory(self) -> None:
        """Limit the memory of the process to what it holds now, plus the RAM of its modules and SLACK_BYTES."""
        try:
            with open(f"/proc/{self.pid}/statm", encoding="ascii") as statm:  # noqa: PTH123 - no pathlib in the agent
                held = int(statm.read().split()[_STATM_DATA]) * _PAGE_BYTES
            most = held + self._ram + SLACK_BYTES
            resource.prlimit(self.pid, resource.RLIMIT_DATA, (most, most))
        except (OSError, ValueError):
            pass  # the process has ended, which the socket will show
        if self._group is not None:
            self._group.limit(self._ram + SLACK_BYTES)

    def kill(self) -> None:
        """Kill the process; `reap` tells when it is gone."""
        self._socket.close()
        if self._schedstat is not None:
            os.close(self._schedstat)
            self._schedstat = None
        if self._group is not None:
            self._group.kill()
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)

    def reap(self) -> str | None:
        """Say how the process ended; None while it has not ended."""
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        if not pid:
            return None
        code = os.waitstatus_to_exitcode(status)
        if self._groups is not None and self._group is not None and self._groups.retire(self._group):
            return "it took more memory than its limit"
        return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"

    def _waited_ns(self) -> int:
        """Time in ns that the process has waited for a processor, without its present wait."""
        if self._schedstat is None:
            return 0
        try:
            return int(os.pread(self._schedstat, 80, 0).split()[1])
        except (OSError, IndexError):
            return 0  # the process has ended

    def _cpu_ns(self) -> int:
        try:
            return time.clock_gettime_ns((~self.pid << 3) | _CPU_CLOCK)
        except OSError:
            return 0  # the process has ended


def _spawn(name: str, theirs: int) -> int:
    environment = {k: v for k, v in os.environ.items() if k in _INHERITED or k.startswith(("LC_", "PYTHON"))}
    return os.posix_spawn(
        sys.executable,
        [sys.executable, "-m", "heronry_agent.shell.partition", str(os.getpid()), name],
        environment,
        file_actions=[
            (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
            (os.POSIX_SPAWN_DUP2, 2, 1),
            (os.POSIX_SPAWN_DUP2, theirs, SOCKET),
        ],
        setpgroup=0,
    )


def _open(path: str) -> int | None:
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None


def _state(pid: int) -> str:
    """State letter of a process as in ps(1); S when the process is gone."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as stat:  # noqa: PTH123
            return stat.read().rpartition(") ")[2][:1]
    except OSError:
        return "S"
