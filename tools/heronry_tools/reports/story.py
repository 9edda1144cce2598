"""The story of a flight: the sentences that tell its events.

`Story` gets the events one by one, and gives the lines for each event. The lines depend only on the events, so a story
is the same live, from a recorded stream, and in a test. A line has a tone, which selects its colour on a terminal.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from heronry_dg.model import Function, Spec

Tone = Literal["plain", "good", "bad", "fault", "quiet", "title"]


_SENTENCES: Mapping[str, tuple[str, Tone]] = {
    "bus": ("{models}", "quiet"),
    "page": ("watch it in a browser: {address}", "title"),
    "orders": ("beside this demo, in another terminal: heronry status {flags}", "quiet"),
    "planned_ahead": ("{sentence}", "quiet"),
    "manager_started": ("manager {node} on {bus}, term {term}; waiting for the PEs", "quiet"),
    "bus_trouble": ("{sentence}", "bad"),
    "commands_refused": (
        "{pe} has refused commands: {unproven} with a wrong tag, and {other} others",
        "bad",
    ),
    "states_unproven": (
        "{pe} is heard, but without a valid proof: it has another key or none, or cannot receive",
        "bad",
    ),
    "states_doubted": ("another node sends as {pe}: {refused} of its states were refused", "bad"),
    "attacked": ("ATTACK on {bus}: forged frames take {percent} % of it, {frames_per_s} in a second", "bad"),
    "outputs_held": ("{pe} holds back what {modules} drive: {cause}", "bad"),
    "outputs_free": ("{pe} drives its exclusive outputs again", "good"),
    "pe_absent": ("{pe} is absent: {cause}", "fault"),
    "pe_heard_again": ("{pe} is heard again; {cause}", "plain"),
    "module_restarted": ("{element} failed and is started again on {by} ({times})", "fault"),
    "module_failed": ("why {element} failed on {by}: {text}", "bad"),
    "fault_reported": ("{element} has failed, reported by {by}", "fault"),
    "link_limited": ("the link {bus} has {share} of its bandwidth, reported by {by}", "fault"),
    "link_gone": ("the link {bus} is gone, reported by {by}", "fault"),
    "link_back": ("the link {bus} is back, reported by {by}", "plain"),
    "channel_lost": (
        "channel {channel} carries nothing, reported by {by}; the bus works on the other channel",
        "fault",
    ),
    "channel_back": ("channel {channel} is back, reported by {by}", "plain"),
    "plan_failed": ("no plan: {reason}; the configuration stays as it is", "bad"),
    "pe_refused": ("{pe} cannot stage epoch {epoch}: {reason}", "bad"),
    "another_table": ("{pe} stages nothing: {why}", "bad"),
    "second_manager": ("manager {node} is active, too", "bad"),
    "fault_cleared": ("{element} counts as working again, cleared by {by}", "good"),
    "suspicion": ("{element} is suspected by a module on {by}: {evidence}", "quiet"),
    "suspicion_assessed": ("{element} was suspected: {found}", "quiet"),
    "unknown_element": ("module:{module} on {by} reports an element that the spec does not have", "bad"),
    "unknown_output": ("module:{module} on {by} gives a misspelt output: the log of its agent names it", "bad"),
    "disagreement": ("two inputs of module:{module} disagree (detail {detail}), reported by {by}", "bad"),
    "agreement": ("the inputs of module:{module} agree again", "good"),
    "priority_changed": ("PRIORITY of {function}: {priority} (was {before}), requested by {by}", "title"),
    "priority_refused": ("priority {priority} of {function}, requested by {by}, is refused: {why}", "bad"),
    "phase_changed": ("PHASE {phase} (was {before}), requested by {by}", "title"),
    "script_taken": ("the operator's script is deployed: {reason}", "title"),
    "script_refused": ("the operator's script changes nothing: {reason}", "bad"),
    "script_ended": ("the operator's script is held no longer: {reason}", "title"),
    "journal_failed": ("the journal cannot be written: {problem}", "bad"),
    "journal_kept": ("the journal is written again", "good"),
    "standing_by": ("a standby manager follows manager {node}, term {term}", "quiet"),
    "refused": ("most PEs do not hear the active manager: the manager begins a new term", "bad"),
    "hears_nobody": ("a manager hears no node any more: it sends nothing until it hears one", "bad"),
    "stepped_down": (
        "a manager gives up its mastership: manager {node} is active with the higher term {term}",
        "plain",
    ),
    "adopted": ("epoch {epoch} runs already: the manager adopts it as it is", "good"),
    "unknown_epoch": ("this manager does not know the running epoch {epoch}, and gives no advice", "bad"),
}
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
_STARTS = ("reconfigured", "adopted", "advice", "unknown_epoch")


@dataclass(frozen=True, slots=True)
class Line:
    """One sentence of the story."""

    text: str
    tone: Tone = "plain"


def plain_line(event: Mapping[str, Any]) -> Line | None:
    """Give the sentence of an event; None if there is none, or if the sentence would depend on other events."""
    template, tone = _SENTENCES.get(event["event"], ("", "plain"))
    return Line(template.format_map({key: _worded(value) for key, value in event.items()}), tone) if template else None


def _worded(value: Any) -> Any:
    """Join a list of names with commas; an empty list becomes "its modules". Give any other value unchanged."""
    return (", ".join(value) or "its modules") if isinstance(value, list) else value


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
    _plan: Mapping[str, Any] = field(default_factory=dict)
    _paths: Mapping[str, str] = field(default_factory=dict)  # plant -> state of its control path
    _next: Mapping[str, Any] = field(default_factory=dict)
    _prepared: dict[int, Mapping[str, Any]] = field(default_factory=dict)  # epoch -> its plan; `_next` may be newer

    _given_up: list[str] = field(default_factory=list)  # epochs since the last one that ran, with the reasons

    def tell(self, event: Mapping[str, Any]) -> list[Line]:
        """Give the lines for one event; none for an event that does not concern the reader."""
        if self._start_ns is None and event["event"] in _STARTS:
            self._start_ns = event["t_ns"]
        lines = list(self._lines(event))
        stamp = "[ start  ] " if self._start_ns is None else f"[{(event['t_ns'] - self._start_ns) / 1e9:6.2f} s] "
        return [Line((stamp if i == 0 else " " * len(stamp)) + line.text, line.tone) for i, line in enumerate(lines)]

    def _lines(self, event: Mapping[str, Any]) -> Iterator[Line]:
        kind = event["event"]
        self._follow(event)
        plain = plain_line(event)
        if plain is not None:
            yield plain
        match kind:
            case "process":
                yield from self._process(event)
            case "taken_over":
                yield self._taken_over(event)
            case "pe_suspected" | "pe_answered" | "pe_lost":
                yield from self._suspicion(event)
            case "pe_joined" if self._plan:
                yield Line(f"{event['pe']} joins: {event['cause']}", "good")
            case "epoch_step" if event["step"] == "GO":
                yield Line("a DEMUX waits until a silent PE has certainly stopped driving it", "quiet")
            case "reconfigured":
                yield from self._reconfigured(event)
            case "control_paths":
                yield from self._control_paths(event["plants"])
            case "manager_started" if event.get("key") is None:
                yield Line("no key: any node on the bus can command the system", "quiet")
            case "advice" | "heartbeat" | "logs" | "overtime":
                yield _TELLERS[kind](event)
            case "outage" | "outages" | "stood_still" | "summary":
                yield from self._noticed(event)
            case _:
                pass

    def _follow(self, event: Mapping[str, Any]) -> None:
        """Record what an event says about the running or next plan, an abandoned epoch, or a PE that has joined."""
        match event["event"]:
            case "plan_ready":
                self._next = event["plan"]
            case "plan_unchanged":
                self._plan = self._next
            case "epoch_prepared":
                self._prepared[event["epoch"]] = self._next
            case "epoch_abandoned":
                self._prepared.pop(event["epoch"], None)
                self._given_up.append(f"{event['epoch']} ({event['reason']})")
            case "pe_joined":
                self._lost.pop(event["pe"], None)
            case _:
                pass

    def _taken_over(self, event: Mapping[str, Any]) -> Line:
        silent_ns, killed_ns = event["silent_ns"], self._manager_killed_ns
        silent = "no manager was heard" if silent_ns is None else f"{silent_ns / 1e6:.0f} ms of silence"
        after = "" if killed_ns is None else f", {(event['t_ns'] - killed_ns) / 1e6:.0f} ms after the kill"
        return Line(f"THE STANDBY MANAGER TAKES OVER{after}: term {event['term']}, after {silent}", "title")

    def _needs_a_line(self, event: Mapping[str, Any]) -> bool:
        """Tell whether a standstill needs a line of its own; remember the standstill if so.

        A busy computer stands still many times in a row. So a standstill gets a line only in these cases:

        - There was no line about a standstill of its computer before.
        - There was no such line since a PE was lost. (The standstill may be the cause of the loss.)
        - The standstill is longer than the one in the last such line.
        - The last such line is at least two seconds old.
        """
        told_ns, for_ns = self._standstills.get(event["by"], (-_WHILE_NS, 0))
        needs_one = event["for_ns"] > for_ns or event["t_ns"] - told_ns >= _WHILE_NS
        if needs_one:
            self._standstills[event["by"]] = event["t_ns"], event["for_ns"]
        return bool(needs_one)

    def _standstill(self, event: Mapping[str, Any]) -> Iterator[Line]:
        """Give the line for a standstill, if the standstill needs one (`_needs_a_line`).

        If it is a standstill of the computer of a PE that was lost and has not joined since, the line names the loss,
        since the standstill may be the cause.
        """
        by, for_ms = event["by"], event["for_ns"] // 1_000_000
        is_of_this_computer = by == "the demo" or by.startswith("manager ")
        if is_of_this_computer:
            self._stood_still = event["t_ns"], event["for_ns"]
        if not self._needs_a_line(event):
            return
        if is_of_this_computer:
            noticed = f"this computer stood still for {for_ms} ms ({by} noticed it)"
            yield Line(f"{noticed}, which may be the cause of what follows", "bad")
            return
        times = "once" if event["times"] == 1 else f"{event['times']} times"
        words = f"the computer of {by} stood still for {for_ms} ms ({times} so far)"
        lost_ns = self._lost.pop(by, None)
        if lost_ns is not None:
            at = "" if self._start_ns is None else f" at {(lost_ns - self._start_ns) / 1e9:.2f} s"
            words = f"{words}, which may be why {by} was lost{at}"
        yield Line(words, "bad")

    def _suspicion(self, event: Mapping[str, Any]) -> Iterator[Line]:
        """Give a line when a PE is lost; give none when a PE is only suspected, since most suspected PEs answer."""
        pe = event["pe"]
        if event["event"] == "pe_lost":
            pinged = "missed a heartbeat, was sent PINGs, " if pe in self._suspects else ""
            yield Line(f"{pe} is lost: {pinged}{event['cause']}", "fault")
            if "waited" in event:
                yield _living(pe, event["waited"])
            self._lost[pe] = event["t_ns"]
            self._standstills.clear()
        self._suspects.discard(pe)
        if event["event"] == "pe_suspected":
            self._suspects.add(pe)

    def _never_driven(self, function: Function, summary: Mapping[str, Any]) -> Line:
        """Give the line for a planned function that was not heard at all.

        The line names the possible causes:

        - This computer stood still, or kept a process waiting (named only if this was so).
        - The modules of the function command no device (named always).
        """
        modules, waited = self._plan["modules"], summary["waited"][function.name]
        ran = [f"{name} on {modules[name]['pe']}" for name in function.outputs if name in modules]
        words = f"  {function.name} was never heard: {' and '.join(ran)} drove nothing"
        told_ns, for_ns = self._stood_still
        if waited["for_ns"] * _SHARE_OF_WAITS >= waited["of_ns"] > 0:
            words = f"{words}; the process of {waited['who']} {_has_waited(waited)}, which may be the cause; if not,"
        elif for_ns >= _LONG_STANDSTILL_NS and summary["t_ns"] - told_ns < _WHILE_NS:
            words = f"{words}; this computer stood still for {for_ns // 1_000_000} ms, which may be the cause; if not,"
        else:
            words = f"{words};"
        return Line(f"{words} a step of such a module has to command its device: ctx.write(value)", "bad")

    def _process(self, event: Mapping[str, Any]) -> Iterator[Line]:
        what, pe = event["what"], event["pe"]
        if pe == "manager":
            self._manager_killed_ns, self._silences = event["t_ns"], 0
            yield Line(f"KILL the manager (SIGKILL, process {event['pid']}); the PEs go on without it", "title")
            return
        if what == "killed":
            runs = [name for name, m in self._plan.get("modules", {}).items() if m["pe"] == pe]
            yield Line(f"KILL {pe} (SIGKILL, process {event['pid']}); it ran {', '.join(runs) or 'nothing'}", "title")
        elif what == "restored":
            yield Line(f"RESTORE {pe} (process {event['pid']})", "title")

    def _reconfigured(self, event: Mapping[str, Any]) -> Iterator[Line]:
        before, self._plan = self._plan, self._prepared.pop(event["epoch"])
        times = event["times_ns"]
        four = "  ".join(
            f"{name} {times[name] / 1e6:.1f} ms" for name in ("detect", "decide", "distribute", "activate")
        )
        wanted = [f.name for f in self.spec.functions.values() if f.priority_in(self._plan["phase"]) > 0]
        served = sum(1 for name in wanted if self._plan["functions"][name]["served"])
        counts = f"{len(self._plan['modules'])} modules, {served} of {len(wanted)} wanted functions served"
        yield Line(f"epoch {event['epoch']} runs: {counts} ({_why(event['causes'])})", "good")
        yield Line(four)
        if self._given_up:
            yield _given_up(self._given_up)
            self._given_up.clear()
        if before:
            yield from _moves(before, self._plan)
            yield from _consequences(self.spec, before, self._plan)
        else:
            yield from self._roster()

    def _control_paths(self, paths: Mapping[str, str]) -> Iterator[Line]:
        """Give a line for each plant whose control loop is closed again, or is newly open, or open in another way.

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

    def _roster(self) -> Iterator[Line]:
        for pe in self.spec.pes:
            runs = [f"{n}:{m['mode']}" for n, m in self._plan["modules"].items() if m["pe"] == pe]
            used, capacity = self._plan["pes"].get(pe, {"cpu_millis": 0})["cpu_millis"], self.spec.pes[pe].cpu_millis
            names = ", ".join(name.removesuffix(":only") for name in runs)
            yield Line(f"  {pe:<10} {100 * used // capacity:>3} % CPU  {names or '-'}", "quiet")

    def _noticed(self, event: Mapping[str, Any]) -> Iterator[Line]:
        match event["event"]:
            case "stood_still":
                yield from self._standstill(event)
            case "outage":
                yield from self._outage(event)
            case "outages":
                yield _outages(event)
            case _:
                yield from self._summary(event)

    def _outage(self, event: Mapping[str, Any]) -> Iterator[Line]:
        """Give a line for the outage of a function, in two cases.

        - The function is heard again.
        - The function is still silent, although the plan serves it.

        An outage that is `gathered` gets no line here, since one line (`_outages`) reports it together with others.
        """
        self._silences += 1
        if event.get("gathered"):
            return
        criticality = self.spec.functions[event["function"]].criticality_in(self._plan.get("phase"))
        name = f"{event['function']} (class {criticality})"
        if event["to_ns"] is not None:
            gap_ms = (event["to_ns"] - event["from_ns"]) / 1e6
            yield Line(f"{name} is heard again on the bus, after {gap_ms:.0f} ms of silence")
        elif self._plan["functions"][event["function"]]["served"]:
            yield Line(f"{name} has not been heard for {(event['t_ns'] - event['from_ns']) / 1e6:.0f} ms", "bad")

    def _summary(self, event: Mapping[str, Any]) -> Iterator[Line]:
        if self._manager_killed_ns is not None and not self._silences:
            yield Line("since the manager was killed no function has fallen silent", "good")
        yield Line(f"heard on the bus at the end: {', '.join(event['served']) or 'nothing'}", "title")
        if event["unserved"]:
            yield Line(f"planned, but not heard: {', '.join(event['unserved'])}", "bad")
        yield from (self._never_driven(self.spec.functions[name], event) for name in event["never"])
        if event["pending"] is not None:
            yield Line(f"still under way: {event['pending']}", "bad")
        for name, function in self._plan.get("functions", {}).items():
            if not function["served"] and self.spec.functions[name].priority_in(self._plan["phase"]) > 0:
                yield Line(f"not served: {name}: {function['why_not']}")
        for rivals in event["rivals"]:
            yield Line(f"two drivers at once: {rivals}", "bad")


