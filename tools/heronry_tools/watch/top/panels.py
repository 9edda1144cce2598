"""A snapshot as the panels of `heronry top`: coloured text, one fact a line.

A letter stands beside every colour, for terminals without colours. Each function gives the lines of one panel. A line
that is longer than the panel is wide goes on below (`app.tcss`), but for those of the buses, which are cut.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rich.text import Text

from heronry_tools.watch.snapshot import (
    Budget,
    Bus,
    Function,
    Module,
    Pe,
    Plant,
    Reconfiguration,
    Silence,
    Snapshot,
    Told,
)

_STANDING = {
    "up": ("U", "green"),
    "suspect": ("?", "yellow"),
    "down": ("X", "bold red"),
    "returning": ("R", "cyan"),
    "waiting": ("w", "dim"),
}
_SEVERITY = {
    "error": ("E", "bold red"),
    "warning": ("W", "yellow"),
    "notice": ("N", "bold"),
    "good": ("+", "green"),
    "detail": (" ", "dim"),
}
_NS_PER_S = 1_000_000_000
_LOST_IN_HEAD = 2
LEGEND = (
    "PEs        U up   ? suspect   R returning   X down   w never heard",
    "functions  S served   d degraded   L lost   - not wanted   ~ served, but not heard on the bus",
    "loops      C closed   O open   ? not known",
    "modules    r runs   d in a lesser mode   . not needed   x cannot run",
    "events     E error   W warning   N notice   + good",
    "reconfigurations   times in ms; m/s/s: so many modules moved, started, stopped",
)


@dataclass(frozen=True, slots=True)
class Look:
    """What the user has chosen: the selected PE, and the words of the filter."""

    selected: str = ""  # a PE
    words: str = ""  # of the filter


def seconds(ns: int | None, digits: int = 1) -> str:
    """Write a duration in seconds; `-` for one that is not known."""
    return "-" if ns is None else f"{ns / _NS_PER_S:.{digits}f}s"


def head(view: Snapshot) -> list[Text]:
    """Return the head of the view: a line about the system, and lines about what is wrong with the system.

    The first line has spec, phase, epoch, term, manager and stage (for example PLANNING or RUNNING).
    Below it there is a line with all that is wrong but for lost functions, and one for each of the first lost ones:
    these are the longest, so where a small terminal has no room, it is the last reason that is cut.
    """
    manager = view.manager
    state = manager.state or "not heard"
    line = Text.assemble((view.spec, "bold"), f"  phase {view.phase or '-'}  ")
    epoch = view.epoch if view.epoch is not None else f"{view.unknown_epoch} (unknown)" if view.unknown_epoch else "-"
    line.append(f"epoch {epoch}", "bold")
    line.append(f"  term {manager.term if manager.term is not None else '-'}  ")
    line.append(f"manager {manager.node or '-'} {state}  ")
    line.append(view.stage.upper(), "bold green" if view.stage == "running" else "bold yellow")
    lines = [line]
    notes = [] if view.knows_why else ["the bus alone: no causes are known"]
    notes += [f"{fault.element} failed ({fault.by})" for fault in view.faults]
    notes += [f"{one.module} {_silent(one)}" for one in view.silences]
    is_open = [name for name, plant in view.plants.items() if plant.state not in ("on_path", None)]
    notes += [f"the loop through {name} is open" for name in is_open]
    notes += [f"{view.lost_lines} events missed"] if view.lost_lines else []
    notes += [f"journal: {manager.journal}"] if manager.journal else []
    if notes:
        lines.append(Text("! " + "; ".join(notes), "yellow"))
    lines += [Text(f"+ {line}", "cyan") for line in coming(view)]
    lost = [(name, one) for name, one in view.functions.items() if one.wanted and one.served is False]
    lines += [Text(f"lost: {name} <- {one.why_not}", "bold red") for name, one in lost[:_LOST_IN_HEAD] if view.epoch]
    return lines


def coming(view: Snapshot) -> list[str]:
    """Return a line for each table and each code that a PE waits for, and for each node that the spec does not have."""
    lines = []
    for one in view.transfers:
        percent = "" if one.percent is None else f"{one.percent} % of "
        lines.append(f"{one.pe} waits for {percent}its {one.what}: {one.says}")
    for node in view.strangers:
        offer = "" if node.offer is None else f" ({node.offer})"
        adopt = "" if node.adopt is None else f": {node.adopt}"
        lines.append(f"node {node.node} is not in the spec: it {node.says}{offer}{adopt}")
    return lines


def _silent(one: Silence) -> str:
    return f"gives no {one.variable}" if one.what == "output" else f"gets no {one.variable} from {one.producer}"


def buses(view: Snapshot, width: int) -> list[Text]:
    """Return one line for each bus: a bar of its load, and the present, the peak and the planned load in percent."""
    return [_bus(name, bus, max(8, min(40, width - 52))) for name, bus in view.buses.items()]


def _bus(name: str, bus: Bus, cells: int) -> Text:
    load, peak = bus.load or 0.0, bus.peak or 0.0
    full, high = round(min(load, 1) * cells), round(min(peak, 1) * cells)
    colour = "red" if load > bus.most else "yellow" if peak > bus.most else "green"
    line = Text.assemble(f"{name:<8.8} ", ("█" * full, colour), ("▒" * max(0, high - full), colour))
    line.append("·" * max(0, cells - max(full, high)), "dim")
    measured = "not heard here" if bus.load is None else f"{100 * load:3.0f}% peak {100 * peak:3.0f}%"
    planned = "" if bus.planned is None else f" planned {100 * bus.planned:.0f}%"
    line.append(f" {measured}{planned}")
    troubles = [f"{lacking} lack {channel}" for channel, by in bus.channels.items() if (lacking := ", ".join(by))]
    troubles += [f"link {bus.link}"] if bus.link else []
    troubles += [bus.trouble or ""] + ([f"{bus.errors} errors"] if bus.errors else [])
    line.append(f" {'; '.join(filter(None, troubles))}", "bold red")
    return line


def pes(view: Snapshot, look: Look) -> list[Text]:
    """Return a heading, and one line for each PE that matches the filter."""
    lines = [Text("  PE         heard epoch CPU     mod rst", "bold")]
    for name, pe in view.pes.items():
        if _matches(look, name, pe.why):
            lines.append(_pe(view, name, pe, is_selected=name == look.selected))
    return lines


def _pe(view: Snapshot, name: str, pe: Pe, *, is_selected: bool) -> Text:
    letter, colour = _STANDING[pe.standing]
    age = None if pe.last_heard_ns is None else max(0, view.t_ns - pe.last_heard_ns)
    line = Text.assemble((letter, colour), ">" if is_selected else " ", (f"{name:<10.10}", colour))
    line.append(f" {seconds(age):>5} ")
    if pe.why and pe.standing in ("down", "returning"):
        line.append(pe.why, "yellow")
    else:
        line.append(f"{pe.epoch if pe.epoch is not None else '-':>5} {_bar(pe.cpu, 6)}")
        line.append(f" {len(pe.modules):>4} {pe.restarts + pe.reboots:>3}")
    if is_selected:
        line.stylize("reverse")
    return line


def _bar(budget: Budget, cells: int) -> str:
    full = round(cells * budget.used / budget.of) if budget.of else 0
    return "▮" * min(full, cells) + "▯" * max(0, cells - full)


def function_state(function: Function) -> tuple[str, str]:
    """Return the letter and the colour for the state of a function."""
    if not function.wanted:
        return "-", "dim"
    if function.served is None:
        return "?", "yellow"
    if not function.served:
        return "L", "bold red"
    if function.heard is False:
        return "~", "yellow"
    return ("d", "yellow") if function.degraded or function.shortfalls else ("S", "green")


def functions(view: Snapshot, look: Look) -> list[Text]:
    """Return a heading, one line for each wanted function, and one line with the names of the other functions.

    A wanted function that is not served has `lost`, for how long, and after `<-` the reason. Functions that do
    not match the filter are left out.
    """
    lines = [Text("  function         cl mode", "bold")]
    shown = [(name, one) for name, one in view.functions.items() if _matches(look, name, one.why_not, one.mode)]
    lines += [_function(view, name, one) for name, one in shown if one.wanted]
    unwanted = [name for name, one in shown if not one.wanted]
    return [*lines, Text(f"- not wanted: {', '.join(unwanted)}", "dim")] if unwanted else lines


def _function(view: Snapshot, name: str, one: Function) -> Text:
    letter, colour = function_state(one)
    line = Text.assemble((letter, colour), f" {name:<16.16} {one.criticality}  ")
    if letter == "L":
        since = None if one.not_since_ns is None else view.t_ns - one.not_since_ns
        line.append(f"lost {seconds(since)} <- {one.why_not or 'the bus does not tell why'}", colour)
    elif one.served:
        line.append(f"{one.mode}" + (" (not heard)" if one.heard is False else ""))
        line.append(f" <- {one.shortfalls[0]}" if one.shortfalls else "", "yellow")
    else:
        line.append(one.why_not or "", colour)
    return line


def plants(view: Snapshot, look: Look) -> list[Text]:
    """Return a heading, and a line for each plant that matches the filter; nothing if no plant matches.

    The line says whether the control loop through the plant is closed, and if it is open, why.
    """
    shown = [(name, one) for name, one in view.plants.items() if _matches(look, name, one.why)]
    return [Text("  loop through", "bold"), *(_plant(name, one) for name, one in shown)] if shown else []


def _plant(name: str, one: Plant) -> Text:
    letter, colour = ("?", "dim") if one.state is None else ("C", "green") if one.state == "on_path" else ("O", "red")
    said = {None: "not known", "on_path": "closed"}.get(one.state, f"open <- {one.why}")
    return Text.assemble((letter, colour), f" {name:<19.19} ", (said, colour if letter == "O" else ""))


def modules(view: Snapshot, look: Look) -> list[Text]:
    """Return the lines of the selected PE's modules."""
    pe = view.pes.get(look.selected)
    if pe is None:
        return [Text("no PE is selected: press down", "dim")]
    used = ", ".join(f"{kind} {b.used}/{b.of}" for kind, b in (("CPU", pe.cpu), ("RAM", pe.ram), ("flash", pe.flash)))
    lines = [Text(f"modules of {look.selected} ({used})", "bold")]
    here = {name: view.modules[name] for name in pe.modules if name in view.modules}
    widths = (max(map(len, here), default=0), max((len(module.mode or "") for module in here.values()), default=0))
    lines += [_module(name, module, widths) for name, module in here.items() if _matches(look, name, module.mode)]
    return lines if here else [*lines, Text("  none", "dim")]


