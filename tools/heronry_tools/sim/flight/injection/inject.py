"""The form of an injection: a function that injects a fault into a simulation, and returns the function that ends it.

An injection that did nothing returns None (for example a pause of a dead PE). The function that ends the fault is
called at most once. Most faults of a node, for example a broken receiver, end when the node dies; then this function
has no effect. Three kinds of faults last beyond the death of the node: the death itself, a wrong table, and faults of
the node's modules.
"""

from collections.abc import Callable
from random import Random

from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.node import Node

End = Callable[[], None]
Inject = Callable[[Simulation, Fault, Random], End | None]

_PLUGS = ((True, False), (False, True), (True, True), (False, False))  # transmit failed, receive failed
_PLUG_HOLDS_MS = (6, 40, 200)  # upper limits of the time in such a state; one limit is drawn each time


def nothing() -> None:
    """Do nothing: the function that ends a fault which takes no time or ends by itself."""


def in_turns(simulation: Simulation, turn: Callable[[], int | None]) -> End:
    """Call `turn` immediately, and then again and again; returns the function that ends this.

    turn: returns the time in ns to its next call; None: there is to be no further call.
    """
    over = False

    def do() -> None:
        wait_ns = None if over else turn()
        if wait_ns is not None:
            simulation.at(simulation.now_ns + wait_ns, do)

    def end() -> None:
        nonlocal over
        over = True

    do()
    return end


def loosen(simulation: Simulation, node: Node, random: Random) -> End:
    """Let the transmitter and receiver of a node fail and recover repeatedly, at random intervals of 1 to 200 ms."""

    def turn() -> int | None:
        if not node.running:
            return None
        transmit_failed, receive_failed = random.choice(_PLUGS)
        node.wire(transmit_failed=transmit_failed, receive_failed=receive_failed)
        return random.randint(1, random.choice(_PLUG_HOLDS_MS)) * MS

    over = in_turns(simulation, turn)

    def end() -> None:
        over()
        if node.running:
            node.wire(transmit_failed=False, receive_failed=False)

    return end
