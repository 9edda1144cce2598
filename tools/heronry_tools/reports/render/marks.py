"""The symbols of a graph that are dead in a situation, and those that a plan has chosen.

- A symbol is dead if it could not run even with unlimited resources (`heronry_dg.why_not.feasible`).
- A module is chosen if it runs, and an input if it is wired. A gate is chosen if it holds because of the wired inputs
  below it.
"""

from dataclasses import dataclass, field

from heronry_dg.configuration import Configuration, Running
from heronry_dg.gates import Expression, holds, leaves
from heronry_dg.model import Demux, Mode, Module, Spec
from heronry_dg.situation import Situation
from heronry_dg.why_not import Feasible, feasible


@dataclass(frozen=True, slots=True)
class Marks:
    """Tells which parts of a graph cannot work (dead), and which parts the configuration uses (chosen).

    This holds for one spec, situation and configuration. The function `marks` makes this object.
    """

    spec: Spec
    found: Feasible
    configuration: Configuration = field(default_factory=Configuration)

    def mode_dead(self, module: Module, mode: Mode) -> bool:
        """Tell whether a mode cannot run in the situation, even with unlimited resources."""
        return (module.name, mode.name) in self.found.lost

    def module_dead(self, module: Module) -> bool:
        """Tell whether no mode of a module can run."""
        return not self.found.can_run(module)

    def variable_dead(self, variable: str) -> bool:
        """Tell whether no module can give a variable in the situation, even with unlimited resources."""
        return all(self.mode_dead(module, mode) for module, mode in self.spec.producers(variable))

    def device_dead(self, device: str) -> bool:
        """Tell whether a device is down, or its PE cannot be reached."""
        return device not in self.found.left.devices

    def gate_dead(self, gate: Expression) -> bool:
        """Tell whether a gate or leaf cannot hold in the situation, even with unlimited resources."""
        return not self.found.can_hold(gate, before=len(self.found.lost) + 2)

    def demux_dead(self, demux: Demux) -> bool:
        """Tell whether a DEMUX cannot work in the situation.

        This is so if what it needs cannot be given, or no module at an end of the DEMUX can run.
        """
        ends = (self.spec.modules[end] for end in demux.ends)
        return self.gate_dead(demux.needs) or all(self.module_dead(end) for end in ends)

    def demanded(self, demux: Demux, path: str) -> bool:
        """Tell whether the running branch is wired to an input at or below `path` of the gate in front of a DEMUX."""
        order = [at for at, _ in leaves(demux.needs)]
        for branch in demux.branches:
            running = self.running(self.spec.modules[branch])
            if running is not None:
                mode = self.spec.modules[branch].modes[running.mode]
                places = [at for at, leaf in mode.leaves() if leaf.demux == demux.name]
                wired = {at for at, place in zip(order, places, strict=True) if place in running.inputs}
                return any(at == path or at.startswith(f"{path}." if path else "") for at in wired)
        return False

    def running(self, module: Module) -> Running | None:
        """Return PE, mode and wires of a module in the configuration; None if the module does not run."""
        return self.configuration.modules.get(module.name)

    def runs(self, module: Module, mode: Mode) -> bool:
        """Tell whether a module runs in a mode."""
        running = self.running(module)
        return running is not None and running.mode == mode.name

    def wired(self, module: Module, mode: Mode, path: str) -> bool:
        """Tell whether a module runs in a mode, and the leaf of this mode at `path` is wired."""
        running = self.running(module)
        return running is not None and running.mode == mode.name and path in running.inputs

    def gate_chosen(self, module: Module, mode: Mode, gate: Expression, path: str) -> bool:
        """Tell whether a module runs in a mode whose gate at `path` holds, with a leaf wired below the gate."""
        running = self.running(module)
        if running is None or running.mode != mode.name or not holds(gate, running.inputs, path):
            return False
        return any(leaf in running.inputs for leaf, _ in leaves(gate, path))

    def given(self, variable: str) -> bool:
        """Tell whether a module of the configuration runs in a mode that has the variable as an output."""
        return any(self.runs(module, mode) for module, mode in self.spec.producers(variable))


def marks(spec: Spec, now: Situation, configuration: Configuration | None = None) -> Marks:
    """Make the `Marks` of a spec in a situation and a configuration.

    configuration: every module, mode and PE in it must be one of the spec. None: no module runs.
    """
    return Marks(spec, feasible(spec, now), configuration or Configuration())
