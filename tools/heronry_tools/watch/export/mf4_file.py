"""A recorded flight as an MDF 4 file (ASAM), for asammdf and other measurement tools.

Every signal has a channel with the signal's name and unit, in a channel group with its own times. There are two
channels of text: `events` contains sentences, and `reconfigurations` contains JSON as in the snapshot (docs/watch.md).
Times are seconds since the first frame or event of the recording. If the recording has dates, the start time in the
file is the date of that first frame or event.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from heronry_tools.watch.export.signals import listed_events, signals_of
from heronry_tools.watch.recording import Recording
from heronry_tools.watch.sentences import sentence_of
from heronry_tools.watch.snapshot import Reconfiguration
from heronry_wire.command_parser import program_version

_NS_PER_S = 1_000_000_000
_LEAST_DATE_NS = 10**18  # a time below this (the year 2001) is no date


def write_mf4(recording: Recording, reconfigurations: tuple[Reconfiguration, ...], file: Path) -> None:
    """Write a recording and its reconfigurations to an MDF 4 file; an existing file is replaced.

    reconfigurations: those of the whole recording.
    """
    import numpy as np  # noqa: PLC0415 - slow to import, and MCAP needs none
    from asammdf import MDF, Signal  # noqa: PLC0415 - as above

    begins_ns = recording.timeline().begins_ns
    with MDF(version="4.10") as mdf:
        if begins_ns > _LEAST_DATE_NS:
            mdf.header.start_time = datetime.fromtimestamp(begins_ns / _NS_PER_S, UTC)
        mdf.header.comment = f"{recording.spec.name} ({recording.spec.digest[:12]}), heronry {program_version()}"
        for series in signals_of(recording):
            times = (np.array(series.times_ns, dtype=np.int64) - begins_ns) / _NS_PER_S
            samples = np.array(series.values, dtype=np.float64)
            mdf.append(Signal(samples, times, name=series.name, unit=series.unit, comment=series.comment))
        events = [(one.t_ns, sentence_of(one)) for one in listed_events(recording)]
        said = [(t_ns, text[1]) for t_ns, text in events if text is not None]
        told = [(one.done_ns, json.dumps(asdict(one))) for one in reconfigurations]
        for name, texts in (("events", said), ("reconfigurations", told)):
            if texts:
                mdf.append(_text_signal(Signal, np, name, texts, begins_ns))
        mdf.save(file, overwrite=True)


def _text_signal(signal: Any, np: Any, name: str, texts: Sequence[tuple[int, str]], begins_ns: int) -> Any:
    times = np.array([(t_ns - begins_ns) / _NS_PER_S for t_ns, _ in texts])
    return signal(np.array([text.encode() for _, text in texts]), times, name=name, encoding="utf-8")
