"""A folder of `heronry record`: the frames, events, spec and versions of a flight, in rotating files.

    FOLDER/flight.json             version of the format and of heronry, name and digest of the spec
    FOLDER/NAME.dg.yaml            the spec
    FOLDER/00000001.log            frames, as candump -L writes them
    FOLDER/00000001.events.jsonl   events and observations (`docs/watch.md`); times are those of the monotonic clock of
                                   the computer that made the recording

The last two files are a pair. When the log is full, the next pair begins, with the next number. If this would exceed
the limit of the whole folder, the oldest pair is deleted. Every pair but the first begins with the event `resumed`, a
complete snapshot. So the remaining pairs can be read without the deleted ones.

The log gives each frame with date and time. When it is read, this time is converted to the clock of the events.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from heronry_dg.model import Spec
from heronry_manager.events import Event
from heronry_manager.events.reading import events_in
from heronry_tools.console.errors import UserError
from heronry_tools.console.spec_files import load_spec
from heronry_wire.frame import LoggedFrame, Malformed, parse_log_line

FORMAT = 1
HEAD = "flight.json"
FRAMES_SUFFIX, EVENTS_SUFFIX = ".log", ".events.jsonl"


def is_recorded_folder(path: Path) -> bool:
    """Tell whether a path is a folder of `heronry record`."""
    return (path / HEAD).is_file()


def head_of(folder: Path) -> dict[str, Any]:
    """Read `flight.json`; raises UserError if it is damaged, or if its format is not `FORMAT`."""
    try:
        head = json.loads((folder / HEAD).read_text(encoding="utf-8"))
        version = head["v"]
        if version == FORMAT:
            _expect_fields(head)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        why = f"it has no {error}" if isinstance(error, KeyError) else error
        raise UserError(
            f"{folder / HEAD} cannot be read ({why}): name a log file in the folder, and the spec of that log"
        ) from None
    if version != FORMAT:
        raise UserError(
            f"{folder} has format {version}, but this version of heronry reads only format {FORMAT}: use the version "
            "that has recorded the flight"
        )
    return dict(head)


def _expect_fields(head: dict[str, Any]) -> None:
    """Raise KeyError or TypeError if the fields that are used are missing, or are of another kind."""
    texts = [head[key] for key in ("spec", "spec_digest", "spec_file")]
    if not all(isinstance(one, str) for one in texts) or type(head["date_offset_ns"]) is not int:
        raise TypeError("a field is of another kind")
    if any("\0" in one.encode().decode() for one in texts):  # encode() refuses halves of surrogate pairs
        raise ValueError("a name in it is no name of a file")


def spec_of(folder: Path, text: str | None = None) -> Spec:
    """Load the spec in a folder; if `text` is given, load the spec that `text` names instead.

    Raises UserError if the spec that `text` names is not the one with which the recording was made.
    """
    head = head_of(folder)
    if text is None:
        return load_spec(str(folder / head["spec_file"]))
    spec = load_spec(text)
    expect_spec_of(head["spec"], head["spec_digest"], spec, f"{folder} has its own spec: leave SPEC out", str(folder))
    return spec


def expect_spec_of(flown: str, digest: str, spec: Spec, remedy: str, name: str) -> None:
    """Raise UserError if the recording `name` was made with another spec.

    flown, digest: the name and the digest of the spec with which it was made.
    remedy: what the user can do, for the message.
    """
    if digest != spec.digest:
        other = "another version of this spec" if flown == spec.name else f"'{spec.name}' ({_short(spec.digest)})"
        raise UserError(f"{name} is a flight of '{flown}' ({_short(digest)}), and SPEC is {other}; {remedy}")


def _short(digest: str) -> str:
    return f"digest {digest[:8]}"


def log_of(folder: Path) -> list[LoggedFrame]:
    """Return all frames of a folder in order of time; their times are in the same clock as the folder's events.

    Lines that are no frames are left out.
    """
    frames, offset_ns = [], head_of(folder)["date_offset_ns"]
    for file in sorted(folder.glob(f"*{FRAMES_SUFFIX}")):
        for line in _whole_lines(file):
            logged = parse_log_line(line)
            if not isinstance(logged, Malformed):
                frames.append(logged._replace(time_ns=logged.time_ns - offset_ns))
    return sorted(frames, key=lambda logged: logged.time_ns)


def events_of(folder: Path) -> Iterator[Event]:
    """Return all events of a folder, in the order in which they were recorded."""
    for file in sorted(folder.glob(f"*{EVENTS_SUFFIX}")):
        yield from events_in(_whole_lines(file))


def _whole_lines(file: Path) -> list[str]:
    """Return the complete lines of a file; `heronry record` may have been killed while it wrote the last one."""
    whole, _, _ = file.read_text(encoding="utf-8", errors="replace").rpartition("\n")
    return whole.splitlines()
