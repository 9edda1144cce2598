"""A module that reports PEs and buses, some of them rightly, and a PE that the spec does not have."""

from heronry_agent.module import Inputs, Module, Value

_REPORTS = ((40, "pe:right"), (80, "bus:can0"), (100, "bus:link"), (120, "pe:moon"), (201, "pe:far"))  # at this step


class Suspects(Module):
    """Gives `mark`, and reports."""

    steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it has none
        self.steps += 1
        for at, element in _REPORTS:
            if self.steps == at:
                self.ctx.report_failed(element, 5)
        return {"mark": 1}
