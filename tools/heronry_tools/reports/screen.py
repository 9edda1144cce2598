"""The story on a screen: in colour on a terminal (with rich), in plain lines anywhere else."""

import sys
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import Any

from heronry_dg.model import Spec
from heronry_tools.reports.story import Line, Story, Tone

_STYLES: Mapping[Tone, str] = {
    "plain": "",
    "good": "green",
    "bad": "red",
    "fault": "bold yellow",
    "quiet": "dim",
    "title": "bold reverse",
}


def screen(spec: Spec) -> Callable[[Mapping[str, Any]], None]:
    """Return a function that shows an event's part of the story."""
    story, show = Story(spec), _printer()

    def tell(event: Mapping[str, Any]) -> None:
        for line in story.tell(event):
            show(line)

    return tell


def _printer() -> Callable[[Line], None]:
    if not sys.stdout.isatty() or find_spec("rich") is None:
        return lambda line: print(line.text, flush=True)
    from rich.console import Console  # noqa: PLC0415 - an extra, and only where there is a terminal
    from rich.text import Text  # noqa: PLC0415

    console = Console(highlight=False)
    return lambda line: console.print(Text(line.text, _STYLES[line.tone]), soft_wrap=True)
