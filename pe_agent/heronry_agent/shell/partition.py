"""A partition: the process in which a group of modules computes. It has one socket to its agent, and no other link.

    python -m heronry_agent.shell.partition AGENT_PID NAME     started by the agent; the socket is file descriptor 3

The partition has no bus, no table and no key. It executes the orders that come on the socket one after the other, and
sends the answer to each step before it begins the next step (`partition_messages`). So the agent can tell which module
was computing when the process ended. If a module raises an exception, the answer reports it, and the traceback is
printed.

The tracebacks, and all text that modules print, go line by line to the agent, each line with time and module name
(`module_prints`). The agent writes them to its standard error (`partition_log`). On a node this is the journal of the
agent's service; in a demo it is the agent's log.

No partition outlives its agent. The kernel kills the process when the agent dies (PR_SET_PDEATHSIG), even in the middle
of a step, and then the processes that its modules have forked. A program that a module has started ends with the
partition if the agent ends the partition; after a kill of the agent only its control group or systemd ends the program.
The partition also ends when its socket is closed. If the agent hangs it sends no orders, so no module computes a
further step. If a step was ordered before, the partition skips it once its authorization (`until_ns`) has ended.

A partition writes no core file, since writing one would take seconds.
"""

import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from io import TextIOWrapper

from heronry_agent.core.vocabulary import Failure
from heronry_agent.module import Datum
from heronry_agent.shell.module_prints import ModulePrints
from heronry_agent.shell.module_runner import ModuleRunner, Result
from heronry_agent.shell.partition_messages import (
    SOCKET,
    Done,
    Failed,
    Load,
    Loaded,
    Order,
    Save,
    Start,
    StartRefused,
    Step,
    Stop,
    Uncarriable,
    decode_orders,
    encode_answer,
)
from heronry_agent.shell.partition_states import state_of
from heronry_agent.shell.time_limit import time_limit
from heronry_wire.parent_death import die_with

_PACKET_BYTES = 262_144
_DESCRIPTORS = 65_536


class Partition:
    """Executes, in the process of a partition, the orders that the agent sends."""

    def __init__(self, runner: ModuleRunner, computes: Callable[[str], None] = lambda _: None) -> None:
        """Begin without modules; `computes` is called with the name of each module before it is built or stepped."""
        self._runner, self._computes = runner, computes
        self._names: dict[int, str] = {}
        self._leaves: dict[int, tuple[tuple[str, str], ...]] = {}

    def accept(self, packet: bytes) -> Iterator[bytes]:
        """Execute the orders in a packet one by one, and yield the packet of each answer."""
        for order in decode_orders(packet):
            answer = self._accept(order)
            if answer is not None:
                yield answer

    def _accept(self, order: Order) -> bytes | None:
        match order:
            case Step():
                return self._step(order)
            case Start():
                self._names[order.module] = order.orders.name
                self._computes(order.orders.name)
                self._leaves[order.module] = order.leaves
                outcome = self._runner.start(order.module, order.orders, time.monotonic_ns(), state_of(order.kept))
                if not isinstance(outcome, Failure):
                    return None if outcome is None else encode_answer(outcome)
                _print(outcome)
                return encode_answer(StartRefused(order.module, *outcome))
            case Save():
                self._computes(self._names.get(order.module, ""))
                saved = self._runner.save(order.module, order.round, order.most_bytes)
                return None if saved is None else encode_answer(saved)
            case Stop():
                self._runner.stop(order.module, keep=order.keep)
                return None
            case Load():
                self._computes("code")
                failures = {image: self._runner.load(image) for image in order.images}
                return encode_answer(Loaded({image: one.reason for image, one in failures.items() if one is not None}))

    def _step(self, order: Step) -> bytes:
        result: Result | Failure = Result({})
        self._computes(self._names.get(order.module, ""))
        if time.monotonic_ns() <= order.until_ns:
            inputs: dict[str, tuple[str, Datum]] = {}
            leaves = self._leaves.get(order.module, ())
            for leaf, value, version, age_ns, valid in order.inputs:
                path, variable = leaves[leaf]
                inputs[path] = (variable, Datum(value, version, age_ns, valid))
            result = self._runner.step(order.module, order.now_ns, order.until_ns, order.reading, inputs)
        if isinstance(result, Failure):
            _print(result)
            return encode_answer(Failed(order.module, order.release, *result))
        try:
            return encode_answer(Done(order.module, order.release, time.monotonic_ns(), result))
        except Uncarriable as error:
            return encode_answer(Failed(order.module, order.release, str(error)))


def _print(failure: Failure) -> None:
    """Print the traceback of a failure, if that is possible."""
    with suppress(OSError, ValueError, MemoryError):  # the reader may have ended, and memory may have run out
        print(failure.traceback, end="", file=sys.stderr, flush=True)


def main(arguments: list[str]) -> int:
    """Execute orders until the agent closes the socket; returns the exit code.

    arguments: process number of the agent, and name of the partition.
    """
    die_with(int(arguments[0]))
    os.register_at_fork(after_in_child=lambda: die_with(os.getppid()))
    os.closerange(SOCKET + 1, _DESCRIPTORS)  # descriptors that the agent has inherited
    os.set_inheritable(SOCKET, False)  # else a program started by a module would hide the end of this process
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the agent, which ends this process
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(
            line_buffering=True, encoding="utf-8", errors="backslashreplace"
        )  # else what a module prints is lost when the process is killed
    prints = ModulePrints(sys.stdout)  # both outputs of this process lead to its agent (`partition_log`)
    sys.stdout = sys.stderr = prints
    partition = Partition(ModuleRunner(time.monotonic_ns, time_limit), prints.of)
    with suppress(ConnectionError):  # raised when the agent closes the socket with packets unread
        while packet := os.read(SOCKET, _PACKET_BYTES):
            for answer in partition.accept(packet):
                os.write(SOCKET, answer)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