def _outages(event: Mapping[str, Any]) -> Line:
    """Give one line for many outages that have begun, or ended, within a second."""
    functions = event["functions"]
    more = f" and {len(functions) - _MOST_NAMES} more" if len(functions) > _MOST_NAMES else ""
    which = f": {', '.join(functions[:_MOST_NAMES])}{more}" if len(functions) > 1 else ""
    who, be, have = f"{len(functions)} functions", "are", "have"
    if len(functions) == 1:
        who, be, have = functions[0], "is", "has"
    again = "" if event["times"] == len(functions) else f" ({event['times']} times)"
    shortest_ms, longest_ms = event["shortest_ns"] / 1e6, event["longest_ns"] / 1e6
    if event["over"]:
        after = f"after {shortest_ms:.0f} to {longest_ms:.0f} ms of silence"
        return Line(f"{who} {be} heard again on the bus{again}, {after}{which}")
    return Line(f"{who} {have} not been heard for up to {longest_ms:.0f} ms{which}", "bad")


def _overtime(event: Mapping[str, Any]) -> Line:
    return Line(f"the time is up; the demo waits, at most {event['at_most_s']:g} s, for {'; '.join(event['awaited'])}")


def _logs(event: Mapping[str, Any]) -> Line:
    if not event["kept"]:
        return Line(f"the logs of all processes are in {event['folder']}", "quiet")
    return Line(
        f"the logs of this run are kept in {event['folder']}; "
        f"they are deleted after {RUNS_KEPT} more runs that keep logs"
    )


