"""The process of one device: runs its driver, and takes the safe action of an actuator in time.

    python -m heronry_agent.shell.device_processes.driver_process AGENT_PID ORDERS

Started by the agent; file descriptor 3 is the socket, 4 the shared memory (head of this package). ORDERS is one line of
JSON (`orders`). The exit code is 0 at an end in order, 1 after a failure of the driver, and 2 if driver or options are
wrong; the reason is printed, and goes to the log of the agent.
"""

import os
import resource
import select
import signal
import socket
import sys
import time
import traceback
from contextlib import suppress
from io import TextIOBase

from heronry_agent.device_driver import ActuatorDriver, Measured, SensorDriver, Setup, checked_options
from heronry_agent.shell.device_processes.orders import DeviceOrders
from heronry_agent.shell.device_processes.safe_output import Move, OutputLimits, SafeOutput, TakeSafeAction
from heronry_agent.shell.device_processes.shared_block import Ring, SharedBlock, Word
from heronry_agent.shell.driver_catalogue import load_driver
from heronry_wire.errors import HeronryError
from heronry_wire.parent_death import die_with

SOCKET, MEMORY = 3, 4
BAD_ORDERS = 2  # exit code: to start the process again would not help
_DESCRIPTORS = 65_536
_NS_PER_S, _NS_PER_MS = 1_000_000_000, 1_000_000
_LIVES_NS = 100_000_000  # a process that waits shows life so often
_ACTUATORS_SETTLE_MS = 1_000
_LONGEST_OPENING_S = 20  # of a driver that nobody but the kernel would end any more
_LEAST_WAIT_NS = 1_000_000  # between two readings: a sensor that floods does not take the whole processor


