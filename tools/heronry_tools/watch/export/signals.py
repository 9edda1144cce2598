"""The signals of a recorded flight: variables of the spec, and figures of PEs, buses and functions.

A signal is a series of numbers with a name and a unit:

    MODULE.VARIABLE                        a variable as this module gives it; an array has .0, .1, ... for its elements
    pe.NAME.load, pe.NAME.epoch            load of a PE in %, and the epoch that it runs
    bus.NAME.load, bus.NAME.peak           load of a bus in %, and its peak
    function.NAME.served                   1: the function is served; 0: it is not

A variable that no frame carried has a series without samples, so that a reader finds every signal of the spec.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from heronry_dg.model import Spec
from heronry_manager import events
from heronry_tools.watch.data_samples import DataSource, data_sources, sample_of
from heronry_tools.watch.recording import Recording
from heronry_wire.frame import Frame, Malformed


@dataclass(slots=True)
class Series:
    """One signal: a series of numbers with their times.

    name, unit, comment: what the signal is.
    times_ns: times of the samples, in ns of the recording's clock.
    values: the samples.
    """

    name: str
    unit: str
    comment: str = ""
    times_ns: list[int] = field(default_factory=list)
    values: list[float] = field(default_factory=list)

    def add(self, t_ns: int, value: float) -> None:
        """Append a sample."""
        self.times_ns.append(t_ns)
        self.values.append(float(value))


def signals_of(recording: Recording) -> list[Series]:
    """Return all signals of a recording, in the order of the spec."""
    data = _Data(recording.spec)
    for logged in recording.frames:
        data.take(logged.time_ns, logged.frame)
    return [*data.series(), *_states(recording)]


def signal_names(spec: Spec) -> list[tuple[str, str]]:
    """List the name and the unit of every signal of a spec's variables."""
    return [(series.name, series.unit) for series in _Data(spec).series()]


class _Data:
    """Collects the values of one spec's variables from data frames."""

    def __init__(self, spec: Spec) -> None:
        self._of: dict[int, tuple[DataSource, list[Series]]] = {}
        for can_id, source in data_sources(spec).items():
            name, producer, parts = source.variable, source.producer, source.parts
            series = [
                Series(
                    f"{producer}.{name}" + (f".{part}" if parts > 1 else ""),
                    spec.variables[name].unit or "",
                    f"{name} as {producer} gives it",
                )
                for part in range(parts)
            ]
            self._of[can_id] = source, series

    def take(self, t_ns: int, frame: Frame) -> None:
        source, series = self._of.get(frame.can_id, (None, ()))
        if source is None:
            return
        sample = sample_of(source, frame)
        if not isinstance(sample, Malformed):
            for one, number in zip(series, sample.numbers, strict=False):
                one.add(t_ns, number)

    def series(self) -> Iterator[Series]:
        for _, series in self._of.values():
            yield from series


def _states(recording: Recording) -> list[Series]:
    """Return the signals of PEs, buses and functions, from the events of a recording."""
    spec, found = recording.spec, dict[str, Series]()
    for pe in spec.pes:
        found[f"pe.{pe}.load"] = Series(f"pe.{pe}.load", "%", f"CPU load that {pe} measures")
        found[f"pe.{pe}.epoch"] = Series(f"pe.{pe}.epoch", "", f"epoch that {pe} reports to run")
    for bus in spec.buses:
        found[f"bus.{bus}.load"] = Series(f"bus.{bus}.load", "%", f"load of {bus} in the last second")
        found[f"bus.{bus}.peak"] = Series(f"bus.{bus}.peak", "%", f"busiest 100 ms of {bus} in the last second")
    for function in spec.functions:
        name = f"function.{function}.served"
        found[name] = Series(name, "", f"1 while {function} is served, as planned")
    for event in recording.events:
        for name, value in _samples(event):
            if name in found and value is not None:
                found[name].add(event.t_ns, value)
    return list(found.values())


def _samples(event: events.Event) -> Iterator[tuple[str, float | None]]:
    match event:
        case events.PeSeen(pe=pe):
            yield f"pe.{pe}.load", event.load_percent
            yield f"pe.{pe}.epoch", event.epoch
        case events.BusSeen(bus=bus):
            yield f"bus.{bus}.load", 100 * event.load
            yield f"bus.{bus}.peak", 100 * event.peak
        case events.Runs(plan=plan) | events.EpochSeen(plan=plan) | events.Status(plan=plan) if plan is not None:
            for function, report in plan.functions.items():
                yield f"function.{function}.served", report.served
        case _:
            pass


def listed_events(recording: Recording) -> Sequence[events.Event]:
    """Return the events of a recording, without those that are only samples of a signal."""
    return [one for one in recording.events if not isinstance(one, events.BusSeen | events.Heard | events.PeSeen)]
