"""Recorded feeds: a candump log with its spec, a folder of `heronry record`, or a stream of events as JSON lines.

A log has only frames, so its events are computed. `listening` gives the events that frames show. The manager's own
events, with their causes, come from running the manager's core again on the log (`sim.replay`). This needs the solver,
a log that begins before the manager starts, and a core that decides as recorded. If one of these conditions does not
hold, the feed has no causes. A folder has the events that were recorded in flight.
"""

from collections.abc import Iterator, Sequence
from heapq import merge
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_manager.core.tables import Compiler
from heronry_manager.events import Event, Feed, ManagerStarted
from heronry_manager.events.reading import events_in
from heronry_tools.analysis.made_ahead import kept_contingencies
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import load_spec
from heronry_tools.recording.another_spec import of_another_spec
from heronry_tools.recording.masterships import RecordedMastership, masterships, on_the_managers_bus, read_recording
from heronry_tools.recording.proven import is_tagged, proven
from heronry_tools.recording.recorded_folder import events_of, expect_spec_of, is_recorded_folder, log_of, spec_of
from heronry_tools.watch.listening import Listening
from heronry_tools.watch.recording import Recording
from heronry_tools.watch.snapshot import Source
from heronry_wire.authentication import Key
from heronry_wire.frame import LoggedFrame
from heronry_wire.pe_table import PeTable


def open_recording(path: Path, spec: str | None, key: Key | None = None) -> Recording:
    """Open a log, a folder of `heronry record`, a file of events (.jsonl), or a scenario, which is flown now.

    spec: file or name of the spec; None is possible for a folder or a scenario, which name their spec.
    key: the key of the flight, if it had one; only a log needs it.
    Raises UserError if the path is none of these, if the spec is missing or is not that of the recording, or if the key
        is missing.
    """
    if is_recorded_folder(path):
        return Recording(spec_of(path, spec), log_of(path), list(events_of(path)), "record")
    if not path.exists():
        raise UserError(f"{path}: No such file or directory; name a log, or a folder of 'heronry record'")
    if path.suffix == ".scenario":
        return _flown(path)
    if path.is_dir():
        raise UserError(f"{path} is no folder of 'heronry record': name a log, or a folder of 'heronry record'")
    if spec is None:
        raise UserError(f"{path} does not name its spec: write SPEC after the file")
    loaded = load_spec(spec)
    if path.suffix == ".jsonl":
        events = list(read_events(path))
        for told in events:
            if isinstance(told, ManagerStarted | Feed):
                expect_spec_of(told.spec, told.spec_digest, loaded, "name the spec of the flight", str(path))
        return Recording(loaded, [], events, "record")
    frames, _ = read_recording(path)
    return Recording(loaded, frames, events_of_log(loaded, frames, key, str(path)), "log")


def _flown(path: Path) -> Recording:
    """Fly a scenario in the simulator, and return a recording of the flight.

    The recording has all frames, the events of the managers, and the events that the frames show.
    """
    from heronry_tools.sim.scenario.in_simulator import fly  # noqa: PLC0415 - needs the solver
    from heronry_tools.sim.scenario.script import read_script  # noqa: PLC0415 - as above

    script, frames, flights = read_script(path), list[LoggedFrame](), list[Any]()

    def watch(flight: Any) -> None:
        flights.append(flight)
        for bus in script.spec.buses:
            flight.wiring.tap(bus, lambda sent: frames.append(LoggedFrame(sent.end_ns, sent.bus, sent.frame)))

    fly(script, is_compared=False, watch=watch)
    frames.sort(key=lambda logged: logged.time_ns)
    events = _with_frames(script.spec, frames, flights[0].events, Listening(script.spec, 0, tells_why=True))
    return Recording(script.spec, frames, [_first(script.spec, 0, "simulator", knows_why=True), *events], "simulator")


def _first(spec: Spec, begins_ns: int, source: Source, *, knows_why: bool) -> Feed:
    return Feed(begins_ns, source, knows_why, spec.name, spec.digest)


