"""Nothing that flies reads the clock of the day: it may be set in flight, and a suspended laptop sets it.

The test searches the source of all packages for what reads that clock, or a date made by it. Files that need it are
listed with the reason, and a file that does not need its place on the list any more is an error, too.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import heronry_agent
import heronry_dg
import heronry_manager
import heronry_tools
import heronry_wire

PACKAGES = (heronry_wire, heronry_dg, heronry_agent, heronry_manager, heronry_tools)
READERS = {
    "heronry_wire/arrival_times.py": "SocketCAN stamps frames with it: no step makes a frame newer than it is",
    "heronry_wire/clock_of_day.py": "the time before a line that a program prints",
    "heronry_tools/commands/doctor.py": "it tells that the clock is set",
    "heronry_tools/preflight/inspection.py": "it tells that the date is before that of files",
    "heronry_tools/preflight/survey.py": "it tells that the clock is set",
    "heronry_tools/runtime/demo/fleet.py": "the age of logs that are kept between runs",
    "heronry_tools/runtime/demo/run.py": "dates of the record",
    "heronry_tools/runtime/doctor/computer.py": "it tells that the date is before that of files",
    "heronry_tools/runtime/softbus/client.py": "dates of frames, for other programs of python-can",
    "heronry_tools/runtime/softbus/hub.py": "dates of frames, for other programs of python-can",
    "heronry_tools/watch/export/mf4_file.py": "the date in the head of a measurement file",
    "heronry_tools/watch/recorder.py": "the dates of recorded frames, as candump writes them",
    "heronry_tools/sim/compiled/machine_code.py": "the age of files that are kept between runs",
}

_OF_TIME = frozenset(("time", "time_ns", "ctime", "localtime", "gmtime", "strftime", "CLOCK_REALTIME"))
_OF_ANYTHING = frozenset(("timestamp", "st_mtime", "st_ctime", "st_atime", "getmtime", "getctime"))
_MODULES = frozenset(("datetime",))


def readings(tree: ast.AST) -> Iterator[ast.AST]:
    """Every place where the clock of the day, or a date, is read."""
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id="time"), attr=name) if name in _OF_TIME:
                yield node
            case ast.Attribute(attr=name) | ast.keyword(arg=str(name)) if name in _OF_ANYTHING:
                yield node
            case ast.ImportFrom(module="time", names=names) if _OF_TIME & {one.name for one in names}:
                yield node
            case ast.ImportFrom(module=str(name)) if name in _MODULES:
                yield node
            case ast.Import(names=names) if _MODULES & {one.name for one in names}:
                yield node


def test_nothing_that_flies_reads_the_clock_of_the_day() -> None:
    found: dict[str, list[int]] = {}
    for package in PACKAGES:
        root = Path(package.__path__[0])
        for path in sorted(root.rglob("*.py")):
            lines = sorted({getattr(node, "lineno", 0) for node in readings(ast.parse(path.read_text()))})
            if lines:
                found[f"{root.name}/{path.relative_to(root).as_posix()}"] = lines
    assert {path: lines for path, lines in found.items() if path not in READERS} == {}, "use time.monotonic_ns()"
    assert sorted(READERS.keys() - found.keys()) == [], "take these from the list"


def test_what_is_found() -> None:
    source = """
import time, datetime
from time import monotonic_ns, time_ns
from datetime import date
a = time.time()
b = time.monotonic_ns()
c = message.timestamp
d = can.Message(timestamp=1.0)
e = file.stat().st_mtime
f = time.clock_gettime(time.CLOCK_REALTIME)
"""
    lines = sorted(getattr(node, "lineno", 0) for node in readings(ast.parse(source)))
    assert lines == [2, 3, 4, 5, 7, 8, 9, 10]
