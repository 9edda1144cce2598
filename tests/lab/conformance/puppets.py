"""The modules of a PE under test: each does in its step what the drill has told it, and gives what it has read."""

from collections.abc import Callable, Mapping

from heronry_agent.module import Context, Inputs, Module, Value

Strings = Callable[[Context, Inputs], Mapping[str, Value]]

PULLED: dict[str, Strings] = {}
"""What each module does now, by name; a drill empties it first."""
CHANGES_MODE: set[str] = set()
"""Modules that go on when their mode changes."""
BUILT: list[str] = []
"""Modules in the order in which they were built."""


def let_go() -> None:
    """Let every module do nothing."""
    PULLED.clear()
    CHANGES_MODE.clear()
    BUILT.clear()


class Puppet(Module):
    """Does as it is told."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        BUILT.append(ctx.module)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Do what was told; nothing, where nothing was."""
        pulled = PULLED.get(self.ctx.module)
        return {} if pulled is None else pulled(self.ctx, inputs)

    def mode_changed(self) -> bool:
        """Go on, or be built anew."""
        return self.ctx.module in CHANGES_MODE


def pull_all(height: float = 50.0) -> None:
    """Let each module of the PE under test do what it is for."""
    PULLED["gauge"] = lambda _ctx, _inputs: {"height": height}
    PULLED["thinker"] = _think
    PULLED["servo"] = _drive
    PULLED["helper"] = lambda _ctx, _inputs: {"help": 1, "call": 0}


def _think(ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
    if ctx.mode == "coarse":
        return {"demand": 0.5}
    height = inputs.get("height")
    return {} if height is None else {"demand": 2 * height.number()}


def _drive(ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
    demand = inputs.get("demand")
    if demand is not None:
        ctx.write(demand.number())
    return {}


def asking(*phases: str) -> Strings:
    """Ask for phases, in every step."""

    def step(ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        for phase in phases:
            ctx.request_phase(phase)
        return {}

    return step


def reporting(*elements: str, detail: int = 0) -> Strings:
    """Report that elements have failed, in every step."""

    def step(ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        for element in elements:
            ctx.report_failed(element, detail)
        return {}

    return step


def writing(value: Value) -> Strings:
    """Tell the device something, in every step."""

    def step(ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
        ctx.write(value)
        return {}

    return step


def giving(**outputs: Value) -> Strings:
    """Give the same values in every step."""
    return lambda _ctx, _inputs: outputs


def raising(_ctx: Context, _inputs: Inputs) -> Mapping[str, Value]:
    """Raise."""
    raise ZeroDivisionError("told to")


def once(strings: Strings) -> Strings:
    """Do something in the next step alone."""

    def step(ctx: Context, inputs: Inputs) -> Mapping[str, Value]:
        PULLED.pop(ctx.module)
        return strings(ctx, inputs)

    return step
