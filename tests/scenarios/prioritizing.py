"""A module that changes a priority: it requests one, one outside the range, and the spec's again."""

from heronry_agent.module import Inputs, Module, Value

_WANTED = ((20, 90), (60, 30_000), (80, 60), (81, 55), (82, 70), (160, None))  # from this step on, this priority


class AsksForTheNoise(Module):
    """Gives `mark`, and requests priorities of `noise`."""

    steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it has none
        self.steps += 1
        for since, priority in _WANTED:
            if self.steps == since:
                self.ctx.request_priority("noise", priority)
        return {"mark": 1}
