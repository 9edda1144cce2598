"""Modules that send a view, and one that shows it: they only make traffic."""

from heronry_agent.module import Inputs, Module, Value


class LooksLeft(Module):
    """Gives `view_left`."""

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it has none
        return {"view_left": 0.0}


class LooksRight(Module):
    """Gives `view_right`."""

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it has none
        return {"view_right": 0.0}


class Unlocks(Module):
    """Gives `unlocked`."""

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it has none
        return {"unlocked": 1}


class Shows(Module):
    """Gives nothing."""

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it looks at nothing
        return {}
