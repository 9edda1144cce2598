"""The API of a driver for real hardware: a class for one sensor, or for one actuator.

    class Thermometer(SensorDriver):
        OPTIONS: ClassVar = {"bus": Option("Number of the I2C bus.", int, least=0)}

        def __init__(self, setup: Setup) -> None:
            self._bus = SMBus(setup.options["bus"])

        def read(self) -> float:
            return self._bus.read_word_data(0x48, 0) / 256

A spec names the class as `driver` of a device: a shipped driver by its short name, an entry point of the group
`heronry.drivers`, or `package.module:Class`. The agent starts a process for each such device, makes one object of the
class there, and calls its methods there. So a driver may block, raise, or crash: other devices and the heartbeats of
the PE are not touched. A process that ends or hangs is started again (`shell/device_processes`).

A driver keeps to the values of its device. What is the same for all is done outside of it: how old a reading may be
(`stale_ms`), the `range` of a sensor, the `limits`, `rate_limit` and `safe` action of an actuator, and the end of
validity of a command.

The module of a driver must be importable without the hardware and without the libraries of the driver, so that
`heronry check` can read OPTIONS anywhere: import such a library in `__init__`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Final, NamedTuple

from heronry_agent.module import Value
from heronry_wire.errors import HeronryError
from heronry_wire.spelling import meant


class _Required:
    """Stands for the default of an option that has none."""


REQUIRED: Final = _Required()


class OptionError(HeronryError, ValueError):
    """The options of a device do not fit its driver; the message is one sentence."""


class NotConnectedError(HeronryError):
    """The hardware does not answer as the driver expects; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class Option:
    """One option of a driver: what it means, its type, and which values it may have."""

    meaning: str
    kind: type[Any]  # int, float, str, bool or list (of numbers)
    default: Any = REQUIRED
    least: float | None = None  # of a number
    most: float | None = None  # of a number
    choices: tuple[str | int, ...] = ()

    def checked(self, name: str, given: Any) -> Any:
        """Return a value that fits; raises OptionError. A whole number fits where a float is wanted."""
        value = _converted(self.kind, given)
        if type(value) is not self.kind:
            raise OptionError(f"option '{name}' must be {_KINDS[self.kind]}, not {given!r:.60}")
        if self.choices and value not in self.choices:
            raise OptionError(f"option '{name}' must be one of {', '.join(map(str, self.choices))}, not {given!r:.60}")
        if self.least is not None and value < self.least:
            raise OptionError(f"option '{name}' must be at least {self.least:g}, not {given!r:.60}")
        if self.most is not None and value > self.most:
            raise OptionError(f"option '{name}' must be at most {self.most:g}, not {given!r:.60}")
        return value


def _converted(kind: type, given: Any) -> Any:
    return float(given) if kind is float and type(given) is int else given


_KINDS: Mapping[type, str] = {
    int: "a whole number",
    float: "a number",
    str: "text",
    bool: "true or false",
    list: "a list",
}


def checked_options(declared: Mapping[str, Option], given: Mapping[str, object]) -> dict[str, Any]:
    """Return the value of every declared option, with the defaults of those that are not given; raises OptionError."""
    for name in given:
        if name not in declared:
            known = meant(name, declared, f"its options are: {', '.join(declared) or 'none'}")
            raise OptionError(f"the driver has no option '{name}'; {known}")
    found = {}
    for name, option in declared.items():
        if name not in given and option.default is REQUIRED:
            raise OptionError(f"option '{name}' is missing: {option.meaning}")
        found[name] = option.checked(name, given[name]) if name in given else option.default
    return found


@dataclass(frozen=True, slots=True)
class Setup:
    """What a driver is told when it starts."""

    device: str  # name in the spec
    options: Mapping[str, Any]  # all that the driver declares, checked
    period_ns: int  # shortest period of the modules on the device
    buses: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # arguments of python-can by name of the bus
    uplink: str = ""  # the bus toward the manager


class Measured(NamedTuple):
    """A reading with the time at which it was taken."""

    value: Value
    time_ns: int  # on the monotonic clock


class SensorDriver:
    """Base class of the driver of a sensor."""

    OPTIONS: ClassVar[Mapping[str, Option]] = {}
    SETTLES_MS: ClassVar[int] = 5_000  # time from the start to the first reading at most; a receiver needs a minute
    WAITS: ClassVar[bool] = False  # `read` waits for the sensor by itself, and need not be called once per period
    LONGEST_READ_MS: ClassVar[int] = 2_000  # a read that takes longer hangs: its process is ended and started again

    def __init__(self, setup: Setup) -> None:
        """Open the sensor; whatever is raised ends the process, which is started again later."""
        self.setup = setup

    def read(self) -> Value | Measured | None:
        """Take a reading; None if there is no new one that may be used. It may wait for the sensor.

        A plain value counts as taken when `read` returns. An exception ends the process: the driver is started again.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Give the sensor back; called at an end in order."""


class ActuatorDriver:
    """Base class of the driver of an actuator."""

    OPTIONS: ClassVar[Mapping[str, Option]] = {}
    LONGEST_COMMAND_MS: ClassVar[int] = 1_000  # a command that takes longer hangs: its process is started again

    def __init__(self, setup: Setup) -> None:
        """Open the actuator without moving it; whatever is raised ends the process, which is started again later."""
        self.setup = setup

    def command(self, value: float) -> float:
        """Move the actuator; returns the value to which it really goes. An exception ends the process."""
        raise NotImplementedError

    def lasts_ms(self, value: float) -> float | None:  # noqa: ARG002 - for those that override it
        """For how long the actuator may stay at a value, in ms, however often it is commanded; None: without end.

        After this time comes the safe action. Then only a command that may last without end is executed, until one has
        been: a burn wire that has been on for its longest time is not switched on again by the same order.
        """
        return None

    release: Any = None
    """Method without arguments: take the power from the actuator. None: this actuator cannot be released."""

    def close(self) -> None:
        """Give the actuator back, after the safe action; called at an end in order."""
