"""The processes of this computer, by their command lines (proc(5))."""

import os
from pathlib import Path


def processes_that_mention(text: str) -> list[str]:
    """Return the command lines in which a text stands, without that of this process."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue  # it has ended
        if text in words and process.name != str(os.getpid()):
            found.append(words)
    return found
