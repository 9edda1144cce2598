"""The demo's loop: one select loop for events of the manager, frames of the buses, and actions of the script.

The demo's time counts from the moment at which the first configuration runs. It is measured on the monotonic clock of
this machine, like the times in the manager's events and the timestamps of the buses. The demo ends when its time is up,
with Ctrl-C, or when a process has died. In each case all its processes are ended (`Fleet`).

Reports on served functions come from the witness, which reads frames. Reports on plans come from the manager.
"""

import select
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import IO, Any, Concatenate, Literal, ParamSpec

from heronry_dg.model import Spec
from heronry_dg.plan_document import PlanDocument
from heronry_manager import events
from heronry_manager.core.vocabulary import EnterPhase
from heronry_manager.shell.ordered_telling import HELD_NS, OrderedTelling, Tell
from heronry_tools.console.errors import UserError
from heronry_tools.runtime.demo.buses import BusChoice
from heronry_tools.runtime.demo.cut_off import gateways_lost
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.runtime.demo.event_stream import EventStream
from heronry_tools.runtime.demo.fleet import Fleet
from heronry_tools.runtime.demo.held_outages import HeldOutages
from heronry_tools.runtime.demo.page import Page
from heronry_tools.runtime.demo.planning_ahead import PlanningAhead
from heronry_tools.runtime.demo.process_orders import ProcessOrders
from heronry_tools.runtime.demo.processor_waits import ProcessorWaits
from heronry_tools.runtime.demo.script import MANAGER, DemoAction, PhaseAction, default_actions
from heronry_tools.runtime.witness import Outage, Witness
from heronry_wire.frame import LoggedFrame, format_log_line
from heronry_wire.identifiers import FIRST_MANAGER, LAST_MANAGER
from heronry_wire.protocol_times import t_lease_ns
from heronry_wire.standstill import LatenessMeter, Standstills

LONGEST_START_S = 120.0  # a small computer takes long to load the solver; a process that dies is noticed immediately
GRACE_S = 15.0  # extra time for actions whose effect is not complete when the time is up
LONG_SILENCE_NS = 1_000_000_000  # a silence of this length is reported while it lasts
_LOOK_S = 0.1  # period of the check for outages
_WAITS_NS = 1_000_000_000  # a wait for a processor this long before a PE is lost counts as a cause; at least T_lease

_NOT_MEASURED = events.Waited("", 0, 0)
_Fields = ParamSpec("_Fields")
_MOST_ALONE = 3  # outages at a time that are reported one by one; more are reported in one line


