"""The event stream on standard output, one JSON line each, flushed at once so that a pipe follows live."""

import sys
from collections.abc import Mapping
from typing import Any

from heronry_manager.events import to_line


def print_event(event: Mapping[str, Any]) -> None:
    """Print one event."""
    sys.stdout.write(to_line(event) + "\n")
    sys.stdout.flush()
