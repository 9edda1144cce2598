"""Modules with one kind of behaviour each that a host must handle."""

# ruff: noqa: ARG002 - most of them do nothing with their inputs

import json
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value


class Gain(Module):
    """Reads its device, writes twice, and gives its name, mode and period."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        read = self.ctx.read()
        assert isinstance(read, float)
        self.ctx.write(read + 4.0)
        self.ctx.write(8.0)
        self.ctx.report_failed("device:left", 3)
        return {"demand": inputs["rate"].number() if "rate" in inputs else 0.5}


class Knowing(Module):
    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        return {"words": f"{self.ctx.module} {self.ctx.mode} {self.ctx.period_ns} {self.ctx.now_ns}"}


class Counting(Module):
    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._steps = 0

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        self._steps += 1
        return {"steps": self._steps}


class Raising(Module):
    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        raise ZeroDivisionError("of all things\nand a second line")


class Unbuildable(Module):
    def __init__(self, ctx: Context) -> None:
        raise MemoryError


class Reading(Module):
    """Fails within a library."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        return dict(json.loads(""))


class Unspeakable_(Exception):  # noqa: N801, N818 - its name is all that is left of it
    def __str__(self) -> str:
        raise ValueError


class Unspeakable(Module):
    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        raise Unspeakable_


class Wrong(Module):
    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        return 3  # type: ignore[return-value]  # what foreign code may do


class Deviceless(Module):
    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        self.ctx.read()
        return {}


class Steady(Module):
    """Gives the same demand in every step."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        return {"demand": 0.5}


class Driving(Module):
    """Drives its device to the demand, or to the middle without one."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        demand = inputs.get("demand")
        self.ctx.write(0.0 if demand is None else demand.number())
        return {}
