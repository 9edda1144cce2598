"""The modules of the EAV and of its rover: the images that `dg_specs/flights/eav.dg.yaml` names.

The modules import only `heronry_agent.module`, `heronry_agent.parts` and each other, so a PE runs them without JSBSim.
The agent finds `CATALOGUE` by an entry point (`heronry.images` in pyproject.toml), and imports only the images that it
runs.
"""

from collections.abc import Mapping

_HERE = "heronry_tools.fly.avionics"


def _in(file: str, **images: str) -> dict[str, str]:
    return {name: f"{_HERE}.{file}:{cls}" for name, cls in images.items()}


CATALOGUE: Mapping[str, str] = {
    **_in(
        "drivers",
        eav_aileron_sensor="AileronSensor",
        eav_aileron_servo="AileronServo",
        eav_differential_receiver="DifferentialReceiver",
        eav_elevator_sensor="ElevatorSensor",
        eav_elevator_servo="ElevatorServo",
        eav_gps="SatelliteReceiver",
        eav_inertial_unit="InertialUnit",
        eav_pitot="Pitot",
        eav_rudder_sensor="RudderSensor",
        eav_rudder_servo="RudderServo",
        eav_throttle="Throttle",
        eav_throttle_sensor="ThrottleSensor",
        rover_camera="CameraImages",
        rover_head_encoder="HeadEncoder",
        rover_pan_tilt="PanTilt",
    ),
    **_in(
        "position",
        eav_coarse_position="SatellitePosition",
        eav_differential_position="DifferentialPosition",
        eav_tracked_position="TrackedPosition",
    ),
    **_in(
        "watching",
        eav_accuracy_monitor="AccuracyMonitor",
        eav_aileron_monitor="AileronMonitor",
        eav_elevator_monitor="ElevatorMonitor",
        eav_rudder_monitor="RudderMonitor",
        eav_throttle_monitor="ThrottleMonitor",
        rover_tracking_head="TrackingHead",
    ),
    **_in("flight_management", eav_flight_management="FlightManagementSystem"),
    **_in(
        "control",
        eav_airspeed_control="AirspeedControl",
        eav_course_control="CourseControl",
        eav_pitch_control="PitchControl",
        eav_roll_control="RollControl",
        eav_vertical_speed_control="VerticalSpeedControl",
        eav_yaw_damper="YawDamper",
    ),
}
