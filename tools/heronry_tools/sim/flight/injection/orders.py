"""What the operator orders, rightly or not."""

from random import Random

from heronry_manager.core.vocabulary import EnterPhase, FailElement
from heronry_tools.sim.faults.fault import Act
from heronry_tools.sim.flight.injection.strike import End, Strike, nothing
from heronry_tools.sim.flight.simulation import Simulation


def _fail(simulation: Simulation, act: Act, _: Random) -> End | None:
    operator = simulation.operator
    if act.target in operator.failed:
        return None
    reply = operator.say(FailElement(act.target))
    return (lambda: operator.clear(act.target)) if reply is not None and reply.done else None


def _clear(simulation: Simulation, _act: Act, _: Random) -> End | None:
    latched = simulation.operator.latched()
    for element in latched:
        simulation.operator.clear(element)
    return nothing if latched else None


def _phase(simulation: Simulation, act: Act, _: Random) -> End | None:
    reply = simulation.operator.say(EnterPhase(act.name))
    return nothing if reply is not None and reply.done else None


BY_OPERATOR: dict[str, Strike] = {
    "order_fail": _fail,
    "order_clear": _clear,
    "order_phase": _phase,
}
