"""The module host of a simulated PE: it runs the modules inside the process of the simulator.

The core gives actions, the host carries them out, and each answer goes back as an event.
`heronry_agent.shell.partition_host` takes the same actions and gives the same events, with the modules in processes
apart, which is what a node does. Here nothing protects one module from another, and computing takes no time: where a
fault lets a module hang or be slow, the simulated PE (`module_steps`) does so in place of the module.

All images of the table are loaded when the host is made; the ones that cannot be are in `missing_images`.
"""

from heronry_agent.core.vocabulary import (
    Action,
    Drive,
    EndPartition,
    Heard,
    ModuleEvent,
    StartFailed,
    StartModule,
    StepFailed,
    StepModule,
    Stepped,
    StopModule,
)
from heronry_agent.shell.devices import Devices
from heronry_agent.shell.module_runner import ModuleRunner
from heronry_agent.shell.start_orders import orders_of
from heronry_wire.pe_table import PeTable


class ModuleHost:
    """The modules of one PE that exist now."""

    def __init__(self, table: PeTable, devices: Devices) -> None:
        """Load the images of a table; `devices` are those that its modules use."""
        self._devices = devices
        self._partitions = {module.index: module.partition for module in table.modules}
        self._now_ns = 0
        self._runner = ModuleRunner(lambda: self._now_ns)
        reasons = ((image, self._runner.load(image)) for image in sorted({entry.image for entry in table.modules}))
        self.missing_images = {image: reason for image, reason in reasons if reason is not None}

    def carry_out(self, action: Action, now_ns: int) -> ModuleEvent | None:
        """Carry out an action for the modules or their devices; gives the event for the core, if there is one."""
        self._now_ns = now_ns
        match action:
            case StepModule():
                return self._step(action, now_ns)
            case StartModule():
                reason = self._runner.start(action.module, orders_of(action), now_ns)
                return None if reason is None else StartFailed(action.module, reason)
            case StopModule():
                self._runner.stop(action.module, keep=action.keep)
                if not action.keep:
                    self._devices.make_safe(action.module, now_ns)
            case EndPartition():
                for module in (m for m, partition in self._partitions.items() if partition == action.partition):
                    self._runner.stop(module)  # the core stops each of them, too, which makes its device safe
            case Drive():
                return self._devices.drive(action, now_ns)
            case Heard():
                self._devices.heard(action, now_ns)
            case _:
                pass
        return None

    def _step(self, action: StepModule, now_ns: int) -> Stepped | StepFailed:
        reading = self._devices.read(action.module, now_ns)
        result = self._runner.step(action.module, now_ns, action.until_ns, reading, action.inputs)
        if isinstance(result, str):
            return StepFailed(action.module, action.release, result)
        return Stepped(action.module, action.release, result.outputs, result.writes, result.reports, result.phases)
