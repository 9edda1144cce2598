"""How a fault is injected: a function does something to a simulation, and returns what ends it.

The function returns None where it injected nothing (a PE that is dead cannot be paused). What was ended once is not
ended again; what a fault had done to a PE that has died since died with it.
"""

from collections.abc import Callable
from random import Random

from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.node import Node

End = Callable[[], None]
Inject = Callable[[Simulation, Fault, Random], End | None]

_PLUGS = ((True, False), (False, True), (True, True), (False, False))  # transmit failed, receive failed
_PLUG_HOLDS_MS = (6, 40, 200)  # the longest time in one of these states, drawn


def nothing() -> None:
    """Do nothing: the end of a fault that needs no end."""


def in_turns(simulation: Simulation, turn: Callable[[], int | None]) -> End:
    """Call `turn` now, and again until the fault is ended; `turn` gives the ns to the next call, None: no more."""
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
    """Let a plug be loose: each direction breaks and mends in turn, within a heartbeat period or some periods later."""

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
