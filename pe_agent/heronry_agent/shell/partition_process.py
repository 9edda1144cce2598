"""The agent's side of a partition: the process, the socket to it, its memory limit, and the time that its steps take.

No method ever waits. If a partition does not read its packets, it is ended (`broken`). The process is started by exec,
and not by fork alone. So it inherits no bus, no key and no table, and is smaller. Its environment has only what Python
needs. The process has a lower priority than its agent, so that heartbeats go first.

The orders of one turn of the agent's loop form one packet. For GATHER_NS after such a packet, answers do not wake the
agent; after this time it reads them together.

*Time.* A step begins when its order is sent, when the step before it in the partition ends, or when the answer about a
state that was saved or restored before it is read, whichever is last. The kernel counts for how long a process has
waited for a processor (schedstat). The time that a step has *spent* is:

    the step has ended within its period                      the time from its beginning to its end
    the step has ended later                                  this time, less the time of waiting for a processor
    the step has not ended, and the process sleeps            the time since its beginning, less the time of waiting
    the step has not ended, and the process runs or waits     the processor time that the step has used: the kernel adds
    for a processor                                           a wait only when the wait is over

If the kernel does not count waiting times, the processor time also takes the place of the second and third value. The
count of waiting times is read only once in SAMPLE_NS and after a late step, and not at the beginning of each step. So
the waiting time of earlier steps may be subtracted as well: the time spent may be too short, but not too long.

*Memory.* When the code has been loaded, the agent sets RLIMIT_DATA. The limit is the memory that the process holds at
this moment, plus the RAM that the spec gives its modules, plus SLACK_BYTES for the interpreter. If a module exceeds the
limit, Python raises MemoryError in its step, or C code ends the process. If the agent has control groups
(`partition_groups`), such a limit also holds for the partition together with its child processes and shared memory. The
kernel kills a partition that exceeds this limit.
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
from heronry_agent.shell.partition_log import PartitionLog
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
    """A step that has been ordered and not answered."""

    module: int
    release: int
    since_ns: int | None = None  # when the order was sent, or the step before ended; None: not sent yet
    cpu_ns: int = 0  # processor time of the partition at that time
    is_wanted: bool = True  # false if its module has been stopped since


class PartitionProcess:
    """The agent's side of one partition: starts the process, sends orders to it, and measures its steps."""

    def __init__(self, name: str, ram: int, groups: PartitionGroups | None = None, code: str | None = None) -> None:
        """Start the process; raises OSError.

        ram: RAM in bytes that the spec gives the modules of the partition.
        groups: control groups for partitions; None: none are used.
        code: file or folder from which it imports before all others; None: there is none.
        """
        self.name, self.code, self._ram, self._groups = name, code, ram, groups
        self.loading = True
        self.broken: str | None = None  # why the partition cannot be used any more
        self.refusals_due: Counter[int] = Counter()  # STARTs that the partition may still refuse, by module
        self.states_due: Counter[int] = Counter()  # answers about states that may still come, by module
        self._pending: deque[_PendingStep] = deque()
        self._orders: list[Order] = []  # to be sent when the turn ends
        self._waited_before_ns = 0  # the process's waiting time when last read, between two steps
        self._sample_ns = 0  # when to read the waiting time again
        self.gathers = False  # True: `select` is not to wait for this partition; its answers are read at `look_ns`
        self.look_ns = 0
        self._begun_ns = time.monotonic_ns()
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.setblocking(False)
        self.log = PartitionLog(name)
        try:
            with theirs:
                self.pid = _spawn(name, theirs.fileno(), self.log.writer, code)
        finally:
            self.log.handed_over()
        self._group = None if groups is None else groups.enclose(self.pid)
        os.setpriority(os.PRIO_PROCESS, self.pid, os.getpriority(os.PRIO_PROCESS, 0) + _STANDS_BACK)
        self._schedstat = _open(f"/proc/{self.pid}/schedstat")

    def fileno(self) -> int:
        """File descriptor of the socket, for select."""
        return self._socket.fileno()

    @property
    def owes(self) -> bool:
        """Tell whether an answer of the partition is still to come."""
        return self.loading or bool(self._pending)

    @property
    def computing(self) -> int | None:
        """Module whose step is being computed; None if the partition has answered all steps."""
        return self._pending[0].module if self._pending else None

    @property
    def has_orders(self) -> bool:
        """Tell whether orders are queued."""
        return bool(self._orders)

    def send(self, order: Order) -> None:
        """Queue an order for the next `flush`."""
        self._orders.append(order)

    def flush(self, now_ns: int) -> None:
        """Send the queued orders as one packet; if the partition does not take it, `broken` is set."""
        if not self._orders:
            return
        orders, self._orders = self._orders, []
        if self._pending:
            self.gathers, self.look_ns = True, now_ns + GATHER_NS
        cpu_ns = used_ns(self.pid) if self._pending else 0
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
        """Note that a step is ordered; call this before `send`."""
        if not self._pending and now_ns >= self._sample_ns:
            self._waited_before_ns, self._sample_ns = self._waited_ns(), now_ns + SAMPLE_NS
        self._pending.append(_PendingStep(module, release))

    def answered(self, module: int, release: int, ended_ns: int, period_ns: int) -> int | None:
        """Note the answer to a step; returns the time in ns that the step has spent.

        Returns None if this is not the step that the partition has to answer next.
        ended_ns: when the step ended.
        period_ns: period of the module; if the step is shorter than this, the time of waiting for a processor is not
        subtracted.
        """
        if not self._pending or (self._pending[0].module, self._pending[0].release) != (module, release):
            return None
        pending = self._pending.popleft()
        self._begin_next(ended_ns)
        took_ns = max(0, ended_ns - (pending.since_ns or ended_ns))
        if took_ns <= period_ns:
            return took_ns
        if self._schedstat is None:
            return used_ns(self.pid) - pending.cpu_ns
        self._sample_ns = 0  # read the waiting time before the next step
        return max(0, took_ns - (self._waited_ns() - self._waited_before_ns))

    def told_state(self, module: int, now_ns: int) -> None:
        """Note the answer about a state of a module: no step has spent the time before."""
        self.states_due[module] -= 1
        self._begin_next(now_ns)

    def _begin_next(self, at_ns: int) -> None:
        """Note that the next step begins at `at_ns` at the earliest."""
        if self._pending and self._pending[0].since_ns is not None:
            self._pending[0].since_ns = max(self._pending[0].since_ns, at_ns)
            self._pending[0].cpu_ns = used_ns(self.pid)

    def disown(self, module: int) -> None:
        """Note that a module has been stopped, so that answers to its steps are not wanted any more."""
        for pending in self._pending:
            pending.is_wanted = pending.is_wanted and pending.module != module

    def unwanted(self, now_ns: int) -> tuple[int, int] | None:
        """Return (module, spent time in ns) if the step of a stopped module is still being computed; otherwise None."""
        if not self._pending or self._pending[0].is_wanted:
            return None
        first = self._pending[0]
        return first.module, self.spent_ns(first.module, first.release, now_ns)

    def spent_ns(self, module: int, release: int, now_ns: int) -> int:
        """Return the time in ns that a step of a module has spent so far; 0 if this step is not being computed now."""
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
            return used_ns(self.pid) - pending.cpu_ns
        return max(0, now_ns - pending.since_ns - (self._waited_ns() - self._waited_before_ns))

    def loading_ns(self, now_ns: int) -> int:
        """Time in ns since the start of the process, less the time for which the process waited for a processor.

        If this cannot be known at the moment, the processor time of the process is given instead (see the file's head).
        """
        if self._schedstat is None or _state(self.pid) == _RUNNABLE:
            return used_ns(self.pid)
        return now_ns - self._begun_ns - self._waited_ns()

    def _has_spoken(self) -> bool:
        """Tell whether an answer can be read, or the process has ended."""
        try:
            self._socket.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            pass  # the process has ended
        return True

    def receive(self) -> bytes | None:
        """Read the next packet; None if no packet has come, or if the process has ended.

        If the process has ended, `broken` is set.
        """
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
        """Kill the process with the children of its process group; it still has to be reaped (`reap`)."""
        self._socket.close()
        if self._schedstat is not None:
            os.close(self._schedstat)
            self._schedstat = None
        if self._group is not None:
            self._group.kill()
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)

    def reap(self) -> str | None:
        """Return in words how the process has ended; None if it has not ended yet."""
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        if not pid:
            return None
        self.log.close()
        code = os.waitstatus_to_exitcode(status)
        if self._groups is not None and self._group is not None and self._groups.retire(self._group):
            return "it took more memory than its limit"
        return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"

    def _waited_ns(self) -> int:
        """Time in ns for which the process has waited for a processor; a wait that still lasts is not counted."""
        if self._schedstat is None:
            return 0
        try:
            return int(os.pread(self._schedstat, 80, 0).split()[1])
        except (OSError, IndexError):
            return 0  # the process has ended


def used_ns(pid: int) -> int:
    """Return the processor time of a process so far, in ns; 0 if it has ended."""
    try:
        return time.clock_gettime_ns((~pid << 3) | _CPU_CLOCK)
    except OSError:
        return 0


def _spawn(name: str, theirs: int, log: int, code: str | None) -> int:
    environment = {k: v for k, v in os.environ.items() if k in _INHERITED or k.startswith(("LC_", "PYTHON"))}
    if code is not None:
        environment["PYTHONPATH"] = os.pathsep.join((code, *filter(None, (environment.get("PYTHONPATH"),))))
    return os.posix_spawn(
        sys.executable,
        [sys.executable, "-m", "heronry_agent.shell.partition", str(os.getpid()), name],
        environment,
        file_actions=[
            (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
            (os.POSIX_SPAWN_DUP2, log, 1),
            (os.POSIX_SPAWN_DUP2, log, 2),
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
    """Return the state of a process as the letter that ps(1) shows; S if the process is gone."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as stat:  # noqa: PTH123
            return stat.read().rpartition(") ")[2][:1]
    except OSError:
        return "S"
