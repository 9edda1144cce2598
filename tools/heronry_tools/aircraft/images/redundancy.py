"""One example image for each class of `heronry_agent.parts`, with the variable names of the example specs."""

from heronry_agent.parts.choosers import FailOver, NVersion
from heronry_agent.parts.comparators import ComparatorBetter, ComparatorNone, ComparatorSafer
from heronry_agent.parts.limiter import RateLimiter
from heronry_agent.parts.monitors import ActuatorMonitor, StuckSensorMonitor
from heronry_agent.parts.states import Integrator, LowPass
from heronry_agent.parts.voters import MajorityVoter, MedianVoter

_PRESSURES = {f"pressure_{number}": f"device:pressure_sensor_{number}" for number in (1, 2, 3)}


class PressureMedian(MedianVoter):
    """The middle of three pressures, in hPa."""

    channels, output, tolerance = _PRESSURES, "median_pressure", 20.0


class PressureMajority(MajorityVoter):
    """The pressure on which two of three sensors agree, in hPa."""

    channels, output, tolerance = _PRESSURES, "agreed_pressure", 20.0


class PressureFailOver(FailOver):
    """Gives the pressure of `PressureMajority`, in hPa; if that is missing, the pressure of `PressureMedian`."""

    sources, output = ("agreed_pressure", "median_pressure"), "static_pressure"


class PitchVersions(NVersion):
    """Gives the pitch in degrees: from the gyros, or without them from the horizon sensor."""

    variable, output, tolerance = "pitch_angle", "checked_pitch", 5.0
    authors = {1: "module:gyro_attitude", 2: "module:horizon_attitude"}  # noqa: RUF012 - a ClassVar of NVersion


class PitchBetter(ComparatorBetter):
    """Gives the pitch angle of the better of two versions, in degrees.

    It reports a disagreement of the versions: a lasting difference of more than 5 degrees.
    """

    variable, output, limit = "pitch_angle", "checked_pitch", 5.0


class PitchSafer(ComparatorSafer):
    """Gives the pitch angle of the better of two versions, in degrees.

    During a disagreement (a lasting difference of more than 5 degrees) it gives the angle nearer to level.
    """

    variable, output, limit = "pitch_angle", "checked_pitch", 5.0


class PitchNone(ComparatorNone):
    """Gives the pitch angle of the better of two versions, in degrees.

    During a disagreement (a lasting difference of more than 5 degrees) it gives no value.
    """

    variable, output, limit = "pitch_angle", "checked_pitch", 5.0


class ElevatorLimiter(RateLimiter):
    """The elevator's demand, limited to 30 degrees per second."""

    source = output = "elevator_demand"
    most_per_s = 30.0


class ElevatorLimiter1(ElevatorLimiter):
    """The limiter of the first of three redundant paths; each path leads to an elevator servo of its own."""

    output = "servo_demand_1"


class ElevatorLimiter2(ElevatorLimiter):
    """The limiter of the second of three redundant paths."""

    output = "servo_demand_2"


class ElevatorLimiter3(ElevatorLimiter):
    """The limiter of the third of three redundant paths."""

    output = "servo_demand_3"


class PitchFilter(LowPass):
    """The pitch angle in degrees, smoothed over half a second."""

    source = output = "pitch_angle"
    lag_s = 0.5


class PitchTrim(Integrator):
    """The elevator's demand in degrees that brings a lasting pitch angle to 0."""

    source, output = "pitch_angle", "elevator_demand"
    gain_per_s, least, most = -0.2, -15.0, 15.0


class PressureStuck(StuckSensorMonitor):
    """Monitors whether the barometer's reading is stuck."""

    source, output, element = "absolute_pressure", "pressure_health", "device:barometer"


class ElevatorFollows(ActuatorMonitor):
    """Monitors whether the elevator follows its demand; if it does not, the elevator's servo 1 is reported."""

    command, position, output = "elevator_demand", "elevator_angle", "elevator_health"
    element, tolerance, lag_s = "device:elevator_servo_1", 2.5, 0.1
