"""The vocabulary that every core shares with its driver: frames in, frames out, time.

A core has `step(now_ns, event) -> list[action]`, `next_deadline_ns() -> int | None` and `validate()`. The driver calls
it with `Tick` when its deadline has come, with `now_ns` never less than before. Before a driver reports a deadline, it
hands over all frames that have arrived: after a pause, a node must not conclude from its own pause that all other nodes
were silent.
"""

from dataclasses import dataclass
from typing import NamedTuple

from heronry_wire.frame import Frame

NEVER_NS = 1 << 61  # the deadline that never comes: 73 years, which still fit into 64 bits


class Received(NamedTuple):
    """A frame has arrived on a port, which is the position of its bus among the buses of this node.

    age_ns: time since the arrival. After a pause of the process a frame may be old, and say nothing about the present.
    """

    port: int
    frame: Frame
    age_ns: int = 0


@dataclass(frozen=True, slots=True)
class Tick:
    """The core's deadline has come."""


class Send(NamedTuple):
    """Queue a frame for a port; the node's own queue is ordered by priority (protocol rule 13).

    until_ns: time on the core's clock after which the frame is dropped instead; None: the driver's own limit applies.
    """

    port: int
    frame: Frame
    until_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Withdraw:
    """Remove the frames that still wait in this node's queues under these identifiers: they must not be sent any more.

    Another node may be about to send under the same identifiers. The state frame in which this node reports that it has
    stopped is more urgent than data, so it would overtake data frames in the queue. A frame that the controller already
    has leaves before that report.
    """

    identifiers: frozenset[int]


@dataclass(frozen=True, slots=True)
class StandBack:
    """Until `until_ns`, on the core's clock, send only frames with a higher priority than data on a port.

    A core requests this during a reconfiguration. A data frame in the controller's mailbox cannot be withdrawn. It
    waits for the data of all other nodes, and the answer of this node to the manager would wait behind it.
    """

    port: int
    until_ns: int


class InvariantError(AssertionError):
    """A core is in a state that must not occur; the message gives the contradiction and the recent events."""


def require(condition: bool, story: str, *facts: object) -> None:
    """Check an invariant, also under `python -O`; raises InvariantError with the text `story`.

    The further arguments replace each `{}` in the story. The text is formatted only on failure, because this function
    runs after every step.
    """
    if not condition:
        raise InvariantError(story.format(*facts))
