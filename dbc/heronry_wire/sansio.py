"""The vocabulary that every core shares with its driver: frames in, frames out, time.

A core has `step(now_ns, event) -> list[action]`, `next_deadline_ns() -> int | None` and `validate()`. When the deadline
of a core has come, its driver calls `step` with `Tick`. `now_ns` never decreases from one call to the next. Before a
driver gives `Tick` to the core, it hands over all frames that have arrived, because after a pause a node must not
conclude from its own pause that all other nodes were silent.
"""

from dataclasses import dataclass
from typing import NamedTuple

from heronry_wire.frame import Frame

NEVER_NS = 1 << 61  # the deadline that never comes: 73 years, which still fit into 64 bits


class Received(NamedTuple):
    """Event: a frame has arrived on a port.

    port: position of the bus among the buses of this node. age_ns: time since the arrival; after a pause of the process
    a frame may be old, so that it no longer shows the state of its sender.
    """

    port: int
    frame: Frame
    age_ns: int = 0


@dataclass(frozen=True, slots=True)
class Tick:
    """Event: the time that the core gave as its deadline has come."""


class Send(NamedTuple):
    """Action: queue a frame to be sent on a port; the queue is ordered by priority (protocol rule 13).

    until_ns: time on the core's clock after which the frame is dropped instead; None: the driver's own limit applies.
    """

    port: int
    frame: Frame
    until_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Withdraw:
    """Action: remove the frames with these identifiers from this node's queues, because they must not be sent any more.

    A state frame of this node may report that the node has stopped sending such frames. From then on another node may
    send under the same identifiers. The state frame is more urgent than data. So without this action it would overtake
    data frames in the queue, and the node would still send these data frames after the report. A frame that the
    controller already has leaves before the report.
    """

    identifiers: frozenset[int]


@dataclass(frozen=True, slots=True)
class StandBack:
    """Action: on one port, send only frames with a higher priority than data, until `until_ns` on the core's clock.

    A core requests this during a reconfiguration, so that its answers to the manager are sent at once. A data frame in
    the controller's mailbox cannot be withdrawn. It waits until the more urgent data of all other nodes are sent, and
    an answer would have to wait behind it.
    """

    port: int
    until_ns: int


class InvariantError(AssertionError):
    """A core is in a state that must not occur.

    The message describes the contradiction, and gives the recent events.
    """


def require(condition: bool, story: str, *facts: object) -> None:
    """Raise InvariantError with the text `story` if `condition` is false, also under `python -O`.

    Each `{}` in the text is replaced by one of `facts`, in order. The text is formatted only on failure, because this
    function runs after every step.
    """
    if not condition:
        raise InvariantError(story.format(*facts))
