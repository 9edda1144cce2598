"""One partition as its agent holds it: a process started by exec, one socket to it, its memory limit, its time.

Nothing here ever waits. What is sent is sent at once or the partition is given up for one that does not read; what has
ended is reaped when the kernel says so. Exec, not fork: a partition inherits no bus, no key, no table, and is smaller;
its environment is cut down to what Python needs. From its exec on it stands back behind its agent, whose heartbeats go
first.

What it is told in one turn of the agent is one packet. For GATHER_NS after it nobody is woken by the answers, so that
the steps of several modules, and of several partitions, cost the agent one awakening and not one each.

Time that a partition *spent* leaves out what it waited for a processor: of a step that is over, the kernel has counted
that (schedstat); of one that is not, a process that could run is charged its processor time alone, since the wait that
it is in is not counted yet. Where the kernel counts no waiting, processor time is all there is. How long it had waited
before a step is read once in SAMPLE_NS, and anew after a step that was late: what it waited since then, in the steps
before, is taken off a charge as well, which is in its favour. The agent may have to wait for a processor, too: a step
counts from when the partition was told, and one whose answer is there, unread, is over.

Memory: RLIMIT_DATA, set from here when the code has been loaded, to what it holds then, what the spec gives its
modules, and SLACK_BYTES for the interpreter, which spec authors do not count. A module that goes beyond gets a
MemoryError in its own step, or dies of it in C. Where the agent has control groups to give away (`partition_groups`),
the same holds for the partition with all that it has started and shares; then the kernel kills it.
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
_CPU_CLOCK = 2  # of a process by its number, as clock_getcpuclockid(3) makes it
_RUNNABLE = "R"
_STANDS_BACK = 5  # steps of "niceness"


@dataclass(slots=True)
class _Asked:
    """A step that has not been answered."""

    module: int
    release: int
    since_ns: int | None = None  # it was told, or the step before it ended; None: it has not been told yet
    cpu_ns: int = 0  # processor time of the partition then
    is_wanted: bool = True  # its module has not been stopped since


class PartitionProcess:
    """A partition from its exec to its end."""

    def __init__(self, name: str, ram: int, groups: PartitionGroups | None = None) -> None:
        """Start it. `ram` is what the spec gives its modules, in bytes. Raises OSError."""
        self.name, self._ram, self._groups = name, ram, groups
        self.loading = True
        self.broken: str | None = None  # why it is no good any more
        self.refusals_due: Counter[int] = Counter()  # STARTs that it may still refuse, by module
        self._asked: deque[_Asked] = deque()
        self._orders: list[Order] = []  # what it is to be told when the turn ends
        self._waited_before_ns = 0  # what it had waited when that was last asked for, between two steps
        self._sample_ns = 0  # when to ask again
        self.gathers = False  # its answers come together until `look_ns`; nobody is woken for the first
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
        """Number of the socket, for select."""
        return self._socket.fileno()

    @property
    def owes(self) -> bool:
        """Tell whether it owes an answer."""
        return self.loading or bool(self._asked)

    @property
    def computing(self) -> int | None:
        """Module whose step it owes."""
        return self._asked[0].module if self._asked else None

    def send(self, order: Order) -> None:
        """Have it told something, when `flush` is called."""
        self._orders.append(order)

    def flush(self, now_ns: int) -> None:
        """Tell it all that it is to be told; one that does not take it is broken."""
        if not self._orders:
            return
        orders, self._orders = self._orders, []
        if self._asked:
            self.gathers, self.look_ns = True, now_ns + GATHER_NS
        cpu_ns = self._cpu_ns() if self._asked else 0
        try:
            self._socket.send(encode_orders(orders))
        except BlockingIOError:
            self.broken = "it does not read what it is told"
        except OSError:
            pass  # it has ended: that is read from the socket
        told_ns = time.monotonic_ns()
        for asked in self._asked:
            if asked.since_ns is None:
                asked.since_ns, asked.cpu_ns = told_ns, cpu_ns

    def ask(self, module: int, release: int, now_ns: int) -> None:
        """It is asked for a step."""
        if not self._asked and now_ns >= self._sample_ns:
            self._waited_before_ns, self._sample_ns = self._waited_ns(), now_ns + SAMPLE_NS
        self._asked.append(_Asked(module, release))

    def answered(self, module: int, release: int, ended_ns: int, period_ns: int) -> int | None:
        """It has answered; gives what the step has spent, or None when it was not asked for that."""
        if not self._asked or (self._asked[0].module, self._asked[0].release) != (module, release):
            return None
        asked = self._asked.popleft()
        if self._asked and self._asked[0].since_ns is not None:
            self._asked[0].since_ns = max(self._asked[0].since_ns, ended_ns)
            self._asked[0].cpu_ns = self._cpu_ns()
        took_ns = max(0, ended_ns - (asked.since_ns or ended_ns))
        if took_ns <= period_ns:
            return took_ns
        if self._schedstat is None:
            return self._cpu_ns() - asked.cpu_ns
        self._sample_ns = 0  # the next step is judged exactly
        return max(0, took_ns - (self._waited_ns() - self._waited_before_ns))

    def disown(self, module: int) -> None:
        """A module has been stopped: what it still computes is of use to nobody."""
        for asked in self._asked:
            asked.is_wanted = asked.is_wanted and asked.module != module

    def unwanted(self, now_ns: int) -> tuple[int, int] | None:
        """A module that was stopped and still computes, and what its step has spent."""
        if not self._asked or self._asked[0].is_wanted:
            return None
        first = self._asked[0]
        return first.module, self.spent_ns(first.module, first.release, now_ns)

    def spent_ns(self, module: int, release: int, now_ns: int) -> int:
        """What a step has spent that is not over; 0 for one that is not under way, or whose answer is there."""
        if self.loading or not self._asked or (self._asked[0].module, self._asked[0].release) != (module, release):
            return 0
        asked = self._asked[0]
        if asked.since_ns is None or self._has_spoken():
            return 0
        if self._schedstat is None or _state(self.pid) == _RUNNABLE:
            return self._cpu_ns() - asked.cpu_ns
        return max(0, now_ns - asked.since_ns - (self._waited_ns() - self._waited_before_ns))

    def loading_ns(self, now_ns: int) -> int:
        """What it has spent since it was started."""
        if self._schedstat is None or _state(self.pid) == _RUNNABLE:
            return self._cpu_ns()
        return now_ns - self._begun_ns - self._waited_ns()

    def _has_spoken(self) -> bool:
        """Tell whether there is something to read, if only that it has ended."""
        try:
            self._socket.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            pass  # it has ended
        return True

    def receive(self) -> bytes | None:
        """Next packet; None when there is none, or nothing will come any more (`broken`)."""
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
        """Let it take no more than what it holds now and what it was given."""
        try:
            with open(f"/proc/{self.pid}/statm", encoding="ascii") as statm:  # noqa: PTH123 - no pathlib in the agent
                held = int(statm.read().split()[_STATM_DATA]) * _PAGE_BYTES
            most = held + self._ram + SLACK_BYTES
            resource.prlimit(self.pid, resource.RLIMIT_DATA, (most, most))
        except (OSError, ValueError):
            pass  # it has ended: that is read from the socket
        if self._group is not None:
            self._group.limit(self._ram + SLACK_BYTES)

    def kill(self) -> None:
        """End it by force; `reap` tells when it is gone."""
        self._socket.close()
        if self._schedstat is not None:
            os.close(self._schedstat)
            self._schedstat = None
        if self._group is not None:
            self._group.kill()
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)

    def reap(self) -> str | None:
        """How it ended, in words; None while it has not."""
        pid, status = os.waitpid(self.pid, os.WNOHANG)
        if not pid:
            return None
        code = os.waitstatus_to_exitcode(status)
        if self._groups is not None and self._group is not None and self._groups.retire(self._group):
            return "it took more memory than it was given"
        return f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"

    def _waited_ns(self) -> int:
        """How long it has waited for a processor, up to when it last got one."""
        if self._schedstat is None:
            return 0
        try:
            return int(os.pread(self._schedstat, 80, 0).split()[1])
        except (OSError, IndexError):
            return 0  # it has ended

    def _cpu_ns(self) -> int:
        try:
            return time.clock_gettime_ns((~self.pid << 3) | _CPU_CLOCK)
        except OSError:
            return 0  # it has ended


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
    """State of a process as in ps(1); S when it is gone."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as stat:  # noqa: PTH123
            return stat.read().rpartition(") ")[2][:1]
    except OSError:
        return "S"
