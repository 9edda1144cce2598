"""The module API: the interface between the code of a module and the agent.

A module is a class with `step(inputs) -> outputs`, called once per period of its mode. The `image` in the spec names
the class: a bare name is looked up in the installed catalogues, `package.module:Class` is imported. The agent makes a
new object of the class when a module starts, when a module is restarted after a failure, and when the mode of a module
changes (unless `mode_changed` returns True). A module has no reference to a bus or to another module: all its inputs
come through `inputs` and `self.ctx`.

On a node a module runs in a separate process, its *partition*, which may also run other modules. If the module raises
an exception, or the process ends, the module has failed: the agent restarts the module a few times, and then gives it
up.

Data from this PE and from other PEs look the same. A datum that is too old, from a wrong producer, or of an unaccepted
version is absent. So the same line of code handles an optional input that was never supplied and an input that has just
been lost.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple, Protocol, TypeVar, overload

T = TypeVar("T")

Value = int | float | str | bytes | tuple[int, ...]

DISAGREEMENT = "disagreement"  # stands in place of an element in the reports of a step


class Datum(NamedTuple):
    """One value of a variable, as the module that reads it gets it."""

    value: Value
    version: int  # quality: 1 is the best
    age_ns: int  # since it was produced (local) or received (remote)
    valid: bool = True  # False: the producer has marked the value as not usable

    def number(self) -> float:
        """Return the value as a float; raises TypeError if it is not a number."""
        if isinstance(self.value, (int, float)):
            return float(self.value)
        raise TypeError(f"{self.value!r} is not a number; read it with .value")


class AbsentError(KeyError):
    """Raised when a step reads a variable that has no fresh datum in this step."""

    def __str__(self) -> str:
        """Return a sentence that names the variable, and tells how to read a variable that may be absent."""
        variable = repr(self.args[0])
        return f"no fresh value of {variable} is supplied; ask with inputs.get({variable}), which gives None then"


class Inputs(Mapping[str, Datum]):
    """The fresh inputs of one step, by variable; if several leaves read a variable, the best version counts.

    `inputs.get("name")` is None for a variable that has no fresh datum; `inputs["name"]` then raises AbsentError.
    """

    def __init__(self, by_leaf: Mapping[str, tuple[str, Datum]]) -> None:
        self._by_leaf = by_leaf
        self._best: dict[str, Datum] = {}
        for variable, datum in by_leaf.values():
            held = self._best.get(variable)
            if held is None or datum.version < held.version:
                self._best[variable] = datum

    def __getitem__(self, variable: str) -> Datum:
        """Return the datum of a variable; raises AbsentError if the variable has no fresh datum in this step."""
        try:
            return self._best[variable]
        except KeyError:
            raise AbsentError(variable) from None

    @overload
    def get(self, variable: str, /) -> Datum | None: ...
    @overload
    def get(self, variable: str, /, default: Datum | T) -> Datum | T: ...
    def get(self, variable: str, /, default: Datum | T | None = None) -> Datum | T | None:
        """Return the datum of a variable, or `default` if the variable has none; faster than `Mapping.get`."""
        return self._best.get(variable, default)

    def __iter__(self) -> Iterator[str]:
        return iter(self._best)

    def __len__(self) -> int:
        return len(self._best)

    def leaf(self, path: str) -> Datum | None:
        """Return the datum at one leaf of the mode's `needs`; None if it is absent.

        path: position of the leaf in the gate expression: "0" for the first operand of the outermost gate, "0.1" for
            the second operand of the gate at "0"; "" if the mode needs a single variable and has no gate.
        """
        found = self._by_leaf.get(path)
        return found[1] if found else None

    def every(self, variable: str) -> list[Datum]:
        """Return the data of all leaves that read this variable, best version first, as a voter needs them."""
        return sorted((d for v, d in self._by_leaf.values() if v == variable), key=lambda d: d.version)


class Context(Protocol):
    """What a module can ask of its agent."""

    @property
    def module(self) -> str:
        """Name of the module in the spec."""

    @property
    def mode(self) -> str:
        """Name of the mode in which the module runs."""

    @property
    def device(self) -> str | None:
        """Name of the module's device in the spec; None if the module has none."""

    @property
    def period_ns(self) -> int:
        """Time between two steps, in ns."""

    @property
    def now_ns(self) -> int:
        """Time of this step on the monotonic clock of the PE, in ns."""

    def read(self) -> Value | None:
        """Return the reading of the module's device when this step began; None if there is no valid reading.

        If the device is an actuator, its reading is the last command that it has taken.
        """

    def write(self, value: Value) -> None:
        """Command the module's device to `value`.

        The agent executes the command after the step, if the module's output is still authorized at that time.
        """

    def may_drive(self) -> bool:
        """Tell whether this module's outputs are authorized now.

        A module that drives hardware directly, and not by `write`, calls this before each command.
        """

    def report_failed(self, element: str, detail: int = 0) -> None:
        """Report to the manager that an element has failed.

        element: `device:NAME` or `module:NAME`. `pe:NAME` and `bus:NAME` may be reported, too, but are only
            suspicions: the manager compares them with its own observations.
        detail: a number 0..65535 whose meaning the author of the module chooses; the event in which the manager
            tells of the report contains the number.
        """

    def report_disagreement(self, detail: int = 0) -> None:
        """Report to the manager that two inputs differ, and that neither is known to be wrong.

        The report changes no plan. Call this in every step while the inputs differ; it is sent at most once a
        second.
        detail: a number 0..65535 whose meaning the author of the module chooses; the event in which the manager
            tells of the report contains the number.
        """

    def request_phase(self, phase: str) -> None:
        """Request a mission phase of the spec from the manager.

        If the module requests the same phase again in the next step, this has no effect.
        """

    def request_priority(self, function: str, priority: int | None) -> None:
        """Request another priority of a function from the manager; None: the priority of the spec.

        The manager refuses a priority outside the function's `priority_range`, and any change while a priority set by
        the operator applies. The manager changes a priority at most once a second; of several requests the last one
        counts. Repeating the request in the next step has no effect. The priority stays when the module stops.
        """


class Module:
    """Base class of every module; a subclass overrides `step`."""

    def __init__(self, ctx: Context) -> None:
        self.ctx = ctx

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Compute one period; returns values by variable, for outputs of the mode (`gives` in the spec).

        A variable that is left out is not published.
        """
        raise NotImplementedError

    def mode_changed(self) -> bool:
        """Adapt to the new mode that `ctx.mode` and `ctx.period_ns` now name.

        Return True to go on with this object and its state, False to have a new object made.
        """
        return False

    def save(self) -> tuple[float, ...]:
        """Return the state from which another object of this class can go on, as finite numbers; (): there is none yet.

        Called after a step, as often as `checkpoint` in the spec says; override it together with `restore`. It must be
        short: it takes the time of the module's partition. If it raises an exception, or takes more than 50 ms, the
        module runs on, and its state is not kept.
        """
        raise NotImplementedError("the module has a checkpoint in the spec, but no method `save`")

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:
        """Go on from a state that `save` of the same version of this class has returned, on this PE or another.

        Called before the first step. If it raises an exception, a new object is made, which starts without a state.
        age_ns: time since the state was saved, at most `max_age_ms` of the spec; it may be less by the time of a frame.
        """
        raise NotImplementedError("the module has a checkpoint in the spec, but no method `restore`")