def _module(name: str, module: Module, widths: tuple[int, int]) -> Text:
    letter, (of_name, of_mode) = "d" if module.degraded else "r", widths
    line = Text.assemble(
        (f"{letter} ", "yellow" if module.degraded else "green"), f"{name:<{of_name}} {module.mode or '':<{of_mode}}"
    )
    wires = dict.fromkeys(f"{wire.producer}" for wire in module.wires.values())
    line.append(f" <- {', '.join(wires)}" if wires else "", "dim")
    line.append(f" {module.restarts} restarts" if module.restarts else "", "yellow")
    line.append(f" {module.failure}" if module.failure else "", "red")
    return line


def reconfigurations(view: Snapshot, look: Look) -> list[Text]:
    """Return the last reconfigurations, newest first."""
    lines = [Text("epoch  detect decide distr. activ.  m/s/s    lost <- why", "bold")]
    shown = (one for one in reversed(view.reconfigurations) if _matches(look, one.sentence, *one.lost))
    lines += map(_reconfiguration, shown)
    return lines if len(lines) > 1 else [*lines, Text("none yet", "dim")]


def _reconfiguration(one: Reconfiguration) -> Text:
    times = (one.times_ns.detect, one.times_ns.decide, one.times_ns.distribute, one.times_ns.activate)
    four = " ".join(f"{'-' if ns is None else f'{ns / 1e6:.1f}':>6}" for ns in times)
    moves = f"{len(one.moved)}/{len(one.started)}/{len(one.stopped)}"
    line = Text(f"{one.epoch:>5}  {four}  {moves:<7}  ")
    line.append(f"lost {', '.join(one.lost)} " if one.lost else "", "bold red")
    line.append(f"back {', '.join(one.gained)} " if one.gained and one.number > 1 else "", "green")
    line.append(f"<- {one.causes[0]}" if one.causes else "<- not known")
    return line


