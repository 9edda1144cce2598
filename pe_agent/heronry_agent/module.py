"""The module API: what the code of a software module sees.

A module is a class with `step(inputs) -> outputs`, called once per period of its mode. It is named by `image` in the
spec: a bare name is looked up in the installed catalogues, `package.module:Class` is imported. A module is built anew
when it is started, when it has failed, and when its mode changes, unless `mode_changed` says that it goes on with its
present state. It has no reference to a bus or another module. All its inputs come through `inputs` and `self.ctx`.

On a node a module runs in a separate process, its *partition*, with the other modules of its group. An exception that
it raises, or the end of that process, is a failure of the module: it is built anew a few times, and then given up.

Local and remote data look the same. A datum that is too old, foreign or of an unaccepted version is simply absent, so
an optional input that is not supplied and one that has just been lost are handled by the same line of code.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple, Protocol, TypeVar, overload

T = TypeVar("T")

Value = int | float | str | bytes | tuple[int, ...]


class Datum(NamedTuple):
    """One value of a variable as a consumer sees it."""

    value: Value
    version: int  # quality: 1 is the best
    age_ns: int  # since it was produced (local) or received (remote)
    valid: bool = True  # False: its producer says that it does not trust it

    def number(self) -> float:
        """Value as a float; raises TypeError where the value is not a number."""
        if isinstance(self.value, (int, float)):
            return float(self.value)
        raise TypeError(f"{self.value!r} is not a number; read it with .value")


class Inputs(Mapping[str, Datum]):
    """Fresh inputs of one step, by variable; where several leaves name a variable, its best version.

    A variable that is not supplied is absent: use `inputs.get("name")`.
    """

    def __init__(self, by_leaf: Mapping[str, tuple[str, Datum]]) -> None:
        self._by_leaf = by_leaf
        self._best: dict[str, Datum] = {}
        for variable, datum in by_leaf.values():
            held = self._best.get(variable)
            if held is None or datum.version < held.version:
                self._best[variable] = datum

    def __getitem__(self, variable: str) -> Datum:
        return self._best[variable]

    @overload
    def get(self, variable: str, /) -> Datum | None: ...
    @overload
    def get(self, variable: str, /, default: Datum | T) -> Datum | T: ...
    def get(self, variable: str, /, default: Datum | T | None = None) -> Datum | T | None:
        """Give the datum of a variable, or `default`; faster than the `get` of Mapping, which catches an exception."""
        return self._best.get(variable, default)

    def __iter__(self) -> Iterator[str]:
        return iter(self._best)

    def __len__(self) -> int:
        return len(self._best)

    def leaf(self, path: str) -> Datum | None:
        """Datum at one leaf of `needs`, by its index path ("", "0", "0.1")."""
        found = self._by_leaf.get(path)
        return found[1] if found else None

    def every(self, variable: str) -> list[Datum]:
        """All versions of a variable that are supplied, best first, for a voter."""
        return sorted((d for v, d in self._by_leaf.values() if v == variable), key=lambda d: d.version)


class Context(Protocol):
    """The interface through which a module uses its host."""

    @property
    def module(self) -> str:
        """Name of the module in the spec."""

    @property
    def mode(self) -> str:
        """Name of the mode in which the module runs."""

    @property
    def period_ns(self) -> int:
        """Time between two steps, in ns."""

    @property
    def now_ns(self) -> int:
        """Time of this step on the host's monotonic clock, in ns."""

    def read(self) -> Value | None:
        """Reading of the module's device when this step began; None when the device did not answer."""

    def write(self, value: Value) -> None:
        """Command the module's device: executed when the step has ended, if the output is still authorized then."""

    def may_drive(self) -> bool:
        """Tell whether outputs may be set now; a module that drives a device itself calls this before each command."""

    def report_failed(self, element: str, detail: int = 0) -> None:
        """Report to the manager that an element (`device:NAME`, `module:NAME`) has failed; detail is 0..65535."""

    def request_phase(self, phase: str) -> None:
        """Request a mission phase of the spec from the manager; requesting the same one again has no effect."""


class Module:
    """Base of every module; subclasses override `step`."""

    def __init__(self, ctx: Context) -> None:
        self.ctx = ctx

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compute one period; gives values of the variables that the mode gives. One left out is not published."""
        raise NotImplementedError

    def mode_changed(self) -> bool:
        """Go on in `ctx.mode`, with `ctx.period_ns`; True if the present state serves there, else it is built anew."""
        return False
