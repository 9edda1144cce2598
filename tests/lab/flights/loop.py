"""Plant and images in one loop: every image once per 25 ms in a fixed order, with data that arrive at once.

It is not the product's way of flying (`heronry fly`), which has buses, periods of several PEs and plans between sensor
and servo. It tells what the laws, gains and the filter are worth, in a tenth of a second per landing.
"""

import importlib
from collections import deque
from dataclasses import dataclass, field

from heronry_agent.module import Datum, Inputs, Module, Value
from heronry_tools.fly.avionics import CATALOGUE
from heronry_tools.fly.dynamics.eav import EavPlant

PERIOD_NS = 25_000_000
# image, device, mode, what it must not read in this loop
SENSORS = (("eav_inertial_unit", "ins_1"), ("eav_pitot", "pitot_1"), ("eav_elevator_sensor", "elevator_sensor"))
SLOW_SENSORS = (("eav_gps", "gps"), ("eav_differential_receiver", "differential_receiver"))
LAWS = (
    "eav_flight_management",
    "eav_vertical_speed_control",
    "eav_pitch_control",
    "eav_course_control",
    "eav_roll_control",
    "eav_yaw_damper",
    "eav_airspeed_control",
)
ACTUATORS = (
    ("eav_elevator_servo", "elevator_1"),
    ("eav_aileron_servo", "aileron_1"),
    ("eav_rudder_servo", "rudder_1"),
    ("eav_throttle", "throttle_1"),
)
POSITION = {"filter": "eav_tracked_position", "coarse": "eav_coarse_position", "precise": "eav_differential_position"}


@dataclass
class _Context:
    """What an image sees of an agent."""

    plant: EavPlant
    device: str = ""
    mode: str = "precise"
    module: str = ""
    period_ns: int = PERIOD_NS
    now_ns: int = 0
    reported: set[str] = field(default_factory=set)

    def read(self) -> Value | None:
        return self.plant.read(self.device, self.now_ns)

    def write(self, value: Value) -> None:
        self.plant.write(self.device, value, self.now_ns)

    def report_failed(self, element: str, detail: int = 0) -> None:  # noqa: ARG002
        self.reported.add(element)


class Loop:
    """One flight."""

    def __init__(
        self, plant: EavPlant, position: str = "filter", *, delay_steps: int = 0, also: tuple[str, ...] = ()
    ) -> None:
        """delay_steps: periods between a demand and the servo, beyond the one of the loop. also: more images."""
        self.plant, self.now_ns = plant, 0
        self._data: dict[str, tuple[Value, int]] = {}
        images = [*SENSORS, *SLOW_SENSORS, ("rover_camera", "camera"), (POSITION[position], "")]
        images += [(law, "") for law in LAWS]
        images += [*ACTUATORS, ("rover_tracking_head", ""), ("rover_pan_tilt", "pan_tilt")]
        images += [(image, "") for image in also]
        self.contexts = {image: _Context(plant, device) for image, device in images}
        self.modules: dict[str, Module] = {}
        for image, context in self.contexts.items():
            file, _, cls = CATALOGUE[image].partition(":")
            self.modules[image] = getattr(importlib.import_module(file), cls)(context)
        self._slow = {"eav_gps", "eav_differential_receiver", "rover_camera"}
        self._late: deque[dict[str, Value]] = deque([{}] * delay_steps)

    @property
    def data(self) -> dict[str, Value]:
        return {name: value for name, (value, _) in self._data.items()}

    def step(self) -> None:
        """One period."""
        is_slow = self.now_ns % (4 * PERIOD_NS) == 0
        inputs = self._inputs()
        for image, module in self.modules.items():
            if image in self._slow and not is_slow:
                continue
            self.contexts[image].now_ns = self.now_ns
            outputs = dict(module.step(inputs))
            demands = {name: outputs.pop(name) for name in list(outputs) if name.endswith("_demand")}
            if demands and self._late:
                self._late.append(demands)
                demands = self._late.popleft()
            if outputs or demands:
                self._data |= {name: (value, self.now_ns) for name, value in (outputs | demands).items()}
                inputs = self._inputs()
        self.now_ns += PERIOD_NS

    def _inputs(self) -> Inputs:
        lives_ns = 300_000_000
        return Inputs(
            {
                name: (name, Datum(value, 1, self.now_ns - at_ns))
                for name, (value, at_ns) in self._data.items()
                if self.now_ns - at_ns <= lives_ns
            }
        )
