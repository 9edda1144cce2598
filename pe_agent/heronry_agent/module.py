"""The module API: the interface between the code of a module and the agent.

A module is a class with `step(inputs) -> outputs`, called once per period of its mode. The `image` in the spec names
the class: a bare name is looked up in the installed catalogues, `package.module:Class` is imported. The agent makes a
new object when a module starts, when it has failed, and when its mode changes, unless `mode_changed` returns True. A
module has no reference to a bus or to another module: all its inputs come through `inputs` and `self.ctx`.

On a node a module runs in a separate process, its *partition*, which it may share with other modules. If the module
raises an exception, or the process ends, the module has failed: it is restarted a few times, and then given up.

Local and remote data look the same. A datum that is too old, from a wrong producer, or of an unaccepted version is
absent. So one line of code handles an optional input that was never supplied and one that has just been lost.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple, Protocol, TypeVar, overload

T = TypeVar("T")

Value = int | float | str | bytes | tuple[int, ...]

DISAGREEMENT = "disagreement"  # in the reports of a step, in place of an element


class Datum(NamedTuple):
    """One value of a variable as a consumer sees it."""

    value: Value
    version: int  # quality: 1 is the best
    age_ns: int  # since it was produced (local) or received (remote)
    valid: bool = True  # False: the producer has marked the value as not usable

    def number(self) -> float:
        """Value as a float; raises TypeError where the value is not a number."""
        if isinstance(self.value, (int, float)):
            return float(self.value)
        raise TypeError(f"{self.value!r} is not a number; read it with .value")


class Inputs(Mapping[str, Datum]):
    """Fresh inputs of one step, by variable; if several leaves read a variable, its best version counts.

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
        """Give the datum of a variable, or `default`; faster than `Mapping.get`, which catches an exception."""
        return self._best.get(variable, default)

    def __iter__(self) -> Iterator[str]:
        return iter(self._best)

    def __len__(self) -> int:
        return len(self._best)

    def leaf(self, path: str) -> Datum | None:
        """Give the datum at one leaf of `needs`, by the leaf's index path ("", "0", "0.1"); None if it is absent."""
        found = self._by_leaf.get(path)
        return found[1] if found else None

    def every(self, variable: str) -> list[Datum]:
        """Give all data of a variable that are supplied, best version first, as a voter needs them."""
        return sorted((d for v, d in self._by_leaf.values() if v == variable), key=lambda d: d.version)


class Context(Protocol):
    """The interface through which a module uses the agent."""

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
        """Reading of the module's device at the begin of this step; None if the device did not answer."""

    def write(self, value: Value) -> None:
        """Command the module's device.

        The command is executed after the step, if the output is still authorized then.
        """

    def may_drive(self) -> bool:
        """Tell whether outputs are authorized now.

        A module that drives hardware itself calls this before each command.
        """

    def report_failed(self, element: str, detail: int = 0) -> None:
        """Report to the manager that an element (`device:NAME`, `module:NAME`) has failed; detail is 0..65535.

        A report of `pe:NAME` or `bus:NAME` is a suspicion: the manager compares it with its own evidence.
        """

    def report_disagreement(self, detail: int = 0) -> None:
        """Report to the manager that two inputs differ, and that neither is known to be wrong; detail is 0..65535.

        No plan changes. Call this for as long as the inputs differ; the report is sent once a second at most.
        """

    def request_phase(self, phase: str) -> None:
        """Request a mission phase of the spec from the manager; the same request in the next step has no effect."""

    def request_priority(self, function: str, priority: int | None) -> None:
        """Request another priority of a function from the manager; None: that of the spec.

        The manager refuses a priority outside the function's `priority_range`, and a change while the operator's
        priority stands. It makes at most one change a second; if several requests wait, the last one counts. The same
        request in the next step has no effect. The priority stays when the module stops.
        """


class Module:
    """Base of every module; subclasses override `step`."""

    def __init__(self, ctx: Context) -> None:
        self.ctx = ctx

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compute one period; gives values by variable, for variables of the mode's `gives`.

        A variable that is left out is not published.
        """
        raise NotImplementedError

    def mode_changed(self) -> bool:
        """Take over a new `ctx.mode` and `ctx.period_ns`, which the agent has just set.

        Returns True to go on with the present state, False to have the module built anew.
        """
        return False