def events(view: Snapshot, look: Look, most: int) -> list[Text]:
    """Return the last events, at most `most`, newest first."""
    shown = [told for told in reversed(view.told) if _matches(look, told.sentence, told.event)]
    return [_told(view, told) for told in shown[:most]] or [Text("nothing yet", "dim")]


def _told(view: Snapshot, told: Told) -> Text:
    letter, colour = _SEVERITY[told.severity]
    at = told.t_ns - (view.began_ns or 0)
    return Text.assemble((f"{letter} ", colour), (f"{at / _NS_PER_S:9.2f} ", "dim"), (told.sentence, colour))


def details(view: Snapshot, look: Look) -> Iterator[str]:
    """Return the details that a page shows, as lines of text.

    These are all that is known of the selected PE and of the last reconfiguration. At the end come what is silent, what
    is less than the best upstream of the functions, and the wanted functions that are not served, with the reasons.
    """
    pe = view.pes.get(look.selected)
    if pe is not None:
        yield f"PE {look.selected} (node {pe.node_id}) is {pe.standing}" + (f": {pe.why}" if pe.why else "")
        boot = "" if pe.incarnation is None else f"boot number {pe.incarnation}, "
        yield f"  {boot}{pe.reboots} reboots seen, {pe.restarts} restarts of modules"
        runs = "no epoch" if pe.epoch is None else f"epoch {pe.epoch} ({pe.runs})"
        hears = {True: "hears a manager", False: "hears no manager", None: "was not heard here"}[pe.hears_manager]
        load = "" if pe.load_percent is None else f", CPU load {pe.load_percent} %"
        yield f"  it reports {runs}, {hears}{load}"
        cost = "" if pe.cost is None else f"; its agent in 10 s: {pe.cost.sentence}"
        yield f"  standstills of its computer: {pe.stood_still}{cost}"
        for name in pe.modules:
            module = view.modules[name]
            yield f"  {name} in mode {module.mode}"
            yield from (
                f"    {path or '.'} <- {w.variable}@{w.version} of {w.producer}" for path, w in module.wires.items()
            )
    if view.reconfigurations:
        last = view.reconfigurations[-1]
        yield ""
        yield last.sentence
        for word, names in (("moved", last.moved), ("started", last.started), ("stopped", last.stopped)):
            for name in names:
                places = [last.before.get(name), last.after.get(name)]
                yield f"  {word} {name}: {' -> '.join(f'{p.pe} ({p.mode})' for p in places if p is not None)}"
        for word, names in (
            ("lost", last.lost),
            ("no longer wanted", last.unwanted),
            ("back", last.gained),
            ("kept", last.kept),
        ):
            if names:
                yield f"  {word}: {', '.join(names)}"
        for outage in last.outages:
            gap = "still silent" if outage.to_ns is None else f"{(outage.to_ns - outage.from_ns) / 1e6:.0f} ms"
            yield f"  {outage.function} was not heard: {gap}"
    for silence in view.silences:
        yield f"{silence.module} on {silence.by} {_silent(silence)}"
    for name, one in view.functions.items():
        yield from (f"{name} is served, but {what}" for what in one.shortfalls)
    unserved = [(name, one) for name, one in view.functions.items() if one.wanted and one.served is False]
    if unserved:
        yield ""
        yield from (f"{name} is not served: {one.why_not}" for name, one in unserved)


def _matches(look: Look, *texts: str | None) -> bool:
    return not look.words or any(look.words.lower() in text.lower() for text in texts if text)


def joined(lines: Sequence[Text]) -> Text:
    """Join lines into one text; the style sheet says which panels continue a long line below, and which cut it off."""
    return Text("\n").join(lines)
