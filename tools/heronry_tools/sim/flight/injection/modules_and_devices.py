"""Faults of modules and devices: they fail, overrun, or give a wrong value."""

from random import Random

from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.injection.inject import End, Inject, nothing
from heronry_tools.sim.flight.simulation import Simulation

_BIAS = 40.0


def _module(simulation: Simulation, fault: Fault, _: Random) -> End:
    broken = simulation.fleet.broken_modules
    broken[fault.name] = fault.kind
    simulation.truth.excuse(fault.name.partition("@")[0])

    def end() -> None:
        broken.pop(fault.name, None)

    return end


def _missing(simulation: Simulation, fault: Fault, _: Random) -> End:
    module, _at, pe = fault.name.partition("@")
    simulation.fleet.lacks(pe, module)
    return nothing


def _dead(simulation: Simulation, fault: Fault, _: Random) -> End:
    simulation.fail_device(fault.name, "dead")
    return nothing


def _bias(simulation: Simulation, fault: Fault, _: Random) -> End:
    simulation.fail_device(fault.name, "bias", _BIAS)
    return nothing


ON_MODULES_AND_DEVICES: dict[str, Inject] = {
    "raise": _module,
    "unfit": _module,
    "wrong": _module,
    "overrun": _module,
    "missing": _missing,
    "dead": _dead,
    "bias": _bias,
}
