"""A script of component graphs, flown by a running manager with real processes on the software bus."""

import json
import subprocess
from pathlib import Path

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import situation
from heronry_manager.core.vocabulary import AskStatus
from heronry_manager.events import ControlPaths, PeLost, Reconfigured, ScriptEnded, ScriptRefused, ScriptTaken
from heronry_manager.planner.exact import plan
from heronry_manager.shell.control_client import call
from heronry_manager.shell.control_protocol import FlyScript
from heronry_pcs.plan_script import module_graph
from heronry_pcs.script_difference import difference
from heronry_tools.runtime.demo.awaited_events import AwaitedEvents
from lab.benches.fleets import aircraft
from lab.benches.live_scripts import calm_plan, moved
from lab.slow_spec import slow_spec
from live.test_operator import Demo, heronry

pytestmark = pytest.mark.live
CALM_S = 3.0
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
        demo.until(Reconfigured)
        assert demo.until(ControlPaths).plants == {"elevator": "open"}

        refused = demo.fly(bad, spec_file)
        assert refused.returncode == 1
        assert "the script is refused, and nothing has changed: line 1: PCS201" in refused.stderr
        demo.until(ScriptRefused)

        flown = demo.fly(there, spec_file)
        assert flown.returncode == 0, flown.stderr
        assert "is held until 'heronry pcs release'" in flown.stdout
        demo.until(ScriptTaken)
        assert demo.until(Reconfigured).moved == (name,)
        status = demo.say("status").stdout
        assert "a script of the operator is held: no better plan is sought" in status
        assert "the loop through elevator: OPEN, because nothing leads from elevator_angle_sensor" in status

        assert demo.fly(back, spec_file).returncode == 0
        assert demo.until(Reconfigured).moved == (name,)
        released = demo.say("pcs", "release", "--json")
        assert json.loads(released.stdout)["done"] is True
        assert "the operator released it" in demo.until(ScriptEnded, reason="the operator released it").reason
        again = demo.say("pcs", "release")
        assert (again.returncode, again.stderr) == (1, "heronry: no script is held: see 'heronry status'\n")
    finally:
        demo.end()


@pytest.mark.soak
def test_big_blue_is_moved_and_back_a_bad_script_changes_nothing_and_a_kill_in_the_middle_ends_as_a_fault(
    tmp_path: Path,
) -> None:
    file = slow_spec("big_blue", tmp_path, heartbeat_ms=500, rates_divided_by=4)
    bad = tmp_path / "bad.pcs.script"
    bad.write_text("G.DeleteComponent ( nothing );\n")
    with aircraft(str(file)) as flown:
        spec, socket = flown.spec, flown.fleet.control_socket()
        events = AwaitedEvents(flown.fleet, flown.fleet.start_manager())
        flown.start_pes()
        events.wait(Reconfigured)
        running = calm_plan(flown, CALM_S)
        name, there = moved(spec, running.now, running.configuration)
        graphs = module_graph(spec, running.configuration), module_graph(spec, there)
        there_and_back = difference(*graphs), difference(*graphs[::-1])
        events.take()

        refused = fly(bad, file, socket)
        assert refused.returncode == 1
        assert "the script is refused, and nothing has changed: line 1: PCS201" in refused.stderr
        events.wait(ScriptRefused)
        assert calm_plan(flown, CALM_S).configuration == running.configuration
        assert "epoch_prepared" not in [told.kind for told in events.take()]

        for number, script in enumerate(there_and_back):
            one = tmp_path / f"{number}.pcs.script"
            one.write_text(script)
            flown_script = fly(one, file, socket)
            assert flown_script.returncode == 0, flown_script.stderr
            assert events.wait(Reconfigured).moved == (name,)
        assert calm_plan(flown, CALM_S).configuration == running.configuration

        victim = there.modules[name].pe
        assert call(socket, FlyScript(there_and_back[0])).done
        events.wait(ScriptTaken)
        flown.fleet.kill_pe(victim)
        assert events.wait(PeLost).pe == victim
        assert "it is no longer legal" in events.wait(ScriptEnded).reason
        while not any(f"pe:{victim}: silent" in cause for cause in events.wait(Reconfigured).causes):
            pass  # the script's epoch was active already when the PE was killed
        status = call(socket, AskStatus()).status
        assert status is not None
        assert status["script"]["state"] == "ended"
        epochs = {pe: status["pes"][pe]["epoch"] for pe, one in spec.pes.items() if spec.manager.bus in one.buses}
        assert epochs == {pe: None if pe == victim else status["epoch"] for pe in epochs}


def fly(script: Path, spec: Path, socket: Path) -> subprocess.CompletedProcess[str]:
    return heronry("pcs", "apply", str(script), str(spec), "--live", "--socket", str(socket))
