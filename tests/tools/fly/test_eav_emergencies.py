"""Faults in the last half minute of the EAV's landing, each flown, with what the plan says of it.

`precise`: the plan has kept a position that is good enough to land. `waiting`: it has none any more; an aircraft above
the decision height goes around, one below it is committed and lands.
"""

import pytest

pytest.importorskip("jsbsim")

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.fly.flight import EavFlight
from heronry_tools.fly.mission import Blow, Mission

SPEC = load(shipped_spec_path("eav"))


def flown(*blows, seed=1):
    landing, _ = EavFlight(SPEC, Mission(seed=seed, blows=blows, judged=True)).fly()
    assert landing.violations == ()
    return landing


@pytest.mark.soak
@pytest.mark.parametrize(
    ("blow", "mode"),
    [
        (Blow("bus:radio", below_m=20.0), "waiting"),
        (Blow("bus:radio", below_m=10.0), "waiting"),
        (Blow("bus:radio", below_m=5.0), "waiting"),
        (Blow("device:camera", below_m=10.0), "waiting"),
        (Blow("pe:nav_b", below_m=1.3), "precise"),
        (Blow("pe:vision", below_m=1.3), "waiting"),
        (Blow("device:elevator_1", at_s=20.0, how="stuck"), "precise"),
        (Blow("device:aileron_1", at_s=30.0, how="stuck"), "precise"),
    ],
    ids=str,
)
def test_a_fault_that_leaves_enough_to_land(blow, mode):
    landing = flown(blow)
    assert landing.mode == mode
    assert landing.causes == ()
    assert not landing.went_around
    assert landing.reconfigured_after_s < 2.5


@pytest.mark.soak
@pytest.mark.parametrize("blow", [Blow("device:camera", at_s=18.0), Blow("bus:radio", at_s=20.0)], ids=str)
def test_above_the_decision_height_it_goes_around_when_the_position_is_lost(blow):
    landing = flown(blow)
    assert (landing.mode, landing.went_around, landing.touchdown) == ("waiting", True, None)


@pytest.mark.soak
@pytest.mark.parametrize(("seed", "at_s"), [(3006, 28.7523), (3046, 20.2456)])
def test_the_pe_with_filter_and_receiver_dies_on_the_slope(seed, at_s):
    """The filter starts on another PE, with no receiver to begin at."""
    landing = flown(Blow("pe:nav_b", at_s=at_s), seed=seed)
    assert landing.mode == "precise"
    assert landing.causes == ()