class Show:
    """One run of a demo.

    fleet: the processes.
    choices: the python-can bus that stands for each bus of the spec, by the name of the bus in the spec.
    tell: gets every event, in the order of their times.
    behind: the process that makes plans for the next demo; None: there is none.
    orders: the orders of views to kill and restore PEs; None: none are taken.
    page: the process that serves a page; None: there is none.
    """

    def __init__(
        self,
        spec: Spec,
        fleet: Fleet,
        choices: Mapping[str, BusChoice],
        tell: Tell,
        behind: PlanningAhead | None = None,
        *,
        orders: ProcessOrders | None = None,
        page: Page | None = None,
    ) -> None:
        self._orders, self._page = orders, page
        self._spec, self._fleet, self._choices, self._behind = spec, fleet, choices, behind
        self._tell, self._telling = tell, OrderedTelling(self._pass_on)
        self._is_waiting_told = False  # for what is under way when the time is up
        self._actions: list[DemoAction | PhaseAction] = []
        self._has_default_actions = False
        self._seconds = 0.0
        self._witness = Witness(spec)
        self._told: set[tuple[str, int, bool]] = set()
        self._held_outages = (HeldOutages(are_over=False), HeldOutages(are_over=True))
        self._start_ns: int | None = None  # the first configuration runs
        self._pending: str | None = "the first configuration"  # what is under way
        self._plan: PlanDocument | None = None
        self._day_offset_ns = time.time_ns() - time.monotonic_ns()  # of the record, which has dates
        self._events: EventStream  # of the manager that is followed
        self._managers: dict[int, EventStream] = {}  # by node
        period_ns = spec.buses[spec.manager.bus].heartbeat_ns
        self._standstills = Standstills(period_ns)
        self._waits = ProcessorWaits(max(_WAITS_NS, t_lease_ns(period_ns)))
        self._mute = False
        self._down_since_ns: dict[str, int] = {}  # by PE that the demo has killed, until it joins again
        self._coming_back: set[str] = set()  # restored PEs that have not joined yet
        self.saw_failure = False  # a module has failed

    def run(self, actions: Sequence[DemoAction | PhaseAction] | None, seconds: float, record: IO[str] | None) -> int:
        """Run the demo for `seconds`.

        actions: what is done to the aircraft; None: `default_actions`.
        record: gets all frames as a candump log; None: no log.
        Returns 0, or 1 in these cases:

            - at the end a function of the plan is not heard
            - at the end a deployment is not complete
            - during the demo two branches of one DEMUX were driven in turn (`Witness.rivals`)
        """
        self._has_default_actions = actions is None
        self._actions, self._seconds = list(actions or ()), seconds
        with ExitStack() as stack:
            stack.callback(self._telling.tell_until)
            ears = {n: stack.enter_context(Ear(choice, self._spec.buses[n])) for n, choice in self._choices.items()}
            for choice in self._choices.values():
                self._emit(
                    events.Bus,
                    name=choice.name,
                    interface=choice.interface,
                    channel=choice.channel,
                    models=choice.describe(),
                )
            has_standby = any(isinstance(action, DemoAction) and action.pe == MANAGER for action in self._actions)
            self._events = EventStream(self._fleet.start_manager(standby=has_standby))
            self._managers[FIRST_MANAGER] = self._events
            if has_standby:
                self._managers[LAST_MANAGER] = EventStream(self._fleet.start_manager(LAST_MANAGER, standby=True))
            for pe in self._spec.pes:
                self._emit(events.Process, pe=pe, pid=self._fleet.start_pe(pe), what="started")
            self._loop(ears, record)
            return self._summary()

    def _loop(self, ears: Mapping[str, Ear], record: IO[str] | None) -> None:
        begun = time.monotonic()
        meter = LatenessMeter(self._standstills.period_ns, time.monotonic_ns(), time.thread_time_ns())
        while not self._over():
            readers: list[Any] = [self._events, *(reader for ear in ears.values() for reader in ear.readers)]
            readers += [one for door in (self._orders, self._page) if door is not None for one in door.readers()]
            wait_s = self._wait_s()
            meter.waits(time.monotonic_ns() + round(wait_s * 1e9))
            ready, _, _ = select.select(readers, [], [], wait_s)
            self._measure_lateness(meter)
            self._waits.look(time.monotonic_ns(), self._fleet.processes())
            self._serve(ready)
            complete_until_ns = time.monotonic_ns() - HELD_NS  # events that come during this turn are read in the next
            for one in self._events.take():
                self._follow(one)
            if self._behind is not None:
                self._behind.pause_if(is_something_under_way=self._pending is not None)
            for name, ear in ears.items():
                self._watch(name, ear, record)
            self._act()
            self._look()
            self._telling.tell_until(complete_until_ns)
            words = self._fleet.ended()
            if words is not None:
                raise UserError(words)
            if self._start_ns is None and time.monotonic() - begun > LONGEST_START_S:
                words = self._fleet.last_words("manager")
                raise UserError(
                    f"no configuration ran within {LONGEST_START_S:.0f} s; 'heronry plan SPEC' shows what the spec can "
                    f"run; manager: {words}"
                )

    def _measure_lateness(self, meter: LatenessMeter) -> None:
        """Report a long standstill of this process, because its actions and observations are late then."""
        now_ns = time.monotonic_ns()
        late = meter.woke(now_ns, time.thread_time_ns())
        if late is not None and self._standstills.count(late, now_ns):
            self._emit(events.StoodStill, by="the demo", for_ns=late.for_ns, times=self._standstills.long_times)

    def _over(self) -> bool:
        """Tell whether the demo may end.

        The demo ends when its time is up and nothing is awaited (`_awaited`), but GRACE_S after its time at the latest.
        """
        if self._start_ns is None or self._show_s() < self._seconds:
            return False
        if self._seconds == 0:
            return True  # the first configuration runs, and no more was requested
        awaited = self._awaited()
        if awaited and not self._is_waiting_told:
            self._is_waiting_told = True
            self._emit(events.Overtime, awaited=tuple(awaited), at_most_s=GRACE_S)
        return not awaited or self._show_s() >= self._seconds + GRACE_S

    def _awaited(self) -> list[str]:
        """Name what the demo still waits for before it ends.

        It waits for PEs to join, for a deployment to be complete, for functions to be heard, and for the page to be
        served. If the demo did not wait, what is missing at its end would look like a fault.
        """
        joining = [f"{pe} to join" for pe in sorted(self._coming_back)]
        deploying = [] if self._pending is None else [f"{self._pending} to be complete"]
        unserved = self._unserved()
        page = [] if self._page is None or self._page.is_served else ["the page to be served"]
        return [*joining, *deploying, *([f"{', '.join(unserved)} to be heard"] if unserved else []), *page]

    def _show_s(self) -> float:
        return 0.0 if self._start_ns is None else (time.monotonic_ns() - self._start_ns) / 1e9

    def _wait_s(self) -> float:
        if self._start_ns is None or not self._actions:
            return _LOOK_S
        return max(0.0, min(_LOOK_S, self._actions[0].at_s - self._show_s()))

    def _follow(self, one: events.Event) -> None:
        self._mute = self._mute and not isinstance(
            one, events.TakenOver
        )  # a standby manager repeats events of the active one
        if self._mute:
            return
        if not isinstance(one, events.Bus):  # the demo has reported it
            self._telling.take(self._noted(one))
        self.saw_failure |= isinstance(one, events.ModuleRestarted | events.ModuleFailed)
        if self._behind is not None:
            self._behind.follow(one)
        match one:
            case events.PeJoined(pe=pe) if one.t_ns >= self._down_since_ns.get(pe, 0):  # else it is an old event
                if pe in self._coming_back:  # else the manager has not noticed the kill yet
                    self._coming_back.discard(pe)
                    del self._down_since_ns[pe]
            case events.PlanRequested():
                self._pending = "a plan"
            case events.PlanReady(plan=plan):
                self._plan = plan
            case events.PlanUnchanged() | events.PlanKept():
                self._pending = None
            case events.EpochPrepared(epoch=epoch):
                self._pending = f"epoch {epoch}"
            case events.Reconfigured(epoch=epoch):
                if self._pending == f"epoch {epoch}":
                    self._pending = None
                self._begin(one.t_ns)
            case _:
                pass

    def _noted(self, one: events.Event) -> events.Event:
        """Return an event of the manager; if a PE was lost although its process runs, say why.

        If the demo has killed the gateways of the PE, that is the cause. Otherwise the field `waited` is filled.

        `_pass_on` replaces what is in the field now by the longest time for which a process has waited for a
        processor.
        """
        if isinstance(one, events.PeLost) and one.t_ns < self._down_since_ns.get(one.pe, one.t_ns + 1):
            killed = [pe for pe, since_ns in self._down_since_ns.items() if since_ns <= one.t_ns]
            gateways = gateways_lost(self._spec, one.pe, killed)
            if gateways:
                names = " and ".join(f"pe:{gateway}" for gateway in gateways)
                return replace(one, cause=f"{one.cause}; its only way to the manager led over {names}, now killed")
            return replace(one, waited=_NOT_MEASURED)
        return one

    def _pass_on(self, one: events.Event) -> None:
        """Pass on an event of the manager; if `_noted` has filled its field `waited`, set this field before.

        The field gets the longest time for which a process has waited for a processor. The processes of the lost
        PE, of the managers and of the buses count, since each may be the reason for the loss (`_waited`).
        """
        if isinstance(one, events.PeLost) and one.waited is _NOT_MEASURED:
            one = replace(one, waited=self._waited([one.pe]))
        self._tell(one)

    def _waited(self, pes: Sequence[str]) -> events.Waited:
        """Return the longest time for which a process has waited for a processor, as events name it.

        The processes of these PEs, of the managers and of the buses count: each of them may have made a PE silent.
        """
        now_ns, processes = time.monotonic_ns(), self._fleet.processes()
        longest = max((self._waits.longest(now_ns, pe, processes) for pe in pes), key=lambda wait: wait.for_ns)
        return events.Waited(longest.who, longest.for_ns, longest.of_ns)

    def _begin(self, now_ns: int) -> None:
        """Start the demo's clock, since the first configuration runs; later calls have no effect.

        If this demo has a process that makes the plans for the next demo, start this process, too.
        """
        if self._start_ns is not None:
            return
        self._start_ns = now_ns
        if self._has_default_actions:
            self._actions = [*default_actions(self._plan, self._seconds)]
        if self._behind is not None:
            self._emit(events.PlannedAhead, sentence=self._behind.start())

    def _watch(self, name: str, ear: Ear, record: IO[str] | None) -> None:
        for time_ns, frame in ear.hear():
            if name == self._spec.manager.bus:
                self._witness.see(time_ns, frame)
            if record is not None:
                date_us = (time_ns + self._day_offset_ns) // 1000
                record.write(format_log_line(LoggedFrame(date_us * 1000, name, frame)) + "\n")

    def _act(self) -> None:
        while self._start_ns is not None and self._actions and self._actions[0].at_s <= self._show_s():
            action = self._actions.pop(0)
            if isinstance(action, PhaseAction):
                self._fleet.order(EnterPhase(action.phase), f"--phase {action.phase}")
            elif action.pe == MANAGER:
                self._kill_manager()
            elif self._fleet.has_pe(action.pe) == (action.what == "kill"):  # else a view has ordered it before
                self._do(action.what, action.pe)

    def _serve(self, ready: Sequence[Any]) -> None:
        """Report the address of the page when it comes, and carry out orders of views to kill or restore a PE.

        ready: what can be read.
        """
        if self._page is not None and any(one in ready for one in self._page.readers()):
            self._emit(events.Page, address=self._page.address())
        if self._orders is not None:
            self._orders.execute(ready, self._do)

    def _do(self, what: str, pe: str) -> str:
        """Kill or restore a PE; returns a sentence that says so. Raises UserError where that cannot be done."""
        if pe not in self._spec.pes:
            raise UserError(f"{self._spec.name} has no PE '{pe}'")
        began_ns = time.monotonic_ns()  # the manager may notice before the process has ended
        if what == "kill":
            pid = self._fleet.kill_pe(pe)
            self._coming_back.discard(pe)
            self._down_since_ns[pe] = began_ns
        elif self._fleet.has_pe(pe):
            raise UserError(f"pe:{pe} runs, so it cannot be restored")
        else:
            self._coming_back.add(pe)
            pid = self._fleet.start_pe(pe)
        done: Literal["killed", "restored"] = "killed" if what == "kill" else "restored"
        self._telling.take(events.Process(began_ns, pe, pid, done))
        return f"pe:{pe} is {done} (process {pid})"

    def _kill_manager(self) -> None:
        """Kill the active manager, and read the manager's events from the standby manager from now on.

        The demo ignores the events of the standby manager until this manager takes over.
        """
        victim, began_ns = self._fleet.active_manager(), time.monotonic_ns()
        self._telling.take(events.Process(began_ns, MANAGER, self._fleet.kill_manager(victim), "killed"))
        del self._managers[victim]
        (self._events,), self._mute = self._managers.values(), True

    def _look(self) -> None:
        now_ns = time.monotonic_ns()
        self._tell_plans(None if self._behind is None else self._behind.outcome())
        if self._start_ns is None:
            return
        outages = [one for one in self._witness.outages(now_ns) if self._is_new(one, now_ns)]
        for held in self._held_outages:
            held.take(outages)
            self._tell_outages(held.due(now_ns), now_ns)

    def _is_new(self, outage: Outage, now_ns: int) -> bool:
        """Tell whether to report an outage now; if so, note that it is reported.

        An outage is reported at most twice: once while it lasts, after LONG_SILENCE_NS; and once when it is over.
        """
        over = outage.to_ns is not None
        key = (outage.function, outage.from_ns, over)
        if key in self._told or not (over or now_ns - outage.from_ns >= LONG_SILENCE_NS):
            return False
        self._told.add(key)
        return True

    def _tell_outages(self, outages: Sequence[Outage], now_ns: int) -> None:
        """Report outages, one event for each: either all of them have begun, or all of them are over.

        If there are more than `_MOST_ALONE`, one further event sums them up.
        """
        gathered = len(outages) > _MOST_ALONE
        for one in outages:
            self._emit(events.Outage, function=one.function, from_ns=one.from_ns, to_ns=one.to_ns, gathered=gathered)
        if gathered:
            lengths = [(now_ns if one.to_ns is None else one.to_ns) - one.from_ns for one in outages]
            self._emit(
                events.Outages,
                functions=tuple(dict.fromkeys(one.function for one in outages)),
                times=len(outages),
                over=outages[0].to_ns is not None,
                shortest_ns=min(lengths),
                longest_ns=max(lengths),
            )

    def _tell_plans(self, sentence: str | None) -> None:
        if sentence is not None:
            self._emit(events.PlannedAhead, sentence=sentence)

    def _unserved(self) -> list[str]:
        """Name the functions that the plan serves, but that are not served now as the witness observes it."""
        now_ns = time.monotonic_ns()
        planned = [] if self._plan is None else self._plan.served()
        return [name for name in planned if not self._witness.served(name, now_ns)]

    def _driving(self, function: str) -> list[str]:
        """Return the PEs on which the plan runs output modules of a function."""
        modules = {} if self._plan is None else self._plan.modules
        return [modules[name].pe for name in self._spec.functions[function].outputs if name in modules]

    def _summary(self) -> int:
        unserved = self._unserved()
        silent = unserved if self._seconds > 0 else []  # else no output could be heard yet
        never = [name for name in silent if self._witness.last_output(name) is None]
        waited = {name: self._waited(self._driving(name)) for name in never}
        for held in self._held_outages:
            self._tell_outages(held.all(), time.monotonic_ns())
        self._tell_plans(None if self._behind is None else self._behind.close())
        planned = [] if self._plan is None else self._plan.served()
        self._emit(
            events.Summary,
            served=tuple(name for name in planned if name not in unserved),
            unserved=tuple(silent),
            never=tuple(never),
            waited=waited,
            rivals=tuple(f"{a.module} and {b.module}" for a, b in self._witness.rivals),
            pending=self._pending,
        )
        return 1 if silent or self._witness.rivals or self._pending is not None else 0

    def _emit(
        self, kind: Callable[Concatenate[int, _Fields], events.Event], *fields: _Fields.args, **named: _Fields.kwargs
    ) -> None:
        self._telling.take(kind(time.monotonic_ns(), *fields, **named))
