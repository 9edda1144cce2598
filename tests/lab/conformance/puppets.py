"""The modules of a PE under test: in its step each module does what the conformance test has set."""

from collections.abc import Callable, Mapping

from heronry_agent.module import Context, Inputs, Module, Value

Behaviour = Callable[[Context, Inputs], Mapping[str, Value]]

BEHAVIOUR: dict[str, Behaviour] = {}
"""What each module does in a step, by name; every test empties it first."""
CHANGES_MODE: set[str] = set()
"""Modules that go on when their mode changes."""
BUILT: list[str] = []
"""Modules in the order in which they were built."""


def reset() -> None:
    """Forget all behaviour: every module does nothing."""
    BEHAVIOUR.clear()
    CHANGES_MODE.clear()
    BUILT.clear()


class Puppet(Module):
    """A module whose steps the conformance test sets."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        BUILT.append(ctx.module)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Do what the test has set; nothing where it has set nothing."""
        behaviour = BEHAVIOUR.get(self.ctx.module)
        return {} if behaviour is None else behaviour(self.ctx, inputs)

    def mode_changed(self) -> bool:
        """Go on if the test has set so, else be built anew."""
        return self.ctx.module in CHANGES_MODE


def behave_normally(height: float = 50.0) -> None:
    """Let each module of the PE under test do what `pe_under_test` says."""
    BEHAVIOUR["gauge"] = lambda _ctx, _inputs: {"height": height}
    BEHAVIOUR["control"] = _control
    BEHAVIOUR["servo"] = _drive
    BEHAVIOUR["helper"] = lambda _ctx, _inputs: {"help": 1, "call": 0}


def _control(ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
    if ctx.mode == "coarse":
        return {"demand": 0.5}
    height = inputs.get("height")
    return {} if height is None else {"demand": 2 * height.number()}


def _drive(ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
    demand = inputs.get("demand")
    if demand is not None:
        ctx.write(demand.number())
    return {}


def asking(*phases: str) -> Behaviour:
    """Request phases, in every step."""

    def step(ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        for phase in phases:
            ctx.request_phase(phase)
        return {}

    return step


def reporting(*elements: str, detail: int = 0) -> Behaviour:
    """Report that elements have failed, in every step."""

    def step(ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        for element in elements:
            ctx.report_failed(element, detail)
        return {}

    return step


def writing(value: Value) -> Behaviour:
    """Command the device to a value, in every step."""

    def step(ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        ctx.write(value)
        return {}

    return step


def giving(**outputs: Value) -> Behaviour:
    """Return the same values in every step."""
    return lambda _ctx, _inputs: outputs


def raising(_ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
    """Raise an exception."""
    raise ZeroDivisionError("told to")


def once(behaviour: Behaviour) -> Behaviour:
    """Behave in this way in the next step alone."""

    def step(ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
        BEHAVIOUR.pop(ctx.module)
        return behaviour(ctx, inputs)

    return step
