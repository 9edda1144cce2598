"""The images of the shipped aircraft: the code of the modules of `big_blue`, `elevator_and_chute` and the examples.

`elevator_and_chute` names no images: each of its images has the name of the module. `big_blue` names the image of a
module if several modules share the image, or if the image with the module's name uses other variables. The agent finds
`CATALOGUE`, like the catalogues of other packages, by an entry point (`heronry.images` in pyproject.toml), and imports
only the images that it runs.

An image imports only `heronry_agent.module`, `heronry_agent.parts` and other files of this folder. The agent calls
`step` once per period, with the inputs that are present; `ctx.now_ns` is the time. An image reads no clock and no
random source, so the same times and inputs give the same outputs. Any input may be absent in any period, above all in
the first ones. Each file tells what its images do without an input, and what they lose at a restart.
"""

from collections.abc import Mapping

_HERE = "heronry_tools.aircraft.images"


def _in(file: str, **images: str) -> dict[str, str]:
    return {name: f"{_HERE}.{file}:{cls}" for name, cls in images.items()}


CATALOGUE: Mapping[str, str] = {
    **_in(
        "sensors",
        angle_driver="ElevatorAngle",
        battery_driver="Battery",
        camera_driver="Camera",
        command_driver="CommandReceiver",
        console_driver="Console",
        elevator_angle_driver="ElevatorAngle",
        gps_driver="GpsAltitude",
        gps_receiver="GpsReceiver",
        horizon_driver="Horizon",
        inertial_unit="InertialUnit",
        pitot_driver="Pitot",
        pressure_driver="Barometer",
        pressure_driver_1="PressureSensor1",
        pressure_driver_2="PressureSensor2",
        pressure_driver_3="PressureSensor3",
        rate_gyros="RateGyros",
        release_driver="ChuteReceiver",
        uv_driver="Ultraviolet",
        wing_pressure_driver="WingPressure",
    ),
    **_in(
        "actuators",
        burn_wire="BurnWire",
        chute_charge="ChuteCharge",
        chute_driver="ChuteCharge",
        elevator_servo="ReportingElevatorServo",
        inflation_driver="InflationValve",
        limited_servo_1="LimitedElevatorServo1",
        limited_servo_2="LimitedElevatorServo2",
        limited_servo_3="LimitedElevatorServo3",
        rudder_servo="RudderServo",
        servo_driver_1="ElevatorServo",
        servo_driver_2="ElevatorServo",
    ),
    **_in("air_data", air_data="AirData", pressure_voter="PressureVoter"),
    **_in(
        "altitude",
        barometric_altitude="StaticPressureAltitude",
        fused_altitude="FusedStaticAltitude",
        high_quality_altitude="FusedAltitude",
        low_quality_altitude="PressureAltitude",
    ),
    **_in("attitude", attitude_filter="AttitudeFilter", horizon_attitude="HorizonAttitude"),
    **_in("control", elevator_control="ElevatorControl", pitch_control="PitchControl", rudder_control="RollControl"),
    **_in("control", state_estimator="StateEstimator"),
    **_in("guidance", experimental_autopilot="OrbitAutopilot", guidance="Guidance"),
    **_in("servo_monitor", elevator_monitor="ElevatorMonitor", servo_monitor="ServoMonitor"),
    **_in(
        "redundancy",
        comparator_better="PitchBetter",
        comparator_none="PitchNone",
        comparator_safer="PitchSafer",
        elevator_follows="ElevatorFollows",
        elevator_limiter="ElevatorLimiter",
        elevator_limiter_1="ElevatorLimiter1",
        elevator_limiter_2="ElevatorLimiter2",
        elevator_limiter_3="ElevatorLimiter3",
        pitch_filter="PitchFilter",
        pitch_trim="PitchTrim",
        pitch_versions="PitchVersions",
        pressure_fail_over="PressureFailOver",
        pressure_majority="PressureMajority",
        pressure_median="PressureMedian",
        pressure_stuck="PressureStuck",
    ),
    **_in("wing", inflation_control="InflationControl", wing_monitor="WingMonitor"),
    **_in("recovery", chute_logic="ChuteLogic", cutdown_logic="CutdownLogic"),
    **_in("mission", mission_sequencer="MissionSequencer"),
    **_in("telemetry", flight_recorder="FlightRecorder", ground_display="GroundDisplay", telemetry="Telemetry"),
    **_in("pilot_view", pilot_view="PilotView"),
    **_in("imaging", image_archive="ImageArchive", imaging="Imaging"),
}
