"""The same spec, faults and running configuration give the same plan: in any process, and whatever was planned
before."""

import os
import subprocess
import sys

from heronry_dg.loader import load
from heronry_dg.objective import placement
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_manager.planner.exact import Planner, plan

ASK = """
import sys
from heronry_dg.objective import placement
from heronry_manager.planner.exact import Planner
from lab.planner_race.generator import generate
from heronry_dg.situation import situation
spec = generate(2, 30, 8)
planner = Planner(spec)
before = planner.plan(situation(spec), effort=0.2)
after = planner.plan(situation(spec, ["pe:pe03"]), placement(before.configuration), effort=0.2)
sys.stdout.write(before.to_json() + after.to_json())
"""


def test_two_processes_with_different_hash_seeds_say_the_same() -> None:
    said = {
        subprocess.run(
            [sys.executable, "-c", ASK],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            check=True,
            text=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(said) == 1


def test_a_warm_planner_says_what_a_new_one_does() -> None:
    spec = load(shipped_spec_path("elevator_and_chute"))
    planner = Planner(spec)
    before = placement(plan(spec, situation(spec)).configuration)
    for down in ([], ["device:gps"], ["pe:tail_pe"], ["device:elevator_servo_1"], ["bus:can0"], []):
        now = situation(spec, down)
        assert planner.plan(now, before) == plan(spec, now, before)
