"""The drivers of the actuators: modules that limit each demand.

A driver decides which value is written to the device in each period. Without a demand it holds the output or makes it
safe:

- A surface moves no further than its stops and no faster than its servo. Without a demand it stays at its last command:
  an elevator that went to neutral at every lost frame would be worse than one that stays.
- A charge or a burn wire cannot be undone. It fires after two demands in a row, and then stays fired.
- A gas valve closes without a demand: the gas stays in the wings and in the bottle.

The elevator has an angle sensor and a monitor, which find a servo that has failed (servo_monitor.py). The rudder has
neither, so its driver finds by itself a servo that takes no commands. It cannot find a servo that takes commands, but
does not move the surface.

After a restart, a servo driver waits for the first demand, since the surface may be anywhere. If a charge is still
demanded after a restart, its driver fires it again, which does no harm.
"""

from collections.abc import Mapping
from typing import ClassVar

from heronry_agent.module import Context, Inputs, Module, Value
from heronry_agent.parts.lasting import Lasting
from heronry_agent.parts.reading import held, number, whole

_NS_PER_S = 1_000_000_000
_REFUSES_NS = 500_000_000
_TAKEN_WITHIN_DEG = 1.0


class SurfaceServo(Module):
    """Drives a control surface to a demanded angle in degrees.

    demand: variable of the demanded angle
    echo: variable under which the last command to the servo is published; None: the command is not published
    """

    demand: ClassVar[str]
    echo: ClassVar[str | None] = None
    stop_deg: ClassVar[float] = 25.0
    fastest_deg_per_s: ClassVar[float] = 120.0

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._angle_deg: float | None = None

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Command the surface towards the demanded angle, at most as fast as the servo turns (`fastest_deg_per_s`).

        Before the first demand nothing is commanded. If the demand is missing later, the last command is repeated.
        """
        demand_deg = number(inputs, self.demand)
        if demand_deg is not None:
            self._angle_deg = self._towards(held(demand_deg, self.stop_deg))
        if self._angle_deg is None:
            return {}
        self.ctx.write(self._angle_deg)
        return {self.echo: self._angle_deg} if self.echo is not None else {}

    def _towards(self, wanted_deg: float) -> float:
        if self._angle_deg is None:
            return wanted_deg
        most_deg = self.fastest_deg_per_s * self.ctx.period_ns / _NS_PER_S
        return self._angle_deg + held(wanted_deg - self._angle_deg, most_deg)


class ElevatorServo(SurfaceServo):
    """An elevator servo; its last command is not published."""

    demand = "elevator_demand"


class ReportingElevatorServo(ElevatorServo):
    """An elevator servo that publishes its last command, for the monitor of the servos.

    The spec gives the command of each servo a version of its own, so that a reader knows which servo is driven.
    """

    echo = "elevator_servo_command"


class LimitedElevatorServo1(SurfaceServo):
    """The elevator servo of the first of three redundant paths, in each of which a limiter precedes the servo."""

    demand = "servo_demand_1"


class LimitedElevatorServo2(SurfaceServo):
    """The elevator servo of the second of three redundant paths, each with a limiter before its servo."""

    demand = "servo_demand_2"


class LimitedElevatorServo3(SurfaceServo):
    """The elevator servo of the third of three redundant paths."""

    demand = "servo_demand_3"


class RudderServo(SurfaceServo):
    """A rudder servo; its last command is not published.

    In each step this driver compares the command that the servo has really taken with the command that the
    driver gave in the step before. If the two differ for half a second, it reports the servo as failed, and
    again after each further half second.
    """

    demand = "rudder_demand"

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._refusal = Lasting(_REFUSES_NS, ctx.period_ns)

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Command the surface; report the servo if for half a second it has not taken the commands (class text)."""
        if self._refusal.is_due(self._angle_deg is not None and not self._has_taken(self._angle_deg)):
            self.ctx.report_failed(f"device:{self.ctx.device}")
        return super().step(inputs)

    def _has_taken(self, angle_deg: float) -> bool:
        taken = self.ctx.read()
        return isinstance(taken, (int, float)) and abs(taken - angle_deg) <= _TAKEN_WITHIN_DEG


class Charge(Module):
    """A charge that fires once, after two demands in a row."""

    demand: ClassVar[str]

    def __init__(self, ctx: Context) -> None:
        super().__init__(ctx)
        self._demanded = 0
        self._fired = False

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Command 1 to the device if the charge has fired, now or earlier, else 0.

        A period in which the demand is absent neither counts as a demand nor interrupts two demands in a row.
        """
        demand = whole(inputs, self.demand)
        if demand is not None:
            self._demanded = self._demanded + 1 if demand != 0 else 0
        self._fired = self._fired or self._demanded >= 2
        self.ctx.write(int(self._fired))
        return {}


class ChuteCharge(Charge):
    """The charge that opens the parachute's lid."""

    demand = "chute_release"


class BurnWire(Charge):
    """The wire that melts the balloon's line."""

    demand = "balloon_cut"


class InflationValve(Module):
    """The gas valve of the wings; its opening is 0 to 1."""

    def step(self, inputs: Inputs) -> Mapping[str, Value]:
        """Open the valve as far as demanded; close it without a demand."""
        demand = number(inputs, "valve_demand")
        self.ctx.write(min(max(demand or 0.0, 0.0), 1.0))
        return {}
