"""What all events have in common: the version of the stream, the time, and the kind."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

VERSION = 1

_CAPITAL = re.compile(r"(?<!^)([A-Z])")


@dataclass(frozen=True, slots=True)
class Event:
    """One event of the stream; each kind is a class derived from this one.

    A field of an event is a key of its line. A field with a default is left out of the line while it has the default.

    t_ns: the time of the event, on the monotonic clock of the program that emits it.
    """

    KIND: ClassVar[str] = ""  # the name of the class in lower case with underscores: `pe_lost` for PeLost

    t_ns: int

    def __init_subclass__(cls) -> None:
        cls.KIND = _CAPITAL.sub(r"_\1", cls.__name__).lower()

    @property
    def kind(self) -> str:
        """Return the kind of this event, as its line names it."""
        return self.KIND


@dataclass(frozen=True, slots=True)
class UnknownEvent(Event):
    """An event of a kind that this version does not know: a later version has emitted it."""

    name: str
    data: Mapping[str, Any]  # its further fields

    @property
    def kind(self) -> str:
        """Return the kind of this event, as its line names it."""
        return self.name
