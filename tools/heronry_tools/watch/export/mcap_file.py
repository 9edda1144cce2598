"""A recorded flight as an MCAP file, with a summary: channels of JSON that Foxglove, Lichtblick and PlotJuggler plot.

/signals/NAME          {"value": number}; its unit is in the channel's metadata and in its schema
/events                foxglove.Log: level, time, sentence; and the event itself, in the field `event`
/reconfigurations      as in the snapshot (docs/watch.md)
"""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from heronry_manager.events.line import to_object
from heronry_tools.watch.export.signals import Series, listed_events, signals_of
from heronry_tools.watch.recording import Recording
from heronry_tools.watch.sentences import sentence_of
from heronry_tools.watch.snapshot import Reconfiguration
from heronry_wire.command_parser import program_version

_LEVELS = {"error": 4, "warning": 3, "notice": 2, "good": 2, "detail": 1}  # of foxglove.Log
_NS_PER_S = 1_000_000_000
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_LOG = {
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "event": {"type": "object"},
    },
}


def write_mcap(recording: Recording, reconfigurations: tuple[Reconfiguration, ...], file: Path) -> None:
    """Write a recorded flight to an MCAP file.

    reconfigurations: all reconfigurations of the recording.
    """
    with file.open("wb") as stream:
        writer: Any = Writer(stream)  # in part without types
        writer.start(profile="", library=f"heronry {program_version()}")
        spec = recording.spec
        writer.add_metadata("heronry", {"spec": spec.name, "spec_digest": spec.digest, "source": recording.source})
        for series in signals_of(recording):
            _write_signal(writer, series)
        _write_events(writer, recording)
        schema = writer.register_schema("heronry.Reconfiguration", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/reconfigurations", "json", schema)
        for one in reconfigurations:
            _add(writer, channel, one.done_ns, asdict(one))
        writer.finish()


def _write_signal(writer: Any, series: Series) -> None:
    value = {"type": "number", "description": f"{series.comment}, in {series.unit or '1'}"}
    shape = {"type": "object", "title": series.name, "properties": {"value": value}}
    schema = writer.register_schema(f"heronry.{series.name}", "jsonschema", json.dumps(shape).encode())
    channel = writer.register_channel(f"/signals/{series.name}", "json", schema, {"unit": series.unit})
    for t_ns, number in zip(series.times_ns, series.values, strict=True):
        _add(writer, channel, t_ns, {"value": number})


def _write_events(writer: Any, recording: Recording) -> None:
    schema = writer.register_schema("foxglove.Log", "jsonschema", json.dumps(_LOG).encode())
    channel = writer.register_channel("/events", "json", schema)
    for event in listed_events(recording):
        severity, sentence = sentence_of(event) or ("detail", event.kind)
        sec, nsec = divmod(event.t_ns, _NS_PER_S)
        stamp = {"timestamp": {"sec": sec, "nsec": nsec}, "level": _LEVELS[severity]}
        said = {"message": sentence, "name": event.kind, "event": to_object(event)}
        _add(writer, channel, event.t_ns, {**stamp, **said})


def _add(writer: Any, channel: int, t_ns: int, message: Mapping[str, Any]) -> None:
    writer.add_message(channel, log_time=t_ns, publish_time=t_ns, data=json.dumps(message).encode())
