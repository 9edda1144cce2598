"""Devices that record the calls to them, and their driver."""

# ruff: noqa: ARG002 - they take what the interface gives

from collections.abc import Iterable
from dataclasses import dataclass, field

from heronry_agent.device import Reading
from heronry_agent.module import Value


@dataclass
class RecordedDevice:
    """A device with a reading to be set, which raises `error` where there is one."""

    reading: Reading = field(default=Reading(1.0, 0, valid=True))
    error: Exception | None = None
    commands: list[Value] = field(default_factory=list)
    made_safe: int = 0

    def read(self, now_ns: int) -> Reading:
        self._may_raise()
        return self.reading

    def command(self, value: Value, now_ns: int) -> Value | None:
        self._may_raise()
        self.commands.append(value)
        return value

    def make_safe(self, now_ns: int) -> None:
        self.made_safe += 1
        self._may_raise()

    def _may_raise(self) -> None:
        if self.error is not None:
            raise self.error


class RecordedDriver:
    """A device driver: makes a device whenever one is opened."""

    def __init__(self, **devices: RecordedDevice) -> None:
        self.devices = devices
        self.opened: list[str] = []
        self.asked_to_follow: list[str] = []
        self.echoes: list[tuple[str, Value]] = []

    def open(self, name: str) -> RecordedDevice:
        self.opened.append(name)
        return self.devices.setdefault(name, RecordedDevice())

    def follows(self, sensors: Iterable[str]) -> frozenset[str]:
        self.asked_to_follow = list(sensors)
        return frozenset(f"fin of {sensor}" for sensor in self.asked_to_follow)

    def heard(self, device: str, value: Value, now_ns: int) -> None:
        self.echoes.append((device, value))
