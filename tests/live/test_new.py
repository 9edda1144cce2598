"""`heronry new`: what it writes works at once, by the three commands that it prints."""

import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from heronry_tools.cli import main
from heronry_tools.commands.new import next_commands
from heronry_tools.runtime.new_project.project import write_project
from thoroughness import mostly_soak

pytestmark = pytest.mark.live

ROOT = Path(__file__).resolve().parents[2]


def here(_: Path) -> Path:
    return Path(sys.executable)


def fresh(folder: Path) -> Path:
    """A virtual environment with nothing but heronry and what it needs."""
    venv.create(folder / "fresh", with_pip=True)
    python = folder / "fresh/bin/python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", f"{ROOT}[manager]"], check=True)
    return python


@pytest.mark.parametrize("environment", mostly_soak([here, fresh], [here]))
def test_a_new_project_is_checked_flown_and_tested_by_the_commands_that_are_printed(
    environment: object, tmp_path: Path
) -> None:
    assert callable(environment)
    python = environment(tmp_path)
    path = os.pathsep.join([str(python.parent), "/usr/bin", "/bin"])
    own = {"PATH": path, "HOME": str(tmp_path)}
    words = [str(python), "-m", "heronry_tools.cli", "new", "first_node", "--json"]
    told = json.loads(subprocess.run(words, cwd=tmp_path, env=own, capture_output=True, check=True).stdout)
    said = []
    assert len(told["commands"]) == 3
    for command in told["commands"]:
        done = subprocess.run(
            ["sh", "-c", command.replace("--for 10", "--for 3 --no-kill")],
            cwd=tmp_path,
            env=own,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        said.append(done.stdout + done.stderr)
    assert "no findings" in said[0] or "1 spec checked" in said[0]
    assert "heard on the bus at the end: cooling" in said[1]
    assert "OK" in said[2]


def test_its_own_driver_reads_while_the_rest_is_simulated(tmp_path: Path) -> None:
    write_project("first_node", tmp_path)
    (tmp_path / "temp").write_text("50000\n")
    real = {"thermometer": {"driver": "first_node.drivers:Thermometer", "options": {"file": str(tmp_path / "temp")}}}
    (tmp_path / "real.json").write_text(json.dumps(real))
    words = ["demo", "first_node.dg.yaml", "--devices", str(tmp_path / "real.json"), "--for", "3", "--no-kill"]
    done = subprocess.run(
        [sys.executable, "-m", "heronry_tools", *words],
        cwd=tmp_path / "first_node",
        env=dict(os.environ),
        capture_output=True,
        text=True,
        check=False,
    )
    assert "heard on the bus at the end: cooling" in done.stdout + done.stderr
    assert "has failed" not in done.stdout


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="it needs systemd-analyze(1)")
def test_systemd_knows_all_that_stands_in_its_units(tmp_path: Path) -> None:
    write_project("first_node", tmp_path)
    units = tmp_path / "first_node/units"
    assert "WatchdogSec=" in (units / "heronry-agent@.service").read_text()
    for name in ("heronry-agent@", "heronry-manager@"):
        unit = units / f"{name}.service"
        unit.write_text(unit.read_text().replace("/opt/heronry/bin/", "").replace("ExecStart=", "ExecStart=/bin/true "))
        instance = units / f"{name}left.service"
        instance.symlink_to(unit.name)
        verified = subprocess.run(
            ["systemd-analyze", "verify", "--man=no", str(instance)], capture_output=True, text=True, check=False
        )
        assert (verified.returncode, verified.stderr) == (0, "")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("Glider", "cannot be the name of a Python package"),
        ("1st", "cannot be the name of a Python package"),
        ("../x", "cannot be the name of a Python package"),
        ("class", "cannot be the name of a Python package"),
        ("json", "there is a Python package json already"),
        ("taken", "exists already"),
    ],
)
def test_a_name_that_cannot_be_is_one_sentence_and_nothing_is_written(
    name: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("")
    assert main(["new", name]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert [one.name for one in tmp_path.iterdir()] == ["taken"]


def test_programs_that_the_path_does_not_find_are_printed_with_theirs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    check, _, test = next_commands("glider", tmp_path)
    assert check == f"cd {tmp_path} && {Path(sys.executable).with_name('heronry')} check glider.dg.yaml"
    assert test.endswith(f"{Path(sys.executable).with_name('python')} -m unittest")
