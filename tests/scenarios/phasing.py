"""Modules that start a phase: one requests it, one gives the variable of a phase's rule, and one shows."""

from heronry_agent.module import Inputs, Module, Value

_ASKS_AFTER_STEPS = 20


class AsksForTheGlide(Module):
    """Gives `mark`, and requests the glide in every step from its twentieth on."""

    steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it has none
        self.steps += 1
        if self.steps >= _ASKS_AFTER_STEPS:
            self.ctx.request_phase("glide")
        return {"mark": 1}


class Rises(Module):
    """Gives `height`, which rises by one each second from 0 on, and begins anew at 5."""

    steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it has none
        self.steps += 1
        return {"height": self.steps / 20 % 5}


class Shows(Module):
    """Gives nothing."""

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it looks at nothing
        return {}
