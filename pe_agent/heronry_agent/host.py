"""The module host: it holds the code of the modules and runs it when the core says so.

The core asks, the host does, and the answer goes back as an event: StartModule builds the image's class anew,
StepModule calls its `step` and collects what it gave, wrote and reported, StopModule drops it. What a module raises
becomes one line in a StepFailed or StartFailed and never reaches the loop around. The driver and the simulator use this
same host; it has no clock, time comes with each call.

Modules run in this process, one step at a time: one that never returns stops the agent, which then falls silent, and
the PE is declared down. Devices are the bench's.

All images of the table are loaded when the host is made, so that no import delays a reconfiguration in flight; the ones
that cannot be are in `missing_images`, with the reason.
"""

from collections.abc import Mapping

from heronry_agent.bench import Bench
from heronry_agent.images import find_image
from heronry_agent.module import Inputs, Module, Value
from heronry_agent.schedule import NS_MHZ
from heronry_agent.vocabulary import (
    Action,
    Heard,
    StartFailed,
    StartModule,
    StepFailed,
    StepModule,
    Stepped,
    StopModule,
)
from heronry_wire.pe_table import ModuleEntry, PeTable

Answer = Stepped | StepFailed | StartFailed


class _Context:
    """What a module may ask of its host (`module.Context`)."""

    def __init__(self, bench: Bench, entry: ModuleEntry, mode: int, now_ns: int) -> None:
        self._bench = bench
        self._device = entry.device
        self.module = entry.name
        self.mode = entry.modes[mode].name
        self.period_ns = NS_MHZ // entry.modes[mode].rate_mhz
        self.now_ns = now_ns
        self.writes: list[tuple[str, Value]] = []
        self.reports: list[tuple[str, int]] = []
        self.phases: list[str] = []

    def begin(self, now_ns: int) -> None:
        """Begin a step."""
        self.now_ns = now_ns
        self.writes, self.reports, self.phases = [], [], []

    def read(self) -> Value | None:
        """Read the device; None when it does not answer."""
        return self._bench.read(self._bolted_to(), self.now_ns)

    def write(self, value: Value) -> None:
        """Drive the device; one that did not move is not echoed."""
        device = self._bolted_to()
        moved_to = self._bench.write(device, value, self.now_ns)
        if moved_to is not None:
            self.writes.append((device, moved_to))

    def report_failed(self, element: str, detail: int = 0) -> None:
        """Tell the manager that an element has failed."""
        self.reports.append((element, int(detail)))

    def request_phase(self, phase: str) -> None:
        """Ask the manager for a mission phase."""
        self.phases.append(phase)

    def _bolted_to(self) -> str:
        if self._device is None:
            raise RuntimeError(f"module {self.module} is bolted to no device: give it one in the spec")
        return self._device


class ModuleHost:
    """The modules of one PE that exist now."""

    def __init__(self, table: PeTable, bench: Bench) -> None:
        """Load the images of a table."""
        self._bench = bench
        self._classes: dict[str, type[Module]] = {}
        self._modules: dict[int, tuple[Module, _Context]] = {}
        self.missing_images: dict[str, str] = {}
        for image in sorted({entry.image for entry in table.modules}):
            try:
                self._classes[image] = find_image(image)
            except Exception as error:  # noqa: BLE001 - foreign code is imported here: whatever it raises, it is missing
                self.missing_images[image] = one_line(error)

    def carry_out(self, action: Action, now_ns: int) -> Answer | None:
        """Do what an action asks of the modules or their world; gives the answer the core waits for, if any."""
        match action:
            case StepModule():
                return self._step(action, now_ns)
            case StartModule():
                return self._start(action, now_ns)
            case StopModule():
                self._modules.pop(action.module, None)
            case Heard():
                self._bench.heard(action.device, action.value, now_ns)
            case _:
                pass
        return None

    def _start(self, action: StartModule, now_ns: int) -> StartFailed | None:
        self._modules.pop(action.module, None)
        context = _Context(self._bench, action.entry, action.mode, now_ns)
        image = self._classes.get(action.entry.image)
        if image is None:
            return StartFailed(action.module, self.missing_images.get(action.entry.image, "its image is not loaded"))
        try:
            self._modules[action.module] = (image(context), context)
        except Exception as error:  # noqa: BLE001 - a module's constructor may raise anything
            return StartFailed(action.module, one_line(error))
        return None

    def _step(self, action: StepModule, now_ns: int) -> Stepped | StepFailed:
        held = self._modules.get(action.module)
        if held is None:
            return StepFailed(action.module, action.release, "it was never built")
        module, context = held
        context.begin(now_ns)
        try:
            outputs: object = module.step(Inputs(action.inputs))
        except Exception as error:  # noqa: BLE001 - a module's step may raise anything
            return StepFailed(action.module, action.release, one_line(error))
        if not isinstance(outputs, (dict, Mapping)):  # a dict, mostly, which is told at once
            return StepFailed(action.module, action.release, f"its step gave {type(outputs).__name__}, not a mapping")
        writes, reports, phases = tuple(context.writes), tuple(context.reports), tuple(context.phases)
        return Stepped(action.module, action.release, dict(outputs), writes, reports, phases)


def one_line(error: BaseException) -> str:
    """Name and first line of an exception."""
    words = str(error).strip().splitlines()
    return f"{type(error).__name__}: {words[0]}" if words else type(error).__name__
