"""The agent's side of a device with a process of its own: starts it, judges its readings, and passes commands to it.

No method waits for the process, except `close`. The states of the process, and who moves them:

    waiting    it has ended; `look` starts it again when its time has come
    running    it was started, and has not ended. `look` kills it if it shows no life
    ending     it was killed, and is not reaped yet. A process that hangs in the kernel stays here, and no second one
               is started beside it
"""

import os
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from typing import Any

from heronry_agent.core.restarts import Restarts
from heronry_agent.core.step_times import NS_MHZ
from heronry_agent.device import Reading
from heronry_agent.module import Value
from heronry_agent.shell.device_choice import RealDriver
from heronry_agent.shell.device_processes.driver_process import BAD_ORDERS, MEMORY, SOCKET
from heronry_agent.shell.device_processes.judgement import ReadingRule, Silence
from heronry_agent.shell.device_processes.orders import DeviceOrders
from heronry_agent.shell.device_processes.shared_block import Ring, SharedBlock, Word
from heronry_agent.shell.partition_log import PartitionLog
from heronry_wire.pe_table import STALE_PERIODS, DriverEntry, PeTable
from heronry_wire.sansio import NEVER_NS

Buses = Mapping[str, Mapping[str, Any]]

RESTARTS = 3
SELDOM_NS = 10_000_000_000
LOOK_NS = 20_000_000
_STARTS_NS = 20_000_000_000  # to import the code of the driver and to open the device, on a busy computer
_LEAST_LONGEST_NS, _MOST_LONGEST_NS, _MOST_SETTLES_NS = 100_000_000, 60_000_000_000, 300_000_000_000
_CLOSES_NS = 2_000_000_000
_INHERITED = ("HOME", "LANG", "LD_LIBRARY_PATH", "PATH", "TZ", "VIRTUAL_ENV")
_ONLY = 0  # number of the device in its own `Restarts`


