"""The manager's thin shell: one select loop over the bus, the processes that plan, and the operator's socket.

In each turn of the loop, the frames and the answers of the planner that have arrived go into the core before the core
handles a deadline. So a time in which this process did not run does not count as silence of the other nodes. One order
of the operator follows (`control_socket`): the manager's own frames go first. Time is CLOCK_MONOTONIC.

While the bus is lost the core's clock stands still, because a manager that cannot receive must not conclude that all
PEs are silent. When `heronry_wire.link` has opened the bus again, the manager goes on with its term and the operator's
orders. The bus then shows what has changed: a PE that restarted reports a new incarnation, and a manager that took over
has a higher term. What the manager knew of the other PEs is still true.

The loop ends in three cases:

- The core gives Stop.
- `stop` is called, because a signal has come.
- With `until_eof`: standard input ends, because the process that started the manager is gone.
"""

import os
import select
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from heronry_dg.model import Spec
from heronry_dg.plan import Plan
from heronry_manager import events
from heronry_manager.core.manager import ManagerCore
from heronry_manager.core.vocabulary import (
    AliveLeft,
    ChannelsLost,
    Emit,
    JournalTold,
    Keep,
    ManagerAction,
    ManagerEvent,
    OperatorSaid,
    Reply,
    RequestPlan,
    RequestSwitch,
    Settled,
    SpecFollowed,
    SpecSwitched,
    Stop,
)
from heronry_manager.shell.control_socket import ControlSocket
from heronry_manager.shell.filler_pauses import FillerPauses
from heronry_manager.shell.journal import Journal
from heronry_manager.shell.ordered_telling import HELD_NS, OrderedTelling
from heronry_manager.shell.planner_processes import PlannerProcesses
from heronry_manager.shell.plants import Plants
from heronry_manager.shell.script_orders import ReloadSaid, ScriptSaid
from heronry_manager.shell.spec_reloads import SpecReloads
from heronry_wire.frame import Frame
from heronry_wire.identification import REQUEST_ID
from heronry_wire.identifiers import PE_NODES, state_id
from heronry_wire.protocol_times import GATHER_NS
from heronry_wire.replicated_link import AnyLink, ReplicatedLink
from heronry_wire.sansio import Received, Send, Tick
from heronry_wire.service_manager import ServiceManager
from heronry_wire.standstill import LatenessMeter
from heronry_wire.state_frames import page_of

# The manager receives commands, EMCYs, states, and the echoes of its own frames (a filter holds back echoes too), but
# no data, which is most of the traffic.
FILTERS = (
    {"can_id": REQUEST_ID, "can_mask": 0x7FE, "extended": False},  # 128 and 129: node services, channel 0
    {"can_id": 0x0C0, "can_mask": 0x7C0, "extended": False},  # 192..255
    {"can_id": 0x100, "can_mask": 0x7C0, "extended": False},  # 256..319
    {"can_id": 0x5C0, "can_mask": 0x7C0, "extended": False},  # SDO answers of nodes 64..127
    {"can_id": 0x640, "can_mask": 0x7C0, "extended": False},  # SDO requests to them
    {"can_id": 0x740, "can_mask": 0x7C0, "extended": False},  # heartbeats of nodes 64..127
)
_BURSTS = 16  # bursts of frames taken in one turn, so that a flood cannot stop the timers

_READING_NS = 5_000_000  # between looks whether a thread has read another spec

STATE_IDS = frozenset(map(state_id, PE_NODES))
Emitter = Callable[[events.Event], None]


