"""The events of a flight as sentences on a screen: in colour on a terminal (with rich), in plain lines anywhere else.

The first line of each event begins with the time of day (`clock_of_day`), as the lines of all programs do. The times
within the sentences (`story`) count from the first configuration.
"""

import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec

from heronry_dg.model import Spec
from heronry_manager.events import Event
from heronry_tools.reports.plain_lines import Line, Tone
from heronry_tools.reports.story import Story
from heronry_wire.clock_of_day import time_of_day

_STYLES: Mapping[Tone, str] = {
    "plain": "",
    "good": "green",
    "bad": "red",
    "fault": "bold yellow",
    "quiet": "dim",
    "title": "bold reverse",
}


def screen(spec: Spec) -> Callable[[Event], None]:
    """Return a function that prints the lines of an event."""
    story, show = Story(spec), _printer()

    def tell(event: Event) -> None:
        begin = f"{time_of_day(event.t_ns)} "
        for line in story.tell(event):
            show(Line(begin + line.text, line.tone))
            begin = " " * len(begin)

    return tell


def _printer() -> Callable[[Line], None]:
    if not sys.stdout.isatty() or find_spec("rich") is None:
        return lambda line: print(line.text, flush=True)
    from rich.console import Console  # noqa: PLC0415 - an extra, and only where there is a terminal
    from rich.text import Text  # noqa: PLC0415 - as above

    console = Console(highlight=False)
    return lambda line: console.print(Text(line.text, _STYLES[line.tone]), soft_wrap=True)
