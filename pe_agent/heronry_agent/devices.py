"""The devices of one PE as its modules meet them: read before a step, driven when the core allows it.

Both go through the agent's own process, whatever runs the module: so an output is checked at the last moment (rule 6),
and a module that was stopped, or hangs, moves nothing. The world behind is the bench's.
"""

from heronry_agent.bench import Bench
from heronry_agent.module import Value
from heronry_agent.vocabulary import Drive, DriveFailed, Driven, Heard
from heronry_wire.pe_table import PeTable


class Devices:
    """What the modules of a table are bolted to."""

    def __init__(self, table: PeTable, bench: Bench) -> None:
        self._bench = bench
        self._bolted_to = {module.index: module.device for module in table.modules}

    def read(self, module: int, now_ns: int) -> Value | None:
        """What a module's device says; None where it has none, or it does not answer."""
        device = self._bolted_to[module]
        return None if device is None else self._bench.read(device, now_ns)

    def drive(self, order: Drive, now_ns: int) -> Driven | DriveFailed | None:
        """Drive a module's device; None when it did not move."""
        device = self._bolted_to[order.module]
        if device is None:
            return DriveFailed(order.module, "it has no device to drive")
        try:
            moved_to = self._bench.write(device, order.value, now_ns)
        except TypeError as error:
            return DriveFailed(order.module, str(error))
        return None if moved_to is None else Driven(order.module, moved_to)

    def heard(self, echo: Heard, now_ns: int) -> None:
        """Follow what another PE has told one of its actuators."""
        self._bench.heard(echo.device, echo.value, now_ns)
