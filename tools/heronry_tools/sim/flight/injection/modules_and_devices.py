"""What befalls modules and devices: they fail, overrun, or give what is off."""

from random import Random

from heronry_tools.sim.faults.fault import Act
from heronry_tools.sim.flight.injection.strike import End, Strike, nothing
from heronry_tools.sim.flight.simulation import Simulation

_BIAS = 40.0


def _module(simulation: Simulation, act: Act, _: Random) -> End:
    broken = simulation.fleet.broken_modules
    broken[act.name] = act.kind
    simulation.truth.excuse(act.name)

    def end() -> None:
        broken.pop(act.name, None)

    return end


def _dead(simulation: Simulation, act: Act, _: Random) -> End:
    simulation.fail_device(act.name, "dead")
    return nothing


def _bias(simulation: Simulation, act: Act, _: Random) -> End:
    simulation.fail_device(act.name, "bias", _BIAS)
    return nothing


ON_MODULES_AND_DEVICES: dict[str, Strike] = {
    "raise": _module,
    "unfit": _module,
    "wrong": _module,
    "overrun": _module,
    "dead": _dead,
    "bias": _bias,
}
