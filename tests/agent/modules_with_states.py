"""Modules with a state, each of which saves or restores it in another way."""

import time
from collections.abc import Mapping

from heronry_agent.module import Context, Inputs, Module, Value


class Counts(Module):
    """Counts its steps; its state is the count."""

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self.count = 0
        self.age_ns: int | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 - it reads nothing
        self.count += 1
        return {"demand": float(self.count)}

    def save(self) -> tuple[float, ...]:
        return (self.count, 0.5)

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:
        self.count, self.age_ns = int(state[0]), age_ns


class Keeps(Counts):
    """Goes on when its mode changes."""

    def mode_changed(self) -> bool:
        return True


class Raises(Counts):
    def save(self) -> tuple[float, ...]:
        raise ValueError("no state today")

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:
        super().restore(state, age_ns)
        raise ValueError("what is this?")


class Hangs(Counts):
    def save(self) -> tuple[float, ...]:
        while True:
            try:
                time.sleep(3600)
            except Exception:  # noqa: BLE001 - it does not want to be stopped
                continue

    def restore(self, state: tuple[float, ...], age_ns: int) -> None:
        super().restore(state, age_ns)
        while True:
            pass


class Bare(Module):
    """Has neither method."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:  # noqa: ARG002 - it reads nothing
        return {}


class Gives(Counts):
    """Saves what `given` says."""

    given: object = ()

    def save(self) -> tuple[float, ...]:
        return self.given  # type: ignore[return-value]
