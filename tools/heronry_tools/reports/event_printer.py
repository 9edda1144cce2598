"""The event stream on standard output, one line of JSON for each event, written at once.

The flight does not depend on a reader of the stream. If a line cannot be written (a full disk, a reader that has
ended), the line is dropped. A message on standard error reports that, except if the line before was dropped, too.
"""

import sys
from collections.abc import Callable
from contextlib import suppress

from heronry_manager.events import Event
from heronry_manager.events.line import to_line

Teller = Callable[[Event], None]


def print_event(event: Event) -> None:
    """Print one event."""
    sys.stdout.write(to_line(event) + "\n")
    sys.stdout.flush()


def surviving(tell: Teller) -> Teller:
    """Wrap `tell`, which writes an event: if writing raises OSError, the event is dropped.

    The first such error after a success is printed on standard error.
    """
    is_said = False

    def tell_if_possible(event: Event) -> None:
        nonlocal is_said
        try:
            tell(event)
        except OSError as error:
            if not is_said:
                with suppress(OSError):
                    print(f"heronry: events are dropped until they can be written: {error.strerror}", file=sys.stderr)
            is_said = True
        else:
            is_said = False

    return tell_if_possible
