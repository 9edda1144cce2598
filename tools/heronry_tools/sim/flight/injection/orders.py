"""Orders of the operator as faults: elements declared failed or cleared, and a phase requested."""

from random import Random

from heronry_manager.core.vocabulary import EnterPhase, FailElement
from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.injection.inject import End, Inject, in_turns, nothing
from heronry_tools.sim.flight.simulation import MS, Simulation


def _fail(simulation: Simulation, fault: Fault, _: Random) -> End | None:
    operator = simulation.operator
    if fault.target in operator.failed:
        return None
    reply = operator.say(FailElement(fault.target))
    return (lambda: operator.clear(fault.target)) if reply is not None and reply.done else None


def _storm(simulation: Simulation, fault: Fault, _: Random) -> End | None:
    operator = simulation.operator
    if fault.target in operator.failed:
        return None

    def turn() -> int:
        if fault.target in operator.failed:
            operator.clear(fault.target)
        else:
            operator.say(FailElement(fault.target))
        return fault.level * MS

    over = in_turns(simulation, turn)

    def end() -> None:
        over()
        operator.clear(fault.target)

    return end


def _clear(simulation: Simulation, _fault: Fault, _: Random) -> End | None:
    latched = simulation.operator.latched()
    for element in latched:
        simulation.operator.clear(element)
    return nothing if latched else None


def _phase(simulation: Simulation, fault: Fault, _: Random) -> End | None:
    reply = simulation.operator.say(EnterPhase(fault.name))
    return nothing if reply is not None and reply.done else None


BY_OPERATOR: dict[str, Inject] = {
    "order_fail": _fail,
    "order_storm": _storm,
    "order_clear": _clear,
    "order_phase": _phase,
}
