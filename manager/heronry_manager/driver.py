"""The manager's thin shell: one bus, one planner process, one operator's socket, one select loop.

Order of a turn: everything that has arrived (frames, answers of the planner, the operator's words) goes into the core
before a deadline may pass, so that what this process slept through is not taken for silence of the others. Time is
CLOCK_MONOTONIC.

Ends: when the core says Stop, when `stop` is called (a signal), when the bus is lost, or, with `until_eof`, when
standard input ends because whoever started the manager is gone.
"""

import os
import select
import sys
import time
from collections.abc import Callable
from typing import Any

from heronry_manager.control_socket import ControlSocket
from heronry_manager.core import ManagerCore
from heronry_manager.planner.foresight import Foresight
from heronry_manager.vocabulary import Emit, ManagerAction, ManagerEvent, Reply, RequestPlan, Settled, Stop
from heronry_wire.identification import REQUEST_ID
from heronry_wire.identifiers import MANAGER_NODES, heartbeat_id
from heronry_wire.link import Link
from heronry_wire.sansio import Received, Send, Tick

# What the manager listens to: commands, EMCY and states, and the echoes of what it sends; no data, which is most of
# the traffic. (A driver's filter holds back echoes too.)
FILTERS = (
    {"can_id": REQUEST_ID, "can_mask": 0x7FE, "extended": False},  # 128 and 129: node services, channel 0
    {"can_id": 0x0C0, "can_mask": 0x7C0, "extended": False},  # 192..255
    {"can_id": 0x100, "can_mask": 0x7C0, "extended": False},  # 256..319
    *({"can_id": heartbeat_id(node), "can_mask": 0x7FF, "extended": False} for node in MANAGER_NODES),
)
_BURSTS = 16  # bursts of frames taken in one turn, so that a flood cannot stop the timers

Emitter = Callable[[dict[str, Any]], None]


class ManagerDriver:
    """Runs a core on a link."""

    def __init__(
        self, core: ManagerCore, link: Link, foresight: Foresight, control: ControlSocket, emit: Emitter
    ) -> None:
        """`emit` gets every event of the stream as it happens."""
        self._core, self._link, self._foresight, self._control = core, link, foresight, control
        self._emit = emit
        self._stop_reason: str | None = None
        self._stopping = False

    def stop(self) -> None:
        """End the loop at its next turn; safe in a signal handler."""
        self._stopping = True

    def run(self, *, until_eof: bool) -> str | None:
        """Reign until stopped; gives the reason when the core stopped by itself. Raises LinkError."""
        others: list[Any] = [self._link, *([sys.stdin] if until_eof else [])]
        while not self._stopping and self._stop_reason is None:
            readers = [*others, *self._foresight.readers(), *self._control.readers()]
            ready, _, _ = select.select(readers, [], [], self._wait_s())
            if sys.stdin in ready and not os.read(sys.stdin.fileno(), 4096):
                break
            self._take_frames()
            for answer in self._foresight.poll():
                self._step(answer)
            for said in self._control.poll():
                self._step(said)
            deadline_ns = self._core.next_deadline_ns()
            if deadline_ns is not None and time.monotonic_ns() >= deadline_ns:
                self._step(Tick())
            self._link.pump(time.monotonic_ns())
        return self._stop_reason

    def _wait_s(self) -> float | None:
        deadlines = [d for d in (self._core.next_deadline_ns(), self._link.next_deadline_ns()) if d is not None]
        return max(0, min(deadlines) - time.monotonic_ns()) / 1e9 if deadlines else None

    def _take_frames(self) -> None:
        for _ in range(_BURSTS):
            arrivals = self._link.receive(time.monotonic_ns())
            for _, frame in arrivals:
                self._step(Received(0, frame))
            if not arrivals:
                return

    def _step(self, event: ManagerEvent) -> None:
        now_ns = time.monotonic_ns()
        self._carry_out(self._core.step(now_ns, event), now_ns)

    def _carry_out(self, actions: list[ManagerAction], now_ns: int) -> None:
        """Do them in order; a plan that is there at once is news for the core only when all of them are done."""
        answers = []
        for action in actions:
            match action:
                case Send(frame=frame):
                    self._link.send(frame, now_ns)
                case RequestPlan():
                    answer = self._foresight.request(action)
                    if answer is not None:
                        answers.append(answer)
                case Settled(down, phase, running):
                    self._foresight.settled(down, phase, running)
                case Emit(event):
                    self._emit(event)
                case Reply():
                    self._control.answer(action)
                case Stop(reason):
                    self._stop_reason = reason
        for known in answers:
            self._step(known)
