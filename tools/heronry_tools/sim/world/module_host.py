"""The module host of a simulated PE: runs the PE's modules inside the process of the simulator.

The host executes the actions of the core, and gives the core each answer as an event. On a real node
`heronry_agent.shell.partition_host` takes the same actions and gives the same events, with the modules in separate
processes. Here no module is protected from another, and a step takes no time. `module_steps` models modules that hang
or are slow because of a fault.

All images of the table are loaded when the host is created; `missing_images` are those that cannot be loaded. A module
of which the PE has other code (`other_code`) runs that code from its next start on, as on a node whose files have been
replaced.
"""

from collections.abc import Collection

from heronry_agent.core.vocabulary import (
    Action,
    Drive,
    EndPartition,
    Failure,
    Heard,
    ModuleEvent,
    SaveState,
    StartFailed,
    StartModule,
    StepFailed,
    StepModule,
    Stepped,
    StopModule,
)
from heronry_agent.module import Module
from heronry_agent.shell.devices import Devices
from heronry_agent.shell.module_runner import ModuleRunner
from heronry_agent.shell.start_orders import orders_of
from heronry_tools.sim.world.other_code import find_version, other_version
from heronry_wire.pe_table import ModuleEntry, PeTable


class ModuleHost:
    """The loaded modules of one PE."""

    def __init__(self, table: PeTable, devices: Devices, other_code: Collection[str] = ()) -> None:
        """Load the images of a table.

        devices: the devices of its modules
        other_code: images of which the PE has another version now; may change later
        """
        self._devices, self._other_code = devices, other_code
        self._partitions = {module.index: module.partition for module in table.modules}
        self._now_ns = 0
        self._runner = ModuleRunner(lambda: self._now_ns, find=find_version)
        failures = ((image, self._runner.load(image)) for image in sorted({entry.image for entry in table.modules}))
        self.missing_images = {image: failure.reason for image, failure in failures if failure is not None}

    def add(self, modules: Collection[ModuleEntry]) -> dict[str, str]:
        """Load the images of more modules; returns those that cannot be loaded, with the reasons.

        modules: with the numbers by which actions will name them.
        """
        self._partitions |= {module.index: module.partition for module in modules}
        failures = ((image, self._runner.load(image)) for image in sorted({entry.image for entry in modules}))
        return {image: failure.reason for image, failure in failures if failure is not None}

    def carry_out(self, action: Action, now_ns: int) -> ModuleEvent | None:
        """Execute an action on modules or their devices; return the event for the core, None if there is none."""
        self._now_ns = now_ns
        match action:
            case StepModule():
                return self._step(action, now_ns)
            case StartModule():
                orders = orders_of(action)
                if orders.image in self._other_code:
                    orders = orders._replace(image=other_version(orders.image))
                outcome = self._runner.start(action.module, orders, now_ns, action.kept)
                return StartFailed(action.module, *outcome) if isinstance(outcome, Failure) else outcome
            case SaveState():
                return self._runner.save(action.module, action.round, action.most_bytes)
            case StopModule():
                self._runner.stop(action.module, keep=action.keep)
                if not action.keep:
                    self._devices.make_safe(action.module, now_ns)
            case EndPartition():
                for module in (m for m, partition in self._partitions.items() if partition == action.partition):
                    self._runner.stop(module)  # the core also stops each module, which makes its device safe
            case Drive():
                return self._devices.drive(action, now_ns)
            case Heard():
                self._devices.heard(action, now_ns)
            case _:
                pass
        return None

    def code(self, module: int) -> Module | None:
        """Return the object of a module, for an observer that does not change it; None if the module does not run."""
        return self._runner.code(module)

    def _step(self, action: StepModule, now_ns: int) -> Stepped | StepFailed:
        reading = self._devices.read(action.module, now_ns)
        result = self._runner.step(action.module, now_ns, action.until_ns, reading, action.inputs)
        if isinstance(result, Failure):
            return StepFailed(action.module, action.release, *result)
        reports = result.reports + self._devices.reports(action.module, now_ns)
        said = result.outputs, result.writes, reports, result.phases
        return Stepped(
            action.module, action.release, *said, priorities=result.priorities, misspelt_inputs=result.misspelt
        )
