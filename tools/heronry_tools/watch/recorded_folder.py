"""A folder of `heronry record`: the frames, events, spec and versions of a flight, in rotating files.

    FOLDER/flight.json             version of the format and of heronry, name and digest of the spec
    FOLDER/NAME.dg.yaml            the spec
    FOLDER/00000001.log            frames, as candump -L writes them; the next file begins when this one has its size
    FOLDER/00000001.events.jsonl   events and observations (`docs/watch.md`), in the time of the frames

The oldest pair of files goes when the next one would exceed the limit of the whole folder. The first line of events in
every pair is a full status or the feed's first line, so what is left can be read without what is gone.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_argument import load_spec
from heronry_wire.frame import LoggedFrame, Malformed, parse_log_line

FORMAT = 1
HEAD = "flight.json"


def is_recorded_folder(path: Path) -> bool:
    """Tell whether a path is a folder of `heronry record`."""
    return (path / HEAD).is_file()


def head_of(folder: Path) -> dict[str, Any]:
    """Read the head of a folder; raises UserError for one of a later version, or damaged."""
    try:
        head = json.loads((folder / HEAD).read_text(encoding="utf-8"))
        version = head["v"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(
            f"{folder / HEAD} cannot be read ({error}): name the log in that folder, and its spec"
        ) from None
    if version != FORMAT:
        raise UserError(f"{folder} has format {version}, and this version of heronry reads format {FORMAT}")
    return dict(head)


def spec_of(folder: Path) -> Spec:
    """Load the spec in a folder."""
    return load_spec(str(folder / head_of(folder)["spec_file"]))


def log_of(folder: Path) -> list[LoggedFrame]:
    """Read all frames of a folder, in order of time; lines that are none, as the last one of a kill, are left out."""
    frames = []
    for file in sorted(folder.glob("*.log")):
        for line in file.read_text(encoding="ascii", errors="replace").splitlines():
            logged = parse_log_line(line)
            if not isinstance(logged, Malformed):
                frames.append(logged)
    return sorted(frames, key=lambda logged: logged.time_ns)


def events_of(folder: Path) -> Iterator[Mapping[str, Any]]:
    """Read all events of a folder, in order of time."""
    events = []
    for file in sorted(folder.glob("*.events.jsonl")):
        for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                events.append(json.loads(line))
            except ValueError:
                continue
    yield from sorted((one for one in events if "t_ns" in one), key=lambda event: event["t_ns"])
