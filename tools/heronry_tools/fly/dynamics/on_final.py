"""Makes the plant of a mission: the Exploration Aerial Vehicle (EAV) on final approach.

The wind and the sensor errors are drawn from the mission's seed. In a mission that measures latencies, the air is still
and only the camera has errors.
"""

from heronry_tools.fly.dynamics.eav import EavPlant
from heronry_tools.fly.dynamics.moving_air import MovingAir
from heronry_tools.fly.latency import LatencyProbe
from heronry_tools.fly.mission import Mission
from heronry_tools.fly.record import Recorder


def eav_on_final(mission: Mission, recorder: Recorder, probe: LatencyProbe | None, *, held: bool = False) -> EavPlant:
    """Return the plant of a mission.

    recorder: gets the state of the aircraft after each step near the ground
    probe: adds step changes to the measured pitch rate; None if the mission measures no latencies
    held: whether the aircraft is held at its start until `EavPlant.release`
    """
    if probe is not None:
        return EavPlant(mission.seed, perfect=True, held=held, watch=recorder.watch, probe=probe)
    return EavPlant(
        mission.seed,
        air=MovingAir(mission.seed, mission.wind()),
        corrections_lost_s=mission.corrections_lost_s,
        height_bias_m=mission.height_bias_m(),
        held=held,
        watch=recorder.watch,
    )
