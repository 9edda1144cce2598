"""WELCOMEs for nodes beyond a gateway with a key: it cannot judge them, and hands them on with the TAG that follows.

A TAG names no command but its kind, so the first TAG of a WELCOME's kind that proves nothing here belongs to the first
WELCOME that was handed on. A WELCOME whose TAG does not come within T_lease is forgotten.
"""

from collections import deque

from heronry_agent.core.gateway import Gateway
from heronry_agent.core.turn import Turn
from heronry_wire.frame import Frame

_MOST = 40


class PassingWelcomes:
    """WELCOMEs that have been handed on, and whose TAG has not."""

    def __init__(self, turn: Turn, gateway: Gateway, lease_ns: int) -> None:
        self._turn, self._gateway, self._lease_ns = turn, gateway, lease_ns
        self._nodes: deque[tuple[int, int]] = deque(maxlen=_MOST)  # node, when it came

    def hand_on(self, node: int, welcome: Frame) -> None:
        """Hand a WELCOME on to where its node is."""
        self._nodes.append((node, self._turn.arrived_ns))
        self._turn.out += self._gateway.toward(node, welcome)

    def wait(self) -> bool:
        """Tell whether one of them may still have its TAG to come."""
        while self._nodes and self._turn.arrived_ns - self._nodes[0][1] > self._lease_ns:
            self._nodes.popleft()
        return bool(self._nodes)

    def tagged(self, tag: Frame) -> None:
        """Hand the TAG on to where the first of them went."""
        node, _ = self._nodes.popleft()
        self._turn.count("answer to another node", tag.can_id)
        self._turn.out += self._gateway.toward(node, tag)
