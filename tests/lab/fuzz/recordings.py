"""Every reader of a recording: a file of events, a log of frames, and the head of a folder of `heronry record`.

What is read goes as far as a view would take it: to the last snapshot with all its panels, and to every line that is
printed. A recording that cannot be used gives a UserError.
"""

import json
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from heronry_manager.events import Event, Place, Resumed, Status
from heronry_manager.events.line import to_line
from heronry_manager.events.reading import events_in
from heronry_tools.recording.recorded_folder import HEAD, log_of, spec_of
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sources.recordings import events_of_log
from heronry_tools.watch.configurations import RunningPlan
from heronry_tools.watch.export.signals import signals_of
from heronry_tools.watch.metrics import exposition
from heronry_tools.watch.recording import Recording
from heronry_tools.watch.snapshot import document
from heronry_tools.watch.top import panels
from heronry_tools.web.recording import Recording as PageRecording
from heronry_wire.errors import HeronryError
from heronry_wire.frame import LoggedFrame, Malformed, format_log_line, parse_log_line
from lab.fuzz.decoders import spec
from lab.fuzz.target import Target

_WIDTH = 80
_MOST_EVENTS_IN_A_SEED = 12


def _events(data: bytes) -> None:
    """Read a file of events, as `top`, `web`, `metrics` and `log convert` do."""
    _shown(Recording(spec(), [], list(events_in(data.split(b"\n"))), "record"))


def _shown(recording: Recording) -> None:
    view = recording.timeline().last()
    text = json.dumps(document(view), allow_nan=False)
    text.encode()
    for look in (panels.Look(), panels.Look(next(iter(recording.spec.pes)), "a")):
        panels.joined([*panels.head(view), *panels.buses(view, _WIDTH), *panels.pes(view, look)])
        panels.joined([*panels.functions(view, look), *panels.plants(view, look), *panels.modules(view, look)])
        panels.joined([*panels.reconfigurations(view, look), *panels.events(view, look, _WIDTH)])
        "\n".join(panels.details(view, look)).encode()
    exposition(view)
    signals_of(recording)
    page = PageRecording(recording.timeline().reducer, recording.events, recording.source)
    json.dumps([page.marks, page.loads(0, len(recording.events))], allow_nan=False)
    "\n".join(page.lines()).encode()
    for told in recording.events:
        to_line(told)


def _log(data: bytes) -> None:
    """Read a log of frames; lines that are no frames are left out, as in a file."""
    parsed = (parse_log_line(line) for line in data.decode("ascii", "replace").splitlines())
    frames = sorted((one for one in parsed if isinstance(one, LoggedFrame)), key=lambda logged: logged.time_ns)
    if not frames:
        return
    with suppress(HeronryError):
        _shown(Recording(spec(), frames, events_of_log(spec(), frames, None, "fuzzed.log"), "log"))


def _folder(data: bytes) -> None:
    """Read the head of a folder, and what it names."""
    with tempfile.TemporaryDirectory(prefix="heronry-fuzz-") as name:
        folder = Path(name)
        (folder / HEAD).write_bytes(data)
        (folder / "00000001.log").write_text(format_log_line(flight().frames[0]) + "\n")
        with suppress(HeronryError):
            log_of(folder)
        with suppress(HeronryError):
            spec_of(folder)


# Seeds


@cache
def flight() -> Recording:
    """A short flight in which a PE is lost, as a log of its frames."""
    simulation = Simulation(spec(), keep_trace=True)
    simulation.run_until(900_000_000)
    simulation.fleet.kill("sensor_pe")
    simulation.run_until(1_500_000_000)
    frames = [LoggedFrame(sent.end_ns, sent.bus, sent.frame) for sent in simulation.trace]
    assert not any(isinstance(one, Malformed) for one in frames)
    return Recording(spec(), frames, events_of_log(spec(), frames, None, "flight.log"), "log")


def _event_lines() -> Iterator[bytes]:
    """Yield the events of that flight in pieces, and the two kinds that carry a document."""
    told = flight().events
    for begin in range(0, len(told), _MOST_EVENTS_IN_A_SEED):
        yield b"".join(to_line(one).encode() + b"\n" for one in told[begin : begin + _MOST_EVENTS_IN_A_SEED])
    for one in _documents():
        yield to_line(one).encode() + b"\n"


def _documents() -> Iterator[Event]:
    simulation = Simulation(spec())
    simulation.run_until(900_000_000)
    core = next(iter(simulation.managers.running.values())).core
    plan = None if core.plan is None else core.plan.told()
    yield Status(900_000_000, core.status(), plan, Place("can0", "softbus", "can0.sock"), "a.dg.yaml")
    view = document(flight().timeline().last())
    yield Resumed(900_000_000, view, plan)
    assert RunningPlan.of(spec(), plan).configuration.modules


def _log_lines() -> Iterator[bytes]:
    """Yield the beginning of that flight."""
    frames = flight().frames
    yield b"".join(format_log_line(one).encode() + b"\n" for one in frames[:90])
    yield b"".join(format_log_line(one).encode() + b"\n" for one in frames[-90:])


def _head() -> Iterator[bytes]:
    head = {"v": 1, "heronry": "0", "spec": spec().name, "spec_digest": spec().digest, "spec_file": "a.dg.yaml"}
    yield json.dumps({**head, "date_offset_ns": 7}).encode()


RECORDINGS = (
    Target("events", _events, _event_lines),
    Target("log", _log, _log_lines),
    Target("folder", _folder, _head),
)