class ManagerDriver:
    """Runs the core of a manager on its bus."""

    def __init__(
        self,
        core: ManagerCore,
        link: AnyLink,
        planners: PlannerProcesses,
        control: ControlSocket,
        *,
        journal: Journal | None,
        service: ServiceManager,
        spec: Spec,
        emit: Emitter,
        place: events.Place,
        file: str,
        reloads: SpecReloads,
        in_order: bool = False,
    ) -> None:
        """Prepare to run.

        journal: None if nothing is to survive a restart.
        emit: is called with every event.
        place: the bus of the manager, for the clients that follow the events; file: that of its spec, likewise.
        reloads: reads other specs for the order `reload`.
        in_order: whether events are delayed for a moment before `emit` is called. The manager learns the reason of a
            failure after the consequences of the failure; the delay lets people read the reason first.
        """
        self._core, self._link, self._planners, self._control = core, link, planners, control
        self._service, self._journal, self._spec = service, journal, spec
        self._tell_stream, self._place, self._file = emit, place, file
        self._telling = OrderedTelling(emit) if in_order else None
        self._reloads = reloads
        self._states: dict[int, tuple[int, Frame]] = {}  # last page 0 of each PE, and when it came
        self._plants = Plants(spec)
        self._pauses, self._has_stood_still = FillerPauses(core.heartbeat_ns), False
        self._journal_problem: str | None = None
        self._stood_still_ns = 0  # how far the core's clock is behind
        self._frozen_ns: int | None = None  # the core's time while the bus is lost; None: the bus is not lost
        self._lost_channels: frozenset[int] = frozenset()  # as the core knows them
        self._said: deque[Frame] = deque()  # ALIVE frames that were sent and are not yet reported to the core
        self._link.on_departure = self._departed
        self._meter = LatenessMeter(core.heartbeat_ns, time.monotonic_ns(), time.thread_time_ns())
        self._stop_reason: str | None = None
        self._stopping = False

    def stop(self) -> None:
        """Make `run` end at the next turn of its loop; safe in a signal handler."""
        self._stopping = True

    def run(self, *, until_eof: bool) -> str | None:
        """Run the manager until the core ends, or `stop` is called; returns the reason if the core has ended.

        until_eof: also end when standard input ends.
        """
        try:
            self._turn_until_the_end(until_eof=until_eof)
        finally:
            if self._telling is not None:
                self._telling.tell_until()
        return self._stop_reason

    def _turn_until_the_end(self, *, until_eof: bool) -> None:
        while not self._stopping and self._stop_reason is None:
            readers: list[Any] = [*self._link.readers, *([sys.stdin] if until_eof else [])]
            readers += [*self._planners.readers(), *self._control.readers()]
            core_due_ns = self._core_due_ns()
            self._meter.waits(core_due_ns, time.monotonic_ns())
            ready, _, _ = select.select(readers, self._control.followers.writers(), [], self._wait_s(core_due_ns))
            if sys.stdin in ready and not os.read(sys.stdin.fileno(), 4096):
                break
            self._let_frames_gather(ready)
            self._measure_lateness(time.monotonic_ns())
            self._take_frames()
            for answer in self._planners.poll():
                self._step(answer)
            deadline_ns = self._core.next_deadline_ns()
            if deadline_ns is not None and self._now_ns() >= deadline_ns and self._frozen_ns is None:
                self._step(Tick())
                self._service.lives(time.monotonic_ns())
            self._let_fillers_pause()
            for said in self._control.poll():
                self._said_by_operator(said)
            self._take_reloads()
            self._link.pump(time.monotonic_ns())
            self._look_at_link()
            self._look_after_journal()
            self._control.followers.pump(self._status)
            if self._telling is not None:  # while the bus is lost the clock stands still, and nothing is read from a PE
                self._telling.tell_until(self._now_ns() - HELD_NS if self._frozen_ns is None else None)

    def _let_frames_gather(self, ready: Sequence[object]) -> None:
        """Sleep on for a moment, if a frame has woken this loop, nothing is urgent, and the bus does not gather."""
        if len(ready) == 1 and ready[0] in self._link.readers and not self._link.gathers and not self._pauses.holds:
            due_ns, now_ns = self._core_due_ns(), time.monotonic_ns()
            left_ns = GATHER_NS if due_ns is None else min(GATHER_NS, due_ns - now_ns)
            time.sleep(max(0, left_ns) / 1e9)

    def _let_fillers_pause(self) -> None:
        """Stop the searches for which nobody waits while something is urgent or late; let them go on afterwards."""
        now_ns = time.monotonic_ns()
        is_pressed, self._has_stood_still = self._core.is_pressed or self._has_stood_still, False
        self._planners.hold(self._pauses.look(now_ns, is_pressed=is_pressed), now_ns)

    def _emit(self, told: events.Event) -> None:
        """Give an event to `emit` (with `in_order`, after a delay), and to all clients that follow the events."""
        if self._telling is None:
            self._tell_stream(told)
        else:
            self._telling.take(told)
        self._control.followers.tell(told)

    def _status(self) -> events.Status:
        """Make the first line for a client that begins to follow the events: a status, with the plan that runs."""
        plan = self._core.plan
        return events.Status(
            self._now_ns(),
            status={**self._core.status(), **self._beside(plan)},
            plan=None if plan is None else plan.told(),
            bus=self._place,
            file=self._file,
        )

    def _beside(self, plan: Plan | None) -> dict[str, Any]:
        """Return the keys of the status that the core does not know; `plan`: the one that runs."""
        journal = None if self._journal is None else str(self._journal.file.absolute())
        return {"files": {"spec": self._file, "journal": journal, **self._reloads.files()}, **self._plants.status(plan)}

    def _look_after_journal(self) -> None:
        """Sync the journal to the disk if no frame waits to be sent; report journal problems to the core.

        The core is told when a problem begins and when it ends.
        """
        if self._journal is None:
            return
        if self._link.nothing_waits:
            self._journal.sync(time.monotonic_ns())
        if self._journal.problem != self._journal_problem:
            self._journal_problem = self._journal.problem
            self._step(JournalTold(self._journal_problem))

    def _wait_s(self, core_due_ns: int | None) -> float | None:
        if self._control.has_orders:
            return 0
        deadlines = [self._link.next_deadline_ns(), self._planners.next_deadline_ns(), core_due_ns]
        deadlines.append(self._pauses.next_deadline_ns())
        deadlines.append(time.monotonic_ns() + _READING_NS if self._reloads.is_reading else None)
        deadlines.append(None if self._telling is None else self._on_this_clock(self._telling.due_ns()))
        waits_ns = [deadline_ns - time.monotonic_ns() for deadline_ns in deadlines if deadline_ns is not None]
        return max(0, min(waits_ns)) / 1e9 if waits_ns else None

    def _core_due_ns(self) -> int | None:
        """Return the core's deadline (ns) on this computer's clock; None: it has none, or its clock stands still."""
        return self._on_this_clock(self._core.next_deadline_ns())

    def _on_this_clock(self, core_ns: int | None) -> int | None:
        """Convert a time on the core's clock to this computer's clock; None while the core's clock stands still."""
        return None if core_ns is None or self._frozen_ns is not None else core_ns + self._stood_still_ns

    def _measure_lateness(self, now_ns: int) -> None:
        """Report a standstill of this process to the core, before any event that may follow from the standstill."""
        stood_still = self._meter.woke(now_ns, time.thread_time_ns())
        if stood_still is not None:
            self._has_stood_still = True
            self._step(stood_still)

    def _now_ns(self) -> int:
        """Return the time on the core's clock, in nanoseconds."""
        return time.monotonic_ns() - self._stood_still_ns if self._frozen_ns is None else self._frozen_ns

    def _look_at_link(self) -> None:
        """Emit the link status events of the bus; stop the core's clock while the bus is lost."""
        for sentence in self._link.take_link_events():
            self._emit(events.BusTrouble(self._now_ns(), sentence))
            self._service.status(sentence)
        is_lost = self._link.off_since_ns is not None
        if is_lost and self._frozen_ns is None:
            self._frozen_ns = self._now_ns()
        elif not is_lost and self._frozen_ns is not None:
            self._stood_still_ns, self._frozen_ns = time.monotonic_ns() - self._frozen_ns, None
        if isinstance(self._link, ReplicatedLink):
            self._compare_channels(self._link.lost_channels(time.monotonic_ns()))
        if is_lost:
            self._service.lives(time.monotonic_ns())  # without this the service manager would restart the process

    def _compare_channels(self, lost: frozenset[int]) -> None:
        if lost != self._lost_channels:
            self._lost_channels = lost
            self._step(ChannelsLost(lost))

    def _take_frames(self) -> None:
        for _ in range(_BURSTS):
            arrivals = self._link.receive(time.monotonic_ns())
            for _, frame in arrivals:
                if frame.can_id in STATE_IDS and page_of(frame.data) == 0:
                    self._states[frame.can_id] = self._now_ns(), frame
                self._step(Received(0, frame))
            while self._said:
                self._step(AliveLeft(self._said.popleft()))
            if not self._link.has_more:
                return

    def _departed(self, frame: Frame, _now_ns: int, _took_ns: int) -> None:
        """Keep an ALIVE frame that was sent on the bus; `_take_frames` reports it to the core."""
        if frame.can_id == self._core.alive_id:
            self._said.append(frame)

    def _step(self, happened: ManagerEvent) -> None:
        self._carry_out(self._core.step(self._now_ns(), happened))

    def _carry_out(self, actions: list[ManagerAction]) -> None:
        """Carry out the actions in order; then give the core the planner's answers that came immediately."""
        answers: list[ManagerEvent] = []
        has_frames = False
        for action in actions:
            match action:
                case Send(frame=frame):
                    has_frames = self._link.put(frame, time.monotonic_ns() + self._core.lease_ns)
                case RequestPlan() | Settled():
                    answers += self._planners.take(action)
                case RequestSwitch():
                    answers.append(self._reloads.first(action))
                case SpecSwitched() | SpecFollowed():
                    self._succeed(action)
                case Emit(told):
                    self._happened(told)
                case Keep(record) if self._journal is not None:
                    self._journal.write(record)
                case Reply():
                    self._answer(action)
                case Stop(reason):
                    self._stop_reason = reason
        if has_frames:
            self._link.is_calm = not self._core.is_pressed
            self._link.pump(time.monotonic_ns())
        for known in answers:
            self._step(known)

    def _happened(self, told: events.Event) -> None:
        self._emit(told)
        follows = self._plants.after(told, self._core.plan)
        if follows is not None:
            self._emit(follows)
        self._tell_what_runs(told)

    def _said_by_operator(self, said: OperatorSaid | ScriptSaid | ReloadSaid) -> None:
        if isinstance(said, ReloadSaid):
            refused = self._reloads.begin(said.number, said.order)
            if refused is not None:
                self._answer(refused)
        else:
            self._step(said.target(self._spec, self._core) if isinstance(said, ScriptSaid) else said)

    def _take_reloads(self) -> None:
        for told in self._reloads.poll(is_changing=self._core.changes_spec):
            if isinstance(told, Reply):
                self._answer(told)
            else:
                self._step(told)

    def _succeed(self, told: SpecSwitched | SpecFollowed) -> None:
        """Go on with a core of the spec by which all PEs fly now; bus, socket and journal stay."""
        switched = told if isinstance(told, SpecSwitched) else None
        found = self._reloads.follows() if switched is None else self._reloads.takes_over()
        other = found.other
        memory = other.memory(self._core.memory, switched)
        if self._journal is not None:
            self._journal.is_of(other.spec, memory)
        now_ns = self._now_ns()
        heard_ns = now_ns - 2 * self._core.heartbeat_ns
        self._core, self._planners = found.successor.make(memory, now_ns)
        self._spec, self._file, self._plants = other.spec, str(found.file.resolve()), Plants(other.spec)
        nodes = {state_id(pe.node_id) for pe in other.spec.pes.values()}
        states = (frame for at_ns, frame in self._states.values() if at_ns >= heard_ns and frame.can_id in nodes)
        if isinstance(told, SpecFollowed):
            self._core.catch_up(told.preparation)
        else:
            self._core.succeed(states)
        self._step(Tick())

    def _tell_what_runs(self, told: events.Event) -> None:
        """If the event `told` says that another plan runs from now on, send this plan to the clients.

        These are the clients that follow the events. A client may lack the plan for two reasons: it began to follow
        after the event `plan_ready`, or the epoch was adopted.
        """
        plan = self._core.plan
        if isinstance(told, events.Reconfigured | events.Adopted) and plan is not None:
            self._control.followers.tell(events.Runs(told.t_ns, told.epoch, plan.told()))

    def _answer(self, reply: Reply) -> None:
        if reply.status is not None:
            reply = replace(reply, status={**reply.status, **self._beside(self._core.plan)})
        self._control.answer(reply)
