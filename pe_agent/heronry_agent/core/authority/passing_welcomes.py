"""How a gateway with a key forwards each WELCOME for another node, and the TAG that follows the WELCOME.

With the command WELCOME a manager answers the nonce of a PE; a TAG proves the command before it
(`authenticity`). A gateway verifies only commands for itself, so it forwards these two frames unverified. A TAG
names the kind of its command, but not the node. So if a TAG names the kind WELCOME, and proves no command for
this gateway, the gateway takes this TAG for that of the oldest forwarded WELCOME that still lacks one. The
gateway waits for the TAG of a forwarded WELCOME for T_lease at most.
"""

from collections import deque

from heronry_agent.core.forwarding import Gateway
from heronry_agent.core.turn import Turn
from heronry_wire.frame import Frame

_MOST = 40


class PassingWelcomes:
    """Forwards WELCOMEs for other nodes and their TAGs, and remembers which of the TAGs have not come yet."""

    def __init__(self, turn: Turn, gateway: Gateway, lease_ns: int) -> None:
        self._turn, self._gateway, self._lease_ns = turn, gateway, lease_ns
        self._nodes: deque[tuple[int, int]] = deque(maxlen=_MOST)  # node, time of the WELCOME

    def hand_on(self, node: int, welcome: Frame) -> None:
        """Forward a WELCOME toward `node`, the node for which it is, and remember that its TAG must follow."""
        self._nodes.append((node, self._turn.arrived_ns))
        self._turn.do(*self._gateway.toward(node, welcome))

    def wait(self) -> bool:
        """Tell whether a TAG of a forwarded WELCOME may still come; forgets WELCOMEs that are older than T_lease."""
        while self._nodes and self._turn.arrived_ns - self._nodes[0][1] > self._lease_ns:
            self._nodes.popleft()
        return bool(self._nodes)

    def tagged(self, tag: Frame) -> None:
        """Forward a TAG toward the node of the oldest WELCOME that still lacks its TAG."""
        node, _ = self._nodes.popleft()
        self._turn.count("answer to another node", tag.can_id)
        self._turn.do(*self._gateway.toward(node, tag))
