"""The vocabulary that every core shares with its driver: frames in, frames out, time.

A core has `step(now_ns, event) -> list[action]`, `next_deadline_ns() -> int | None` and `validate()`. It is called
with `Tick` when its deadline has come, with `now_ns` never less than before. A driver hands over all frames that have
arrived before it lets a deadline pass: a process that stood still must not take its own pause for the silence of all
other nodes.
"""

from dataclasses import dataclass
from typing import NamedTuple

from heronry_wire.frame import Frame

NEVER_NS = 1 << 61  # a deadline that does not come: 73 years; it still fits into 64 bits


class Received(NamedTuple):
    """A frame arrived on a port (the position of the bus among those this node sits on).

    `age_ns` is how long ago: after a pause of the process a frame may be old, and no evidence of the present.
    """

    port: int
    frame: Frame
    age_ns: int = 0


@dataclass(frozen=True, slots=True)
class Tick:
    """The core's deadline has come."""


class Send(NamedTuple):
    """Queue a frame for a port; the node's own queue is ordered by priority (protocol rule 13).

    `until_ns`, on the core's clock, is until when it may start; None: the driver's own time limit applies.
    """

    port: int
    frame: Frame
    until_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Withdraw:
    """Withdraw the frames that still wait in this node's queues under these identifiers: they must not be sent now.

    Another node may be about to send under them, and the next frame of this node (that it has stopped) is more urgent
    than data, so it would overtake them. A frame already handed to the controller is ahead of all later ones.
    """

    identifiers: frozenset[int]


@dataclass(frozen=True, slots=True)
class StandBack:
    """Until then, on the core's clock, hand the controller of a port only frames with a higher priority than data.

    A reconfiguration is on its way. A datum in the controller's mailbox cannot be withdrawn: the answer of this node
    would wait behind it, and the datum behind the data of all other nodes.
    """

    port: int
    until_ns: int


class InvariantError(AssertionError):
    """A core is in a state that must not occur; the message has the contradiction and the recent events."""


def require(condition: bool, story: str, *facts: object) -> None:
    """Check an invariant, with `python -O` too; raises InvariantError with the story.

    The facts take the places of `{}` in the story; the text is made only on failure, since cores are checked after
    every step.
    """
    if not condition:
        raise InvariantError(story.format(*facts))