def _with_frames(spec: Spec, frames: list[LoggedFrame], told: Sequence[Event], listening: Listening) -> Iterator[Event]:
    """Return, in order of time, the events that `listening` derives from the frames, and the managers' events.

    told: the managers' events.
    """
    bus_of = _buses(spec, frames)
    seen = [one for frame in frames for one in listening.take(bus_of[frame.channel], frame.time_ns, frame.frame)]
    return merge(told, seen, key=lambda event: event.t_ns)


def read_events(path: Path) -> Iterator[Event]:
    """Read events, one JSON object a line; other lines are left out. Raises UserError if there is no event."""
    found = False
    with path.open(encoding="utf-8", errors="replace") as lines:
        for event in events_in(lines):
            found = True
            yield event
    if not found:
        raise UserError(f"{path} holds no event; give the output of 'heronry manager --json' or 'heronry demo --json'")


def events_of_log(spec: Spec, frames: list[LoggedFrame], key: Key | None, name: str) -> list[Event]:
    """Compute the events of a log.

    name: the name of the log in error messages.
    Raises UserError if the flight had a key and `key` is None, or if the flight had another spec.
    """
    if is_tagged(frames) and key is None:
        raise UserError(f"{name} is of a flight with a key: name the key file with --key")
    on_the_bus = on_the_managers_bus(spec, frames, None)
    found = masterships(spec, on_the_bus if key is None else proven(spec, key, on_the_bus))
    for mastership in found:
        other = of_another_spec(spec, mastership, None)
        if other is not None:
            raise UserError(f"{name}: {other}")
    told = _why(spec, found)
    begins_ns = frames[0].time_ns
    listening = Listening(spec, begins_ns, tells_why=told is not None, key=key, tables=tables_of(spec))
    first = _first(spec, begins_ns, "log", knows_why=told is not None)
    return [first, *_with_frames(spec, frames, told or (), listening)]


def _buses(spec: Spec, frames: list[LoggedFrame]) -> dict[str, str]:
    """Return the bus of each channel of a log.

    A channel is the bus of the same name. If the log has only one channel, and no bus has its name, the channel is the
    manager's bus.
    """
    channels = list(dict.fromkeys(frame.channel for frame in frames))
    if len(channels) == 1 and channels[0] not in spec.buses:
        return {channels[0]: spec.manager.bus}
    return {channel: channel for channel in channels}


def tables_of(spec: Spec) -> tuple[PeTable, ...]:
    """Return the tables of the PEs, with the contingencies in this user's cache; without them if there is no solver."""
    try:
        from heronry_tools.sim.world.planning import prepared_with  # noqa: PLC0415 - needs the solver
    except ModuleNotFoundError:
        compiler = Compiler(spec)
        return tuple(compiler.table(pe) for pe in spec.pes)
    return tuple(prepared_with(spec, kept_contingencies(spec)).tables.values())


def _why(spec: Spec, found: Sequence[RecordedMastership]) -> list[Event] | None:
    """Return the manager's events by running its core again.

    Returns None if the recording does not begin before the manager starts, if the solver is not installed, or if the
    core decides otherwise than recorded.
    """
    if not found or found[0].epoch:
        return None
    try:
        from heronry_tools.sim.replay.comparison import compared  # noqa: PLC0415 - needs the solver
        from heronry_tools.sim.replay.rerun import Planners, Rerun  # noqa: PLC0415 - as above
        from heronry_tools.sim.world.planning import prepared_with  # noqa: PLC0415 - as above
    except ModuleNotFoundError:
        return None
    planners = Planners(spec, prepared_with(spec, kept_contingencies(spec)))
    events: list[Event] = []
    for mastership in found:
        rerun = Rerun(planners, mastership)
        rerun.run()
        if compared(mastership, rerun).differences():
            return None
        events += rerun.events
    return sorted(events, key=lambda event: event.t_ns)
