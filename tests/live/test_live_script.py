"""A script of component graphs, flown by a running manager with real processes on the software bus."""

import json
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.plan import read_plan
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_manager.planner.exact import plan
from heronry_pcs.plan_script import module_graph
from heronry_pcs.script_difference import difference
from lab.benches.live_scripts import moved
from live.test_operator import Demo

pytestmark = pytest.mark.live
PLANTS = """\
plants:
  elevator: {moved_by: [elevator_servo_1, elevator_servo_2], seen_by: [elevator_angle_sensor], criticality: A}
"""


@pytest.fixture
def spec_file(tmp_path: Path) -> Path:
    """Figure 3 of the paper, with a plant that is moved and seen, and not fed back."""
    file = tmp_path / "elevator_and_chute.dg.yaml"
    file.write_text(shipped_spec_path("elevator_and_chute").read_text() + PLANTS)
    return file


def test_a_script_moves_a_running_system_and_back_and_a_bad_one_changes_nothing(
    spec_file: Path, tmp_path: Path
) -> None:
    spec = load(spec_file)
    before = plan(spec, situation(spec)).configuration
    name, after = moved(spec, situation(spec), before)
    there, back, bad = (tmp_path / f"{script}.pcs.script" for script in ("there", "back", "bad"))
    graphs = module_graph(spec, before), module_graph(spec, after)
    there.write_text(difference(*graphs))
    back.write_text(difference(*reversed(graphs)))
    bad.write_text("G.DeleteComponent ( nothing );\n")
    demo = Demo(spec_file)
    try:
        demo.until("reconfigured")
        assert demo.until("control_paths")["plants"] == {"elevator": "open"}

        refused = demo.fly(bad, spec_file)
        assert refused.returncode == 1
        assert "the script is refused, and nothing has changed: line 1: PCS201" in refused.stderr
        demo.until("script_refused")

        flown = demo.fly(there, spec_file)
        assert flown.returncode == 0, flown.stderr
        assert "is held until 'heronry pcs release'" in flown.stdout
        demo.until("script_taken")
        assert demo.until("reconfigured")["moved"] == [name]
        status = demo.say("status").stdout
        assert "a script of the operator is held: no better plan is sought" in status
        assert "the loop through elevator: OPEN, because nothing leads from elevator_angle_sensor" in status

        assert demo.fly(back, spec_file).returncode == 0
        assert demo.until("reconfigured")["moved"] == [name]
        released = demo.say("pcs", "release", "--json")
        assert json.loads(released.stdout)["done"] is True
        assert "the operator released it" in demo.until("script_ended", reason="the operator released it")["reason"]
        again = demo.say("pcs", "release")
        assert (again.returncode, again.stderr) == (1, "heronry: no script is held: see 'heronry status'\n")
    finally:
        demo.end()


@pytest.mark.soak
def test_big_blue_is_moved_and_back_and_then_loses_a_computer(tmp_path: Path) -> None:
    file = shipped_spec_path("big_blue")
    spec = load(file)
    demo = Demo(file, kill="pe:flight@25")
    try:
        planned = demo.until("plan_ready")["plan"]
        demo.until("reconfigured")
        before = read_plan(json.dumps(planned), spec).configuration
        name, after = moved(spec, situation(spec, phase=planned["phase"]), before)
        graphs = module_graph(spec, before), module_graph(spec, after)
        for script, pair in (("there", graphs), ("back", graphs[::-1])):
            file_of = tmp_path / f"{script}.pcs.script"
            file_of.write_text(difference(*pair))
            flown = demo.fly(file_of, file)
            assert flown.returncode == 0, flown.stderr
            assert demo.until("reconfigured")["moved"] == [name]
        assert demo.until("pe_lost")["pe"] == "flight"
        assert "pe:flight: silent" in demo.until("reconfigured")["causes"][0]
    finally:
        demo.end()