def _heartbeat(event: Mapping[str, Any]) -> Line:
    late_ms, period_ms, own_ms = (event[key] / 1e6 for key in ("late_ns", "period_ns", "of_spec_ns"))
    late = f"processes run up to {late_ms:.0f} ms late on this computer now"
    if period_ms == own_ms:
        return Line(f"{late}: it can keep the heartbeat of {own_ms:g} ms", "quiet")
    return Line(f"{late}: the demo flies with a heartbeat of {period_ms:g} ms, and not {own_ms:g} ms as in the spec")


def _living(pe: str, waited: Mapping[str, Any]) -> Line:
    """Give the line for a PE that is lost in a demo although the process of the PE still runs.

    Only this computer can be the cause of such a loss.

    waited: the process that has waited longest for a processor, and how long.
    """
    whose = "it" if waited["who"] == f"pe:{pe}" else f"the process of {waited['who']}"
    if waited["for_ns"] // 1_000_000 < _SHORT_WAIT_MS:
        return Line("  its process runs: this computer may have kept it from working", "bad")
    return Line(f"  its process runs: {whose} {_has_waited(waited)}, which may be the cause", "bad")


def _has_waited(waited: Mapping[str, Any]) -> str:
    return f"has waited {waited['for_ns'] // 1_000_000} of the last {waited['of_ns'] // 1_000_000} ms for a processor"


