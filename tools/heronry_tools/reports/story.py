"""The story of a flight: the sentences that tell its events.

`Story` gets the events one by one, and gives the lines for each event. The lines depend only on the events, so a story
is the same live, from a recorded stream, and in a test. A line has a tone, which selects its colour on a terminal.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from heronry_dg.configuration import Running
from heronry_dg.model import Function, Spec
from heronry_dg.plan_document import PlanDocument
from heronry_manager import events
from heronry_manager.events.pes import Waited
from heronry_tools.reports.plain_lines import Line, Tone, plain_line

_PATHS: Mapping[str, str] = {  # by the state of a plant in control_paths
    "unmoved": "open: no module runs on an actuator that moves it",
    "unseen": "open: no module runs on a sensor that sees it",
    "open": "open: nothing leads from a sensor that sees it to an actuator that moves it",
}
RUNS_KEPT = 5  # runs of the demo whose logs stay
_WHILE_NS = 2_000_000_000
_MOST_NAMES = 5  # of functions in one line
_SHORT_WAIT_MS = 5  # of a wait for a processor: a quarter of the usual heartbeat period, too short to make a node late
_SHARE_OF_WAITS = 10  # waits of at least a tenth of the time may keep a module from what it has to do
_LONG_STANDSTILL_NS = 100_000_000
_STARTS = events.Reconfigured | events.Adopted | events.Advice | events.UnknownEpoch


@dataclass(slots=True)
class Story:
    """Turns events into lines; the times in the lines count from the first event of a kind in `_STARTS`.

    Such an event says that a configuration was activated, adopted or advised, or that an unknown epoch runs.
    """

    spec: Spec
    _start_ns: int | None = None
    _manager_killed_ns: int | None = None
    _silences: int = 0  # outages that were reported since the manager was killed
    _suspects: set[str] = field(default_factory=set)
    _lost: dict[str, int] = field(default_factory=dict)  # when each PE was lost that has not joined since
    _standstills: dict[str, tuple[int, int]] = field(default_factory=dict)  # PE or process -> (t_ns, for_ns) told last
    _stood_still: tuple[int, int] = (0, 0)  # the last standstill of this computer: when, how long
    _plan: PlanDocument | None = None
    _paths: Mapping[str, str] = field(default_factory=dict)  # plant -> state of its control path
    _next: PlanDocument | None = None
    _prepared: dict[int, PlanDocument | None] = field(default_factory=dict)  # epoch -> its plan; `_next` may be newer

    _given_up: list[str] = field(default_factory=list)  # epochs since the last one that ran, with the reasons

    def tell(self, event: events.Event) -> list[Line]:
        """Return the lines for one event; none for an event that does not concern the reader."""
        if self._start_ns is None and isinstance(event, _STARTS):
            self._start_ns = event.t_ns
        lines = list(self._lines(event))
        stamp = "[ start  ] " if self._start_ns is None else f"[{(event.t_ns - self._start_ns) / 1e9:6.2f} s] "
        return [Line((stamp if i == 0 else " " * len(stamp)) + line.text, line.tone) for i, line in enumerate(lines)]

    def _lines(self, event: events.Event) -> Iterator[Line]:
        self._follow(event)
        plain = plain_line(event)
        if plain is not None:
            yield plain
        match event:
            case events.PeSuspected() | events.PeAnswered() | events.PeLost():
                yield from self._suspicion(event)
            case events.PeJoined(pe=pe, cause=cause) if self._plan is not None:
                yield Line(f"{pe} joins: {cause}", "good")
            case events.EpochStep(step="GO"):
                yield Line("a DEMUX waits until a silent PE has certainly stopped driving it", "quiet")
            case events.Reconfigured():
                yield from self._reconfigured(event)
            case events.ControlPaths(plants=plants):
                yield from self._control_paths(plants)
            case events.ManagerStarted(key=None):
                yield Line("no key: any node on the bus can command the system", "quiet")
            case events.TakenOver():
                yield self._taken_over(event)
            case events.Advice():
                yield _advice(event)
            case events.StoodStill():
                yield from self._standstill(event)
            case _:
                yield from self._of_the_demo(event)

    def _follow(self, event: events.Event) -> None:
        """Record what an event says about the running or next plan, an abandoned epoch, or a PE that has joined."""
        match event:
            case events.PlanReady(plan=plan):
                self._next = plan
            case events.PlanUnchanged():
                self._plan = self._next
            case events.EpochPrepared(epoch=epoch):
                self._prepared[epoch] = self._next
            case events.EpochAbandoned(epoch=epoch, reason=reason):
                self._prepared.pop(epoch, None)
                self._given_up.append(f"{epoch} ({reason})")
            case events.PeJoined(pe=pe):
                self._lost.pop(pe, None)
            case _:
                pass

    def _taken_over(self, event: events.TakenOver) -> Line:
        silent_ns, killed_ns = event.silent_ns, self._manager_killed_ns
        silent = "no manager was heard" if silent_ns is None else f"{silent_ns / 1e6:.0f} ms of silence"
        after = "" if killed_ns is None else f", {(event.t_ns - killed_ns) / 1e6:.0f} ms after the kill"
        return Line(f"THE STANDBY MANAGER TAKES OVER{after}: term {event.term}, after {silent}", "title")

    def _needs_a_line(self, event: events.StoodStill) -> bool:
        """Tell whether a standstill needs a line, and remember it if so: a busy computer has many in a row."""
        told_ns, for_ns = self._standstills.get(event.by, (-_WHILE_NS, 0))
        # longer than the last one told, or told long ago; a loss makes all be told again
        needs_one = event.for_ns > for_ns or event.t_ns - told_ns >= _WHILE_NS
        if needs_one:
            self._standstills[event.by] = event.t_ns, event.for_ns
        return needs_one

    def _standstill(self, event: events.StoodStill) -> Iterator[Line]:
        """Yield the line for a standstill, if the standstill needs one (`_needs_a_line`).

        If it is a standstill of the computer of a PE that was lost and has not joined since, the line names the loss,
        since the standstill may be the cause.
        """
        by, for_ms = event.by, event.for_ns // 1_000_000
        is_of_this_computer = by == "the demo" or by.startswith("manager ")
        if is_of_this_computer:
            self._stood_still = event.t_ns, event.for_ns
        if not self._needs_a_line(event):
            return
        if is_of_this_computer:
            noticed = f"this computer stood still for {for_ms} ms ({by} noticed it)"
            yield Line(f"{noticed}, which may be the cause of what follows", "bad")
            return
        times = "once" if event.times == 1 else f"{event.times} times"
        words = f"the computer of {by} stood still for {for_ms} ms ({times} so far)"
        lost_ns = self._lost.pop(by, None)
        if lost_ns is not None:
            at = "" if self._start_ns is None else f" at {(lost_ns - self._start_ns) / 1e9:.2f} s"
            words = f"{words}, which may be why {by} was lost{at}"
        yield Line(words, "bad")

    def _suspicion(self, event: events.PeSuspected | events.PeAnswered | events.PeLost) -> Iterator[Line]:
        """Yield a line when a PE is lost; give none when a PE is only suspected, since most suspected PEs answer."""
        pe = event.pe
        if isinstance(event, events.PeLost):
            pinged = "missed a heartbeat, was sent PINGs, " if pe in self._suspects else ""
            yield Line(f"{pe} is lost: {pinged}{event.cause}", "fault")
            if event.waited is not None:
                yield _living(pe, event.waited)
            self._lost[pe] = event.t_ns
            self._standstills.clear()
        self._suspects.discard(pe)
        if isinstance(event, events.PeSuspected):
            self._suspects.add(pe)

    def _never_driven(self, function: Function, summary: events.Summary) -> Line:
        """Return the line for a planned function that was not heard at all.

        The line names the possible causes:

        - This computer stood still, or kept a process waiting (named only if this was so).
        - The modules of the function command no device (named always).
        """
        modules, waited = self._modules(), summary.waited[function.name]
        ran = [f"{name} on {modules[name].pe}" for name in function.outputs if name in modules]
        words = f"  {function.name} was never heard: {' and '.join(ran)} drove nothing"
        told_ns, for_ns = self._stood_still
        if waited.for_ns * _SHARE_OF_WAITS >= waited.of_ns > 0:
            words = f"{words}; the process of {waited.who} {_has_waited(waited)}, which may be the cause; if not,"
        elif for_ns >= _LONG_STANDSTILL_NS and summary.t_ns - told_ns < _WHILE_NS:
            words = f"{words}; this computer stood still for {for_ns // 1_000_000} ms, which may be the cause; if not,"
        else:
            words = f"{words};"
        return Line(f"{words} a step of such a module has to command its device: ctx.write(value)", "bad")

    def _process(self, event: events.Process) -> Iterator[Line]:
        what, pe = event.what, event.pe
        if pe == "manager":
            self._manager_killed_ns, self._silences = event.t_ns, 0
            yield Line(f"KILL the manager (SIGKILL, process {event.pid}); the PEs go on without it", "title")
            return
        if what == "killed":
            runs = [name for name, running in self._modules().items() if running.pe == pe]
            yield Line(f"KILL {pe} (SIGKILL, process {event.pid}); it ran {', '.join(runs) or 'nothing'}", "title")
        elif what == "restored":
            yield Line(f"RESTORE {pe} (process {event.pid})", "title")

    def _modules(self) -> Mapping[str, Running]:
        return {} if self._plan is None else self._plan.modules

    def _reconfigured(self, event: events.Reconfigured) -> Iterator[Line]:
        before, after = self._plan, self._prepared.pop(event.epoch, None)
        times = event.times_ns.by_name()
        four = "  ".join(f"{name} {ns / 1e6:.1f} ms" for name, ns in times.items() if ns is not None)
        if after is None:  # the story begins later than this epoch's plan
            yield Line(f"epoch {event.epoch} runs ({_why(event.causes)})", "good")
            yield Line(four)
            return
        self._plan = after
        wanted = [f.name for f in self.spec.functions.values() if f.priority_in(after.phase) > 0]
        served = sum(1 for name in wanted if after.functions[name].served)
        counts = f"{len(after.modules)} modules, {served} of {len(wanted)} wanted functions served"
        yield Line(f"epoch {event.epoch} runs: {counts} ({_why(event.causes)})", "good")
        yield Line(four)
        if self._given_up:
            yield _given_up(self._given_up)
            self._given_up.clear()
        if before is not None:
            yield from _moves(before, after)
            yield from _consequences(self.spec, before, after)
        else:
            yield from self._roster(after)

    def _control_paths(self, paths: Mapping[str, str]) -> Iterator[Line]:
        """Yield a line for each plant whose control loop is closed again, or is newly open, or open in another way.

        At the first call, give a line for each plant whose control loop is open.

        paths: by name of a plant, the state of the control loop through the plant. With `on_path` the loop is
            closed; with any other state it is open, in the way that `_PATHS` says.
        """
        for plant, state in paths.items():
            was = self._paths.get(plant, "on_path")
            if state == "on_path" and was != "on_path":
                yield Line(f"the control loop through {plant} is closed again", "good")
            elif state != was:
                yield Line(f"the control loop through {plant} is {_PATHS[state]}", "bad")
        self._paths = paths

    def _roster(self, plan: PlanDocument) -> Iterator[Line]:
        for pe in self.spec.pes:
            runs = [f"{name}:{running.mode}" for name, running in plan.modules.items() if running.pe == pe]
            used, capacity = plan.pes[pe].cpu_millis if pe in plan.pes else 0, self.spec.pes[pe].cpu_millis
            names = ", ".join(name.removesuffix(":only") for name in runs)
            yield Line(f"  {pe:<10} {100 * used // capacity:>3} % CPU  {names or '-'}", "quiet")

    def _of_the_demo(self, event: events.Event) -> Iterator[Line]:
        match event:
            case events.Process():
                yield from self._process(event)
            case events.Outage():
                yield from self._outage(event)
            case events.Outages():
                yield _outages(event)
            case events.Summary():
                yield from self._summary(event)
            case events.Heartbeat():
                yield _heartbeat(event)
            case events.Logs():
                yield _logs(event)
            case events.Overtime():
                yield _overtime(event)
            case _:
                pass

    def _outage(self, event: events.Outage) -> Iterator[Line]:
        """Yield a line for the outage of a function, in two cases.

        - The function is heard again.
        - The function is still silent, although the plan serves it.

        An outage that is `gathered` gets no line here, since one line (`_outages`) reports it together with others.
        """
        self._silences += 1
        if event.gathered:
            return
        plan = self._plan
        criticality = self.spec.functions[event.function].criticality_in(None if plan is None else plan.phase)
        name = f"{event.function} (class {criticality})"
        if event.to_ns is not None:
            gap_ms = (event.to_ns - event.from_ns) / 1e6
            yield Line(f"{name} is heard again on the bus, after {gap_ms:.0f} ms of silence")
        elif plan is not None and plan.functions[event.function].served:
            yield Line(f"{name} has not been heard for {(event.t_ns - event.from_ns) / 1e6:.0f} ms", "bad")

    def _summary(self, event: events.Summary) -> Iterator[Line]:
        if self._manager_killed_ns is not None and not self._silences:
            yield Line("since the manager was killed no function has fallen silent", "good")
        yield Line(f"heard on the bus at the end: {', '.join(event.served) or 'nothing'}", "title")
        if event.unserved:
            yield Line(f"planned, but not heard: {', '.join(event.unserved)}", "bad")
        yield from (self._never_driven(self.spec.functions[name], event) for name in event.never)
        if event.pending is not None:
            yield Line(f"still under way: {event.pending}", "bad")
        yield from () if self._plan is None else self._not_served(self._plan)
        for rivals in event.rivals:
            yield Line(f"two drivers at once: {rivals}", "bad")

    def _not_served(self, plan: PlanDocument) -> Iterator[Line]:
        for name, function in plan.functions.items():
            if not function.served and self.spec.functions[name].priority_in(plan.phase) > 0:
                yield Line(f"not served: {name}: {function.why_not}")


def _outages(event: events.Outages) -> Line:
    """Return one line for many outages that have begun, or ended, within a second."""
    functions = event.functions
    more = f" and {len(functions) - _MOST_NAMES} more" if len(functions) > _MOST_NAMES else ""
    which = f": {', '.join(functions[:_MOST_NAMES])}{more}" if len(functions) > 1 else ""
    who, be, have = f"{len(functions)} functions", "are", "have"
    if len(functions) == 1:
        who, be, have = functions[0], "is", "has"
    again = "" if event.times == len(functions) else f" ({event.times} times)"
    shortest_ms, longest_ms = event.shortest_ns / 1e6, event.longest_ns / 1e6
    if event.over:
        after = f"after {shortest_ms:.0f} to {longest_ms:.0f} ms of silence"
        return Line(f"{who} {be} heard again on the bus{again}, {after}{which}")
    return Line(f"{who} {have} not been heard for up to {longest_ms:.0f} ms{which}", "bad")


def _overtime(event: events.Overtime) -> Line:
    return Line(f"the time is up; the demo waits, at most {event.at_most_s:g} s, for {'; '.join(event.awaited)}")


def _logs(event: events.Logs) -> Line:
    if not event.kept:
        return Line(f"the logs of all processes are in {event.folder}", "quiet")
    return Line(
        f"the logs of this run are kept in {event.folder}; they are deleted after {RUNS_KEPT} more runs that keep logs"
    )


def _heartbeat(event: events.Heartbeat) -> Line:
    late_ms, period_ms, own_ms = (ns / 1e6 for ns in (event.late_ns, event.period_ns, event.of_spec_ns))
    flies = f"the demo flies with a heartbeat of {period_ms:g} ms, and not {own_ms:g} ms as in the spec"
    if event.why == "given":
        return Line(f"as told by --heartbeat, {flies if period_ms != own_ms else f'the heartbeat is {own_ms:g} ms'}")
    beside = " beside a page and its browser" if event.why == "rehearsal with a page" else ""
    late = f"processes run up to {late_ms:.0f} ms late on this computer now{beside}"
    if period_ms == own_ms:
        return Line(f"{late}: it can keep the heartbeat of {own_ms:g} ms", "quiet")
    return Line(f"{late}, and a heartbeat should be twice that: {flies}")


def _living(pe: str, waited: Waited) -> Line:
    """Return the line for a PE that is lost in a demo although the process of the PE still runs.

    Only this computer can be the cause of such a loss.

    waited: the process that has waited longest for a processor, and how long.
    """
    whose = "it" if waited.who == f"pe:{pe}" else f"the process of {waited.who}"
    if waited.for_ns // 1_000_000 < _SHORT_WAIT_MS:
        return Line("  its process runs: this computer may have kept it from working", "bad")
    return Line(f"  its process runs: {whose} {_has_waited(waited)}, which may be the cause", "bad")


def _has_waited(waited: Waited) -> str:
    return f"has waited {waited.for_ns // 1_000_000} of the last {waited.of_ns // 1_000_000} ms for a processor"


def _advice(event: events.Advice) -> Line:
    moves = (("start", event.started), ("stop", event.stopped), ("move", event.moved))
    named = [f"{verb} {', '.join(modules)}" for verb, modules in moves if modules]
    return Line(f"this manager would {'; '.join(named) or 'only change modes and wires'}")


def _given_up(epochs: list[str]) -> Line:
    more = f" and {len(epochs) - _MOST_NAMES} more" if len(epochs) > _MOST_NAMES else ""
    shown = ", ".join(epochs[:_MOST_NAMES])
    return Line(f"given up before it ran: {'epoch' if len(epochs) == 1 else 'epochs'} {shown}{more}", "quiet")


def _why(causes: Sequence[str]) -> str:
    return causes[0] if len(causes) == 1 else f"{causes[0]}, and {len(causes) - 1} more"


def _moves(before: PlanDocument, after: PlanDocument) -> Iterator[Line]:
    old, new = before.modules, after.modules
    for name in sorted(old.keys() | new.keys()):
        if name not in new:
            yield Line(f"  - {name} stops (was {_place(old[name])})", "quiet")
        elif name not in old:
            yield Line(f"  + {name} starts on {_place(new[name])}", "quiet")
        elif _place(old[name]) != _place(new[name]):
            yield Line(f"  > {name} goes from {_place(old[name])} to {_place(new[name])}", "quiet")


def _place(module: Running) -> str:
    return module.pe if module.mode == "only" else f"{module.pe} ({module.mode})"


def _consequences(spec: Spec, before: PlanDocument, after: PlanDocument) -> Iterator[Line]:
    for name, now in after.functions.items():
        was = before.functions[name]
        if was.served and not now.served:
            yield _no_longer_served(spec.functions[name], before, after)
        elif now.served and not was.served:
            yield Line(f"  {name} is served again ({now.mode}, value {now.value})", "good")
        elif now.served and now.value != was.value:
            tone: Tone = "bad" if now.value < was.value else "good"
            yield Line(f"  {name}: mode {was.mode} -> {now.mode}, value {was.value} -> {now.value}", tone)
    lost = before.objective.inputs - after.objective.inputs
    if lost:
        yield Line(f"  worth of the data used: {before.objective.inputs} -> {after.objective.inputs} points")


def _no_longer_served(function: Function, before: PlanDocument, after: PlanDocument) -> Line:
    """Return the line that says why a function is no longer served.

    A function may have been served although it was not wanted, since other modules used the data of its module.
    If it is not wanted in the new phase either, the line says that this module has ended.
    """
    name, phase = function.name, after.phase
    if function.priority_in(phase) > 0 or function.priority_in(before.phase) > 0:
        return Line(f"  {name} is no longer served: {after.functions[name].why_not}", "bad")
    module = next(output for output in function.outputs if output in before.modules)
    where = f"phase {phase}" if phase is not None else "this spec"
    return Line(
        f"  {name} is no longer served: {module}, which ran on {before.modules[module].pe} because "
        f"other modules used its data, has ended; {where} does not want {name} for itself"
    )