class Line:
    """The socket to the agent: it wakes, and its end is the end of this process."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._socket.setblocking(False)

    def wait(self, until_ns: int) -> bool:
        """Wait until the agent wakes this process, or until a time; False: the agent has closed the socket."""
        wait_s = max(0, until_ns - time.monotonic_ns()) / _NS_PER_S
        if not select.select([self._socket], [], [], wait_s)[0]:
            return True
        with suppress(BlockingIOError):
            return bool(self._socket.recv(4096))
        return True


class SensorProcess:
    """Reads a sensor for as long as the agent lives."""

    def __init__(self, driver: SensorDriver, orders: DeviceOrders, block: SharedBlock, line: Line) -> None:
        self._driver, self._orders, self._block, self._line = driver, orders, block, line

    def run(self) -> None:
        """Read and publish until the agent closes the socket."""
        while True:
            begun_ns = self._lives()
            found = self._driver.read()
            read_ns = self._lives()
            if found is not None:
                value, at_ns = found if isinstance(found, Measured) else (found, read_ns)
                self._block.put(Ring.READINGS, at_ns, value)
            next_ns = read_ns + _LEAST_WAIT_NS
            if not self._driver.WAITS:
                next_ns = max(next_ns, begun_ns + self._orders.period_ns)
            while True:
                if not self._line.wait(min(next_ns, read_ns + _LIVES_NS)):
                    return
                read_ns = self._lives()
                if read_ns >= next_ns:
                    break

    def _lives(self) -> int:
        now_ns = self._block[Word.ALIVE] = time.monotonic_ns()
        return now_ns


class ActuatorProcess:
    """Drives an actuator while its commands are valid, and makes it safe at any end."""

    def __init__(self, driver: ActuatorDriver, orders: DeviceOrders, block: SharedBlock, line: Line) -> None:
        self._driver, self._orders, self._block, self._line = driver, orders, block, line
        self._output = SafeOutput(
            OutputLimits(orders.least, orders.most, orders.per_s), begun_anew=block.count(Ring.COMMANDS) > 0
        )
        self._position: float | None = None

    def run(self) -> None:
        """Take the safe action, then execute commands until the agent closes the socket."""
        self.make_safe("")
        while True:
            self._execute()
            now_ns = time.monotonic_ns()
            self._block[Word.ALIVE] = now_ns
            deadline_ns = self._output.next_deadline_ns(self._block[Word.UNTIL])
            if not self._line.wait(min(deadline_ns, now_ns + _LIVES_NS)):
                return

    def _execute(self) -> None:
        """Do all that is due now; the end of validity is looked at again after each write."""
        while True:
            entry = self._block.newest(Ring.COMMANDS)
            done = self._output.done
            todo = self._output.decide(entry, self._block[Word.UNTIL], time.monotonic_ns(), self._lasts_ns)
            match todo:
                case Move(value):
                    self._position = self._driver.command(value)
                    self._output.moved(value, time.monotonic_ns())
                case TakeSafeAction(reason):
                    self.make_safe(reason)
                case None if done == self._output.done:
                    return
            self._block.put(Ring.READINGS, time.monotonic_ns(), self._position)
            self._block[Word.DONE] = self._output.done
            self._block[Word.ALIVE] = time.monotonic_ns()

    def make_safe(self, reason: str) -> None:
        """Take the safe action, and only then tell the reason."""
        safe = self._orders.safe
        if not isinstance(safe, str):
            self._position = self._driver.command(safe)
            self._output.moved(safe, time.monotonic_ns())
        elif safe == "release" and self._driver.release is not None:
            self._driver.release()
            self._position = None
            self._output.released()
        if reason:
            print(f"device {self._orders.device}: safe action, since {reason}")

    def _lasts_ns(self, value: float) -> int | None:
        lasts_ms = self._driver.lasts_ms(value)
        return None if lasts_ms is None else round(lasts_ms * _NS_PER_MS)


def main(arguments: list[str]) -> int:
    """Run one device until the agent closes the socket; returns the exit code."""
    agent, orders = int(arguments[0]), DeviceOrders.from_json(arguments[1])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the agent, which ends this process
    signal.signal(signal.SIGTERM, _end)
    if orders.is_actuator:
        signal.alarm(_LONGEST_OPENING_S)  # SIGTERM waits until the device is open, perhaps in vain
    die_with(agent, signal.SIGTERM if orders.is_actuator else signal.SIGKILL)
    for inherited in (SOCKET, MEMORY):
        os.set_inheritable(inherited, False)
    os.closerange(MEMORY + 1, _DESCRIPTORS)
    os.set_blocking(1, False)
    sys.stdout = sys.stderr = _Dropping()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        return _run(orders, SharedBlock(MEMORY), Line(SOCKET))
    except HeronryError as error:
        print(f"device {orders.device}: {error}")
        return BAD_ORDERS
    except Exception:  # noqa: BLE001 - a driver is foreign code
        traceback.print_exc()
        return 1


def _run(orders: DeviceOrders, block: SharedBlock, line: Line) -> int:
    block[Word.ALIVE] = time.monotonic_ns()
    kind = load_driver(orders.driver)
    if issubclass(kind, ActuatorDriver) is not orders.is_actuator:
        wanted = "an actuator" if orders.is_actuator else "a sensor"
        raise _KindError(f"the device is {wanted}, and driver '{orders.driver}' is not one of {wanted}; name another")
    options = checked_options(kind.OPTIONS, orders.options)
    driver = kind(Setup(orders.device, options, orders.period_ns, orders.buses or {}, orders.uplink))
    if isinstance(driver, SensorDriver):
        _declare(block, driver.SETTLES_MS, driver.LONGEST_READ_MS)
        SensorProcess(driver, orders, block, line).run()
        driver.close()
        return 0
    process = ActuatorProcess(driver, orders, block, line)
    # A dead agent closes the socket and sends SIGTERM, whose handler raises once, wherever this process is by then. If
    # it cuts the safe action short, that is taken again; if not, it is not touched again.
    # It comes here at the earliest: until now it was blocked (`isolated`), since only an open device can be made safe.
    is_safe = False
    try:
        try:
            signal.alarm(0)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
            _declare(block, _ACTUATORS_SETTLE_MS, driver.LONGEST_COMMAND_MS)
            process.run()
        finally:
            process.make_safe("")
            is_safe = True
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if not is_safe:
            process.make_safe("")
        driver.close()
    return 0


class _Dropping(TextIOBase):
    """What this process prints: it goes to the log of the agent, and is dropped where that would have to wait.

    An agent that is paused does not read the log, and the safe action must not wait for it.
    """

    def write(self, text: str) -> int:
        """Write without waiting."""
        with suppress(OSError):
            os.write(1, text.encode(errors="backslashreplace"))
        return len(text)


def _declare(block: SharedBlock, settles_ms: int, longest_ms: int) -> None:
    block[Word.ALIVE] = time.monotonic_ns()
    block[Word.SETTLES], block[Word.LONGEST] = settles_ms * _NS_PER_MS, longest_ms * _NS_PER_MS


class _KindError(HeronryError):
    """A driver of the other kind of device is named."""


def _end(*_: object) -> None:
    """End this process, once: a further SIGTERM interrupts nothing."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.exit(0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
