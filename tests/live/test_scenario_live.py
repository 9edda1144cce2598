"""Files of tests/scenarios, flown by real processes on software buses; no process and no folder is left behind."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from lab.slow_spec import SLOW_SCENARIO
from thoroughness import mostly_soak

pytestmark = pytest.mark.live
SCENARIOS = Path("tests/scenarios")
HERONRY = [sys.executable, "-m", "heronry_tools"]


def scenario(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*HERONRY, "scenario", *arguments], capture_output=True, text=True, timeout=120, check=False)


def flown(file: Path) -> dict[str, Any]:
    ran = scenario(str(file), "-i", "softbus", "--patience", "20", "--json")
    told: dict[str, Any] = json.loads(ran.stdout)
    assert ran.returncode == 0, ran.stdout
    socket = Path(re.search(r"softbus (\S+),", told["where"])[1])  # type: ignore[index]  # it is on a software bus
    assert not socket.parent.exists()
    return told


def test_two_computers_die_and_one_comes_back() -> None:
    told = flown(SCENARIOS / "both_computers_die.scenario")
    assert told["where"].startswith("can0: softbus")
    assert [one["holds"] for one in told["expectations"]] == [True] * 4
    assert told["trace"].index("--- at 1s kill pe:left") < told["trace"].index("--- at 4s restore pe:right")


@pytest.mark.parametrize(
    "name",
    mostly_soak(
        [
            "a_failed_module_is_cleared_by_the_operator",
            "a_keyed_takeover_in_another_phase",
            "a_pause_longer_than_the_lease",
            "a_paused_manager_returns",
            Path(SLOW_SCENARIO).stem,
            "the_operator_fails_a_pe",
            "modules_act_by_the_clock",
        ],
        # test_keyed.py has a take-over with a key in every run, test_operator.py an element that the operator fails
        ["a_pause_longer_than_the_lease"],
    ),
)
def test_files_that_processes_fly_as_the_simulator_does(name: str) -> None:
    assert all(one["holds"] for one in flown(SCENARIOS / f"{name}.scenario")["expectations"])


@pytest.mark.soak  # test_operator.py enters a phase in every run
def test_a_phase_is_entered() -> None:
    flown(SCENARIOS / "the_operator_enters_a_phase.scenario")


def test_what_is_not_heard_fails(tmp_path: Path) -> None:
    file = tmp_path / "wrong.scenario"
    file.write_text(
        "# It expects what cannot be: nobody serves when the only one who can is dead.\n"
        f"spec {Path('dg_specs/examples/phases.dg.yaml').absolute()}\nat 0.5s kill pe:flight\n"
        "expect function:balloon_release served within 400ms\nend 1.5s\n"
    )
    ran = scenario(str(file), "-i", "softbus")
    assert ran.returncode == 1
    assert "expected function:balloon_release served within 400ms; this did not hold at 1.500 s" in ran.stdout


@pytest.mark.soak  # the one above has no patience in every run, and test_two_computers_die has some
def test_with_patience_what_comes_late_holds(tmp_path: Path) -> None:
    file = tmp_path / "late.scenario"
    file.write_text(
        "# Nobody moves a servo within 20 ms of a death that is noticed after 60 ms.\n"
        f"spec {Path('dg_specs/examples/demux_actuators.dg.yaml').absolute()}\nat 1s kill pe:tail_a\n"
        "expect function:elevator served by servo_driver_2 within 20ms\nend 4s\n"
    )
    assert scenario(str(file), "-i", "softbus", "--patience", "100").returncode == 0


RADIO = f"""\
# The end of the_ground_flies_it_until_the_radio_fades: a tenth of the radio, and then nothing of it.
spec {Path("tests/scenarios/ground_autopilot.dg.yaml").absolute()}
at 0.5s collapse bus:radio for 2.5s level 10
at 3s link_cut bus:radio for 3s
expect function:display silent within 2s
expect function:elevator served throughout
expect pe:nav active throughout
end 5.5s
"""


@pytest.mark.parametrize("whole", mostly_soak([True, False], [False]))
def test_the_ground_flies_it_until_the_radio_fades(tmp_path: Path, *, whole: bool) -> None:
    file = tmp_path / "radio.scenario"
    file.write_text(RADIO)
    told = flown(SCENARIOS / "the_ground_flies_it_until_the_radio_fades.scenario" if whole else file)
    assert "radio has 8% of its bandwidth, reported by comms" in told["trace"]
    assert "radio is gone, reported by comms" in told["trace"]  # where the computer is busy, ground was lost before