def _advice(event: Mapping[str, Any]) -> Line:
    moves = (("start", event["started"]), ("stop", event["stopped"]), ("move", event["moved"]))
    named = [f"{verb} {', '.join(modules)}" for verb, modules in moves if modules]
    return Line(f"this manager would {'; '.join(named) or 'only change modes and wires'}")


def _given_up(epochs: list[str]) -> Line:
    more = f" and {len(epochs) - _MOST_NAMES} more" if len(epochs) > _MOST_NAMES else ""
    shown = ", ".join(epochs[:_MOST_NAMES])
    return Line(f"given up before it ran: {'epoch' if len(epochs) == 1 else 'epochs'} {shown}{more}", "quiet")


def _why(causes: list[str]) -> str:
    return causes[0] if len(causes) == 1 else f"{causes[0]}, and {len(causes) - 1} more"


def _moves(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[Line]:
    old, new = before["modules"], after["modules"]
    for name in sorted(old.keys() | new.keys()):
        if name not in new:
            yield Line(f"  - {name} stops (was {_place(old[name])})", "quiet")
        elif name not in old:
            yield Line(f"  + {name} starts on {_place(new[name])}", "quiet")
        elif _place(old[name]) != _place(new[name]):
            yield Line(f"  > {name} goes from {_place(old[name])} to {_place(new[name])}", "quiet")


def _place(module: Mapping[str, Any]) -> str:
    return str(module["pe"]) if module["mode"] == "only" else f"{module['pe']} ({module['mode']})"


def _consequences(spec: Spec, before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[Line]:
    for name, now in after["functions"].items():
        was = before["functions"][name]
        if was["served"] and not now["served"]:
            yield _no_longer_served(spec.functions[name], before, after)
        elif now["served"] and not was["served"]:
            yield Line(f"  {name} is served again ({now['mode']}, value {now['value']})", "good")
        elif now["served"] and now["value"] != was["value"]:
            tone: Tone = "bad" if now["value"] < was["value"] else "good"
            yield Line(f"  {name}: mode {was['mode']} -> {now['mode']}, value {was['value']} -> {now['value']}", tone)
    lost = before["objective"]["inputs"] - after["objective"]["inputs"]
    if lost:
        yield Line(
            f"  worth of the data used: {before['objective']['inputs']} -> {after['objective']['inputs']} points"
        )


def _no_longer_served(function: Function, before: Mapping[str, Any], after: Mapping[str, Any]) -> Line:
    """Give the line that says why a function is no longer served.

    A function may have been served although it was not wanted, since other modules used the data of its module.
    If it is not wanted in the new phase either, the line says that this module has ended.
    """
    name, phase = function.name, after["phase"]
    if function.priority_in(phase) > 0 or function.priority_in(before["phase"]) > 0:
        return Line(f"  {name} is no longer served: {after['functions'][name]['why_not']}", "bad")
    module = next(output for output in function.outputs if output in before["modules"])
    where = f"phase {phase}" if phase is not None else "this spec"
    return Line(
        f"  {name} is no longer served: {module}, which ran on {before['modules'][module]['pe']} because "
        f"other modules used its data, has ended; {where} does not want {name} for itself"
    )


_TELLERS: Mapping[str, Callable[[Mapping[str, Any]], Line]] = {
    "advice": _advice,
    "heartbeat": _heartbeat,
    "logs": _logs,
    "overtime": _overtime,
}
