"""The agent's thin shell: the buses of one PE, its modules, one select loop. Time is CLOCK_MONOTONIC.

A turn goes so:

1. Wait until a frame has come, a deadline is due, or whoever started the agent is gone.
2. Hand over every frame that has come, with its age: after a pause of this process the old ones among them must not
   look like news (rule 6), and no deadline passes before they are known.
3. Hand over what a module has computed, then the deadline if it is due. What this releases is computed at once, and
   waits for the next turn: so frames that came meanwhile count before its outputs go out.

What means nothing to the PE now is kept back by the kernel (or the hub): on a full bus that is most of the traffic.

A frame that could not leave within T_lease does not leave at all: rule 6 allowed it for then, not for now.

Nothing runs in a thread, and nothing repeats frames for us: when this loop stands still, the PE is silent.

It ends when `stop` is called (a signal), with `until_eof` when standard input ends, or with LinkError when a bus is
lost.
"""

import os
import select
import sys
import time
from collections.abc import Callable, Collection, Sequence
from typing import Any

from heronry_agent.core import AgentCore
from heronry_agent.host import ModuleHost
from heronry_agent.vocabulary import Action, Event, Note, StartFailed, StepFailed, Stepped
from heronry_wire.frame import Frame
from heronry_wire.identifiers import heartbeat_id, state_id
from heronry_wire.link import Arrival, Link
from heronry_wire.sansio import Received, Send, Tick, Withdraw

_NS_PER_S = 1_000_000_000


def hears_own_id(links: Sequence[Link], node: int, listen_ns: int) -> bool:
    """Listen before speaking: tell whether another node already has this node-ID. Raises LinkError."""
    own = (state_id(node), heartbeat_id(node))
    end_ns = time.monotonic_ns() + listen_ns
    while (left_ns := end_ns - time.monotonic_ns()) > 0:
        select.select(links, [], [], left_ns / _NS_PER_S)
        for link in links:
            if any(_is_plain(frame) and frame.can_id in own for _, frame in link.receive(time.monotonic_ns())):
                return True
    return False


def _is_plain(frame: Frame) -> bool:
    return not (frame.extended or frame.remote or frame.error)


class AgentDriver:
    """Runs a core on its links, one per port."""

    def __init__(self, core: AgentCore, host: ModuleHost, links: Sequence[Link], tell: Callable[[Note], None]) -> None:
        """`tell` gets every note as it happens."""
        self._core, self._host, self._links, self._tell = core, host, links, tell
        self._answer: Stepped | StepFailed | None = None
        self._accepted: Collection[int] = ()  # what the links were last told to take in
        self._stopping = False

    def stop(self) -> None:
        """End the loop at its next turn; safe in a signal handler."""
        self._stopping = True

    def run(self, *, until_eof: bool) -> None:
        """Run until stopped. Raises LinkError."""
        readers: list[Any] = [*self._links, *([sys.stdin] if until_eof else [])]
        while not self._stopping:
            ready, _, _ = select.select(readers, [], [], self._wait_s())
            if sys.stdin in ready and not os.read(sys.stdin.fileno(), 4096):
                break
            self._take_frames()
            self._take_answer()
            now_ns = time.monotonic_ns()
            if now_ns >= self._core.next_deadline_ns():
                self._step(now_ns, Tick())
            for link in self._links:
                link.pump(now_ns)
            if self._core.identifiers is not self._accepted:
                self._accept(self._core.identifiers)

    def _accept(self, identifiers: Collection[int]) -> None:
        self._accepted = identifiers
        for link in self._links:
            link.accept(identifiers)

    def _wait_s(self) -> float:
        if self._answer is not None:
            return 0.0
        deadlines = [self._core.next_deadline_ns()]
        deadlines += [at_ns for link in self._links if (at_ns := link.next_deadline_ns()) is not None]
        return max(0, min(deadlines) - time.monotonic_ns()) / _NS_PER_S

    def _take_frames(self) -> None:
        while arrivals := self._arrivals():
            for arrival, port in arrivals:
                now_ns = time.monotonic_ns()
                self._step(now_ns, Received(port, arrival.frame, max(0, now_ns - arrival.time_ns)))

    def _arrivals(self) -> list[tuple[Arrival, int]]:
        """What has come on all ports, in the order in which it came."""
        found = []
        for port, link in enumerate(self._links):
            found += [(arrival, port) for arrival in link.receive(time.monotonic_ns())]
        if len(self._links) > 1:
            found.sort(key=lambda one: one[0].time_ns)
        return found

    def _take_answer(self) -> None:
        answer, self._answer = self._answer, None
        if answer is not None:
            self._step(time.monotonic_ns(), answer)

    def _step(self, now_ns: int, event: Event) -> None:
        for action in self._core.step(now_ns, event):
            self._carry_out(action, now_ns)

    def _carry_out(self, action: Action, decided_ns: int) -> None:
        match action:
            case Send(port, frame, until_ns):
                latest_ns = decided_ns + self._core.lease_ns if until_ns is None else until_ns
                self._links[port].send(frame, time.monotonic_ns(), latest_ns)
            case Withdraw(identifiers):
                for link in self._links:
                    link.withdraw(identifiers)
            case Note():
                self._tell(action)
            case _:
                answer = self._host.carry_out(action, time.monotonic_ns())
                if isinstance(answer, StartFailed):
                    self._step(time.monotonic_ns(), answer)
                elif answer is not None:
                    self._answer = answer
