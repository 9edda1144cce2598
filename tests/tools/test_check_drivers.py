"""DG7xx: the drivers that a spec names are loaded in a process of its own, and compared with what the spec says."""

from pathlib import Path

import pytest

from heronry_dg.check.examples import SOUND
from heronry_tools.analysis.check import drivers
from heronry_tools.cli import main

OWN = """
from heronry_agent.device_driver import ActuatorDriver, Option, SensorDriver

class Sensor(SensorDriver):
    OPTIONS = {"port": Option("The line.", int)}

class Lamp(ActuatorDriver):
    pass
"""


def found(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, says: str, *more: str
) -> str:
    monkeypatch.setenv("COLUMNS", "300")
    file = folder / "own.dg.yaml"
    kind = "actuator, pe: tail" if says.startswith(", safe") or "Lamp" in says else "sensor, pe: nav"
    file.write_text(SOUND.replace(f"kind: {kind}", f"kind: {kind}{says}"))
    main(["check", str(file), "--select", "DG7", "--format", "concise", *more])
    return capsys.readouterr().out


@pytest.mark.parametrize(
    ("code", "says", "problem"),
    [
        (OWN, ", driver: 'own:Sensor', options: {port: 1}", None),
        (OWN, ", driver: 'own:Sensor'", "DG703 error: device 'gps': option 'port' is missing: The line."),
        (OWN, ", driver: 'own:Sensor', options: {prot: 1}", "the driver has no option 'prot'; did you mean 'port'"),
        (OWN, ", driver: 'own:Lmap'", "DG701 warning: device 'gps': driver 'own:Lmap': own has no class Lmap"),
        (OWN, ", safe: hold, driver: 'own:Lamp'", None),
        (OWN, ", safe: release, driver: 'own:Lamp'", "DG702 error: device 'lamp': driver 'own:Lamp' cannot release"),
        (OWN, ", driver: bmp280", None),
        (OWN, ", driver: pwm", "DG702 error: device 'gps': driver 'pwm' is for an actuator"),
        (OWN, ", options: {port: 1}", "DG704 error: device 'gps' has options and no driver"),
        ("1 / 0\n", ", driver: 'own:Sensor'", "own cannot be imported (ZeroDivisionError: division by zero)"),
        ("import os\nos._exit(3)\n", ", driver: 'own:Sensor'", "ends the process that loads it (exit code 3)"),
        ("import time\ntime.sleep(60)\n", ", driver: 'own:Sensor'", "has not been loaded after 2 s"),
    ],
)
def test_a_device_is_compared_with_its_driver(  # noqa: PLR0917
    code: str,
    says: str,
    problem: str | None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if "sleep" in code:
        monkeypatch.setattr(drivers, "LIMIT_S", 2.0)
    (tmp_path / "own.py").write_text(code)
    told = found(tmp_path, capsys, monkeypatch, says)
    assert "DG7" not in told if problem is None else problem in told
    assert "DG7" not in found(tmp_path, capsys, monkeypatch, says, "--fast")
