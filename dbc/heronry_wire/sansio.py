"""The vocabulary that every core shares with whatever drives it: frames in, frames out, time.

A core has `step(now_ns, event) -> list[action]`, `next_deadline_ns() -> int | None` and `validate()`. It is called
with `Tick` when its deadline has come, with `now_ns` never less than before. A driver hands over all frames that have
arrived before it lets a deadline pass: a stalled process must not take its own pause for everybody's silence.
"""

from dataclasses import dataclass
from typing import NamedTuple

from heronry_wire.frame import Frame

NEVER_NS = 1 << 61  # a deadline that does not come: 73 years; still a number that fits a word


class Received(NamedTuple):
    """A frame arrived on a port (the position of the bus among those this node sits on).

    `age_ns` is how long ago: after a pause of the process what is handed over now may be old, and no proof of anything.
    """

    port: int
    frame: Frame
    age_ns: int = 0


@dataclass(frozen=True, slots=True)
class Tick:
    """The core's deadline has come."""


class Send(NamedTuple):
    """Queue a frame for a port; the node's own queue is ordered by priority (protocol rule 13).

    `until_ns`, on the core's clock, is until when it may start; None where the driver's own patience will do.
    """

    port: int
    frame: Frame
    until_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Withdraw:
    """Take back the frames that still wait in this node's queues under these identifiers: they must not be sent now.

    Another node may be about to send under them, and what this one says next (that it has stopped) is more urgent than
    data, so it would overtake them. A frame already handed to the controller is ahead of everything said later.
    """

    identifiers: frozenset[int]


@dataclass(frozen=True, slots=True)
class StandBack:
    """Hand nothing to the controller of a port until then, on the core's clock, but what is more urgent than data.

    A reconfiguration is on its way. A datum in the mailbox cannot be taken back: what this node has to answer would
    wait behind it, and it behind the data of all others.
    """

    port: int
    until_ns: int


class InvariantError(AssertionError):
    """A core found itself in a state that must not be; the message tells what and the recent events."""


def require(condition: bool, story: str, *facts: object) -> None:
    """Check an invariant, with `python -O` too; raises InvariantError with the story.

    The facts take the places of `{}` in the story; nothing is written out while all is well, since cores are checked
    after every step.
    """
    if not condition:
        raise InvariantError(story.format(*facts))
