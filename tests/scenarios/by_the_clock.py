"""Modules that fail, suspect, disagree and request by the mission time, which one of them gives.

So a scenario file shows all that in the simulator and with real processes: it is the modules' own code that fails.
"""

from collections.abc import Mapping

from heronry_agent.module import Inputs, Module, Value
from heronry_agent.parts.comparators import ComparatorBetter

CRASHES_S = 4.0
DIFFERS_S = (8.0, 10.0)
SUSPECTS_S = 11.0
NOISE_S = (13.0, 18.0)
HIGH_S = (22.0, 26.0)


class Clock(Module):
    """Gives `mission_time` in s and `height` in m: 10, but 60 during HIGH_S; begins when all run."""

    steps = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:
        if self.steps or len(inputs) == 2:
            self.steps += 1
        now_s = self.steps * self.ctx.period_ns / 1e9
        return {"mission_time": now_s, "height": 60.0 if HIGH_S[0] <= now_s < HIGH_S[1] else 10.0}


def during(inputs: Inputs, times_s: tuple[float, float]) -> bool:
    """Whether the mission time is known and between these two times."""
    now = inputs.get("mission_time")
    return now is not None and times_s[0] <= now.number() < times_s[1]


class Fragile(Module):
    """Gives `mark`; raises three times after CRASHES_S where it ran before, and is given up there."""

    ran_before = False
    crashes = 0

    def step(self, inputs: Inputs) -> dict[str, Value]:
        if during(inputs, (0.1, CRASHES_S)):
            Fragile.ran_before, Fragile.crashes = True, 0
        elif during(inputs, (CRASHES_S, 1e9)) and Fragile.ran_before and Fragile.crashes < 3:
            Fragile.crashes += 1
            raise ZeroDivisionError("it is time to fail")
        return {"mark": 1}


class FirstAngle(Module):
    """Gives `angle` in degrees."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 - the angle is always the same
        return {"angle": 2.0}


class SecondAngle(Module):
    """Gives `angle` in degrees, 40 degrees too much during DIFFERS_S."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        return {"angle": 42.0 if during(inputs, DIFFERS_S) else 2.0}


class Compares(ComparatorBetter):
    """Compares the two angles."""

    variable, output, limit = "angle", "checked_angle", 5.0


class Operates(Module):
    """Suspects a PE and a bus that both work at SUSPECTS_S, and wants the noise during NOISE_S."""

    suspected = wanted = False

    def step(self, inputs: Inputs) -> dict[str, Value]:
        if not self.suspected and during(inputs, (SUSPECTS_S, 1e9)):
            self.suspected = True
            self.ctx.report_failed("pe:left")
            self.ctx.report_failed("bus:can0")
        if during(inputs, NOISE_S) != self.wanted:
            self.wanted = not self.wanted
            self.ctx.request_priority("noise", 90 if self.wanted else None)
        return {"elevator_demand": 1.0}


class Shows(Module):
    """Gives nothing."""

    def step(self, inputs: Inputs) -> dict[str, Value]:  # noqa: ARG002 - it looks at nothing
        return {}
