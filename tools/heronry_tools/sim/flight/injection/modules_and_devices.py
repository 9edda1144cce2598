"""Faults of modules and devices: they fail, overrun, have other code, or give a wrong value or none."""

from random import Random

from heronry_tools.sim.faults.fault import Fault
from heronry_tools.sim.flight.injection.inject import End, Inject, nothing
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.module_steps import SILENT

_BIAS = 40.0


def _module(simulation: Simulation, fault: Fault, _: Random) -> End:
    broken = simulation.fleet.broken_modules
    broken[fault.name] = fault.kind
    simulation.truth.excuse(fault.name.partition("@")[0])

    def end() -> None:
        broken.pop(fault.name, None)

    return end


def _silent(simulation: Simulation, fault: Fault, random: Random) -> End:
    end = _module(simulation, fault, random)
    simulation.fleet.broken_modules[fault.name] = f"{SILENT}{fault.level}"
    simulation.checks.silenced(simulation.now_ns, fault.name, fault.level)

    def speak() -> None:
        end()
        simulation.checks.unsilenced(fault.name)

    return speak


def _missing(simulation: Simulation, fault: Fault, _: Random) -> End:
    module, _at, pe = fault.name.partition("@")
    simulation.fleet.lacks(pe, module)
    return nothing


def _other_code(simulation: Simulation, fault: Fault, _: Random) -> End:
    module, _at, pe = fault.name.partition("@")
    simulation.fleet.change_code(pe, module)
    return lambda: simulation.fleet.put_back_code(pe, module)


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
    "silent": _silent,
    "missing": _missing,
    "other_code": _other_code,
    "dead": _dead,
    "bias": _bias,
}