class IsolatedDevice:
    """A sensor or an actuator whose driver runs in a process of its own; a `Device` of `heronry_agent.device`."""

    def __init__(
        self,
        orders: DeviceOrders,
        rule: ReadingRule,
        *,
        is_exclusive: bool,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Start the process.

        rule: what a reading of a sensor must fulfil.
        is_exclusive: its module is a branch of a DEMUX, so it may be driven only as long as protocol rule 6 allows.
        tell: called with a sentence for the log.
        """
        self._orders, self._rule, self._tell = orders, rule, tell
        self._is_exclusive = is_exclusive
        now_ns = time.monotonic_ns()
        self._silence = Silence(rule.stale_ns, _STARTS_NS, now_ns)
        self._hang = Silence(_STARTS_NS, 0, now_ns)
        self._is_open = False  # the driver of the present process has opened the device
        self._has_settled = False  # a driver has opened the device at least once
        self._restarts = Restarts()
        self._is_given_up = False
        self._is_driving = False
        self._until_ns = 0  # the latest end of validity that may be given now
        self._asked = 0  # number of the newest command
        self._looked_ns = 0
        self._log: PartitionLog | None = None
        self._pid: int | None = None
        self._is_ending = False
        self._ends_by_ns = 0  # until when an end in order is waited for
        self._memory = SharedBlock.create()
        self._block = SharedBlock(self._memory)
        self._socket: socket.socket | None = None
        self._restarts.begin_at(_ONLY, now_ns)
        self.look(now_ns)

    @property
    def log(self) -> PartitionLog | None:
        """The pipe to which the process prints; None if no process has been started, or its pipe is closed."""
        return self._log if self._log is not None and self._log.is_open else None

    @property
    def pid(self) -> int | None:
        """Process number; None while there is no process."""
        return self._pid

    @property
    def owes(self) -> bool:
        """Tell whether an actuator has commands that its process has not dealt with."""
        return self._block[Word.DONE] < self._asked

    # As a device

    def read(self, now_ns: int) -> Reading:
        """Return the newest reading of a sensor, or the value to which an actuator went last."""
        entry = self._block.newest(Ring.READINGS)
        if self._orders.is_actuator:
            value = None if entry is None else entry.value
            return Reading(value, now_ns, valid=value is not None)
        reading = self._rule.judge(entry, now_ns)
        if reading.valid:
            self._silence.sign(reading.time_ns)
        return reading

    def command(self, value: Value, now_ns: int) -> Value | None:
        """Hand a command to the process; returns the value to which the actuator went last, None if to none yet.

        Raises TypeError for what is no number.
        """
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise TypeError(f"device {self._orders.device} moves by a number, not by {value!r:.60}")
        if now_ns > self._until_ns:
            return None
        self._is_driving = True
        self._block[Word.UNTIL] = self._until_ns
        self._put(now_ns, float(value))
        position = self.read(now_ns).value
        return position if isinstance(position, (int, float)) else None

    def make_safe(self, now_ns: int) -> None:
        """Order the safe action of an actuator."""
        if self._orders.is_actuator:
            self._is_driving = False
            self._block[Word.UNTIL] = 0
            self._put(now_ns, None)

    def _put(self, now_ns: int, value: float | None) -> None:
        if not self.owes:
            self._silence.sign(now_ns)  # it has done all so far, and owes an answer from now on
        self._block.put(Ring.COMMANDS, now_ns, value)
        self._asked = self._block.count(Ring.COMMANDS)
        if self._socket is not None:
            with suppress(OSError):  # full: it is awake anyway; broken: it has ended, which `look` will find
                self._socket.send(b"w")

    # As a process

    def renew(self, exclusive_until_ns: int, lease_ns: int, now_ns: int) -> None:
        """Renew the validity of the present command.

        exclusive_until_ns: end of the authorization of exclusive outputs, before `now_ns` if there is none.
        """
        self._until_ns = exclusive_until_ns if self._is_exclusive else now_ns + lease_ns
        if not self._is_driving:
            return
        if self._block[Word.UNTIL] < now_ns or self._until_ns < now_ns:
            self._is_driving = False  # its process has taken the safe action; only a new command drives again
            self._block[Word.UNTIL] = min(self._block[Word.UNTIL], now_ns - 1)
        else:
            self._block[Word.UNTIL] = self._until_ns

    def is_failed(self, now_ns: int) -> bool:
        """Tell whether the device is to be reported failed."""
        if self._is_given_up:
            return True
        if self._orders.is_actuator and not self.owes:
            return False
        return self._silence.is_over(now_ns)

    def next_deadline_ns(self) -> int:
        """Time in ns at which to call `look`, if nothing else comes before."""
        return self._looked_ns + LOOK_NS

    def look(self, now_ns: int) -> None:
        """Start the process, find out whether it has ended, and kill it if it hangs; call this in every turn."""
        if self._looked_ns and now_ns - self._looked_ns < LOOK_NS:
            return
        self._looked_ns = now_ns
        self._silence.look(now_ns)
        self._hang.look(now_ns)
        if self._pid is not None:
            self._look_at_process(now_ns)
        elif self._restarts.due(now_ns):
            self._start(now_ns)
        if not self._orders.is_actuator:
            self.read(now_ns)  # so that a sensor is known to give, also while no module is stepped on it

    def _look_at_process(self, now_ns: int) -> None:
        assert self._pid is not None
        if not self._is_open and self._block[Word.LONGEST]:
            self._opened(now_ns)
        if self._is_open:
            self._hang.sign(min(self._block[Word.ALIVE], now_ns))
        if not self._is_ending and self._hang.is_over(now_ns):
            self._tell(f"the driver of device {self._orders.device} hangs, and is ended")
            self._kill()
        pid, status = os.waitpid(self._pid, os.WNOHANG)
        if pid:
            self._ended(os.waitstatus_to_exitcode(status), now_ns)

    def _opened(self, now_ns: int) -> None:
        """Take over the times that the driver declares; it is not trusted to declare sensible ones."""
        longest_ns = min(max(self._block[Word.LONGEST], _LEAST_LONGEST_NS), _MOST_LONGEST_NS)
        settles_ns = min(max(self._block[Word.SETTLES], 0), _MOST_SETTLES_NS)
        self._is_open, self._is_given_up = True, False
        self._hang = Silence(longest_ns, 0, now_ns)
        if not self._has_settled:
            self._has_settled = True
            allowed_ns = longest_ns if self._orders.is_actuator else self._rule.stale_ns
            self._silence = Silence(allowed_ns, settles_ns, now_ns)

    def _ended(self, code: int, now_ns: int) -> None:
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        self._let_go()
        number = self._restarts.failed(_ONLY, 0 if code == BAD_ORDERS else RESTARTS, now_ns)
        if number is None:
            self._is_given_up = True
            self._restarts.begin_at(_ONLY, now_ns + SELDOM_NS)
        more = "it is given up" if number is None else f"it is started again ({number} of {RESTARTS})"
        self._tell(f"the driver of device {self._orders.device} {how}; {more}")

    def _start(self, now_ns: int) -> None:
        self._block[Word.ALIVE] = self._block[Word.LONGEST] = 0
        self._is_open, self._hang = False, Silence(_STARTS_NS, 0, now_ns)
        try:
            self._spawn()
        except OSError as error:
            self._is_given_up = True
            self._restarts.begin_at(_ONLY, now_ns + SELDOM_NS)
            self._tell(f"the driver of device {self._orders.device} cannot be started: {error.strerror}")

    def _spawn(self) -> None:
        own, theirs = socket.socketpair()
        own.setblocking(False)
        log = PartitionLog(f"of device {self._orders.device}")
        environment = {k: v for k, v in os.environ.items() if k in _INHERITED or k.startswith(("LC_", "PYTHON"))}
        program = "heronry_agent.shell.device_processes.driver_process"
        try:
            with theirs:
                self._pid = os.posix_spawn(
                    sys.executable,
                    [sys.executable, "-m", program, str(os.getpid()), self._orders.to_json()],
                    environment,
                    file_actions=[
                        (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                        (os.POSIX_SPAWN_DUP2, log.writer, 1),
                        (os.POSIX_SPAWN_DUP2, log.writer, 2),
                        *_handed((theirs.fileno(), SOCKET), (self._memory, MEMORY)),
                    ],
                    setpgroup=0,
                    setsigmask=[signal.SIGTERM] if self._orders.is_actuator else [],  # until it is open
                )
        finally:
            log.handed_over()
        self._log, self._socket = log, own

    def _kill(self) -> None:
        self._is_ending = True
        if self._pid is not None:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._pid, signal.SIGKILL)

    def _let_go(self) -> None:
        """Close what belonged to a process that was reaped."""
        self._pid, self._is_ending = None, False
        if self._socket is not None:
            self._socket.close()
            self._socket = None
        if self._log is not None:
            self._log.close()
            self._log = None

    def let_end(self) -> None:
        """Let the process end, and do not wait: it takes the safe action by itself when its socket is closed.

        An actuator that is being opened has the time of a start, as it takes the safe action when it is open.
        """
        if self._socket is not None:
            self._socket.close()
            self._socket = None
            is_opening = self._orders.is_actuator and not self._block[Word.LONGEST]
            self._ends_by_ns = time.monotonic_ns() + (_STARTS_NS if is_opening else _CLOSES_NS)

    def close(self) -> None:
        """Let the process end, wait for its end, and kill it if it hangs.

        If it was killed before it could take the safe action, a successor does.
        """
        if self._ends_badly() and self._orders.is_actuator and not self._is_given_up:
            self._start(time.monotonic_ns())
            self._ends_badly()
        self._block.close()
        os.close(self._memory)

    def _ends_badly(self) -> bool:
        """Wait for the end of the process; tell whether that was not in order."""
        self.let_end()
        until_ns = self._ends_by_ns
        status = 1
        while self._pid is not None:
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            if pid:
                self._let_go()
            elif time.monotonic_ns() > until_ns:
                self._kill()
                until_ns = NEVER_NS
            else:
                time.sleep(0.002)
        return bool(status)


def _handed(*pairs: tuple[int, int]) -> list[tuple[int, int, int]]:
    """Return the actions that hand descriptors to a process under fixed numbers, whatever their own numbers are.

    They are copied out of the way first, since one of them may have a number that is wanted for another.
    """
    far = 200
    away = [(os.POSIX_SPAWN_DUP2, own, far + wanted) for own, wanted in pairs]
    return away + [(os.POSIX_SPAWN_DUP2, far + wanted, wanted) for _, wanted in pairs]


class IsolatedDriver:
    """Opens devices with processes of their own; a `DeviceDriver` of `heronry_agent.device`."""

    def __init__(self, table: PeTable, chosen: Mapping[str, RealDriver], buses: Buses, tell: Callable[[str], None]):
        """Keep what the processes are to be told.

        chosen: the driver of each device that is to be opened.
        buses: arguments of python-can, by name of the bus.
        tell: called with a sentence for the log.
        """
        self._table, self._chosen, self._buses, self._tell = table, chosen, buses, tell
        self._entries = {entry.device: entry for entry in table.drivers}

    def open(self, name: str) -> IsolatedDevice:
        """Start the process of a device."""
        table, chosen = self._table, self._chosen[name]
        modules = [module for module in table.modules if module.device == name]
        period_ns = min(NS_MHZ // mode.rate_mhz for module in modules for mode in module.modes)
        kind = next(device.kind for device in table.devices if device.name == name)
        entry = self._entries.get(name) or DriverEntry(
            name, None, "{}", STALE_PERIODS * period_ns, None, None, None, "release"
        )
        is_actuator = kind == "actuator"
        orders = DeviceOrders(
            name,
            is_actuator,
            chosen.driver,
            chosen.options,
            period_ns,
            safe=entry.safe,
            least=entry.least if is_actuator else None,
            most=entry.most if is_actuator else None,
            per_s=entry.per_s,
            buses=self._buses,
            uplink=table.ports[table.uplink].bus,
        )
        rule = ReadingRule(entry.stale_ns, entry.least, entry.most)
        return IsolatedDevice(orders, rule, is_exclusive=any(module.demux for module in modules), tell=self._tell)

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:  # noqa: ARG002
        """Return the actuators of other PEs whose echoes are needed: none."""
        return frozenset()

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        """Ignore an output echo: real devices move by themselves."""
