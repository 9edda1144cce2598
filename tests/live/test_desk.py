"""The commands of docs/desk.md, and the files for a node's computer.

In long runs the commands are run as the page has them, on a vcan; in every run, on a software bus in its place.
"""

import configparser
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
from itertools import groupby
from pathlib import Path

import pytest

from lab.slow_spec import slow_spec

ROOT = Path(__file__).resolve().parents[2]
DEPLOYMENT = ROOT / "tools" / "heronry_tools" / "runtime" / "deployment"
PATIENCE_S = 240
END_ALL = "trap 'kill $(jobs -p); wait' EXIT"  # whichever step fails: a process that still writes keeps the pipe open


def steps() -> list[str]:
    """The lines of the page's sh blocks but those that install."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", (ROOT / "docs" / "desk.md").read_text(), re.MULTILINE | re.DOTALL)
    return [line for block in blocks[1:] for line in block.splitlines()]


def end_of_the_page(lines: list[str], tmp_path: Path) -> str:
    """What a shell says that is given these lines."""
    script = subprocess.Popen(
        ["bash", "-e"],
        cwd=tmp_path,
        env={
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "XDG_STATE_HOME": str(tmp_path),
            "XDG_RUNTIME_DIR": str(tmp_path),
        },
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        process_group=0,
    )
    try:
        said, _ = script.communicate("\n".join([END_ALL, *lines]), timeout=PATIENCE_S)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(script.pid, signal.SIGKILL)
    return said


def assert_is_fit(said: str) -> None:
    assert "this node is fit" in said, said
    assert "all 3 PEs have tables of one spec" in said
    assert "one manager is active: 126" in said


@pytest.mark.vcan
@pytest.mark.soak
@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("ip") is None, reason="making an interface needs root and ip(8)")
def test_the_desk_page_ends_in_a_green_doctor(tmp_path: Path) -> None:
    spec = slow_spec("elevator_and_chute", tmp_path, heartbeat_ms=500, rates_divided_by=4)  # for a user-mode Linux
    subprocess.run(["ip", "link", "del", "vcan0"], check=True)  # the page makes its own
    try:
        said = end_of_the_page([line.replace("elevator_and_chute", str(spec)) for line in steps()], tmp_path)
    finally:
        if not Path("/sys/class/net/vcan0").exists():
            subprocess.run(["ip", "link", "add", "vcan0", "type", "vcan"], check=True)
        subprocess.run(["ip", "link", "set", "vcan0", "up"], check=True)
    assert_is_fit(said)


@pytest.mark.live
def test_the_desk_page_on_a_software_bus_ends_in_a_green_doctor(tmp_path: Path) -> None:
    bus, *rest = [list(lines) for _, lines in groupby(steps(), lambda line: line.startswith("ip link "))]
    assert len(bus) == 2
    page = (ROOT / "docs" / "desk.md").read_text()
    for instead in ("`heronry softbus &`", "`-i softbus -c can0`"):
        assert instead in page
    lines = [line.replace("-i socketcan -c vcan0", "-i softbus -c can0") for part in rest for line in part]
    assert not [line for line in lines if "vcan" in line]
    said = end_of_the_page(["heronry softbus &", *lines], tmp_path)
    assert_is_fit(said)
    stamped = [line for line in said.splitlines() if re.match(r"\d\d:\d\d:\d\d\.\d{3} ", line)]
    assert any("can0: 1000000 bit/s" in line for line in stamped), "the bus has the clock of all lines"
    assert any("manager 126 on can0" in line for line in stamped), "the manager, too"


@pytest.mark.live
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="it needs systemd-analyze(1)")
@pytest.mark.parametrize("unit", ["heronry-agent@.service", "heronry-manager@.service"])
def test_systemd_finds_nothing_wrong_with_a_unit(unit: str, tmp_path: Path) -> None:
    """With a program in place of ours, which is not installed under /opt here."""
    instance = tmp_path / unit.replace("@", "@nav")
    instance.write_text(re.sub(r"/opt/heronry/bin/[a-z-]+", "/bin/true", (DEPLOYMENT / unit).read_text()))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(instance)], capture_output=True, text=True, check=False
    )
    assert [line for line in done.stderr.splitlines() if instance.name in line] == []


@pytest.mark.parametrize("unit", ["heronry-agent@.service", "heronry-manager@.service"])
def test_the_command_line_of_a_unit_is_one_that_the_program_takes(unit: str) -> None:
    parser = configparser.ConfigParser(interpolation=None, strict=False)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(DEPLOYMENT / unit)
    service = parser["Service"]
    assert (service["Type"], service["Restart"]) == ("notify", "always")
    program, *arguments = service["ExecStart"].split()
    module = ["heronry_agent"] if program.endswith("pe-agent") else ["heronry_tools.cli", arguments.pop(0)]
    help_text = subprocess.run(
        [sys.executable, "-m", *module, "--help"], capture_output=True, text=True, check=True
    ).stdout
    assert {word for word in arguments if word.startswith("--")} <= set(re.findall(r"--[a-z-]+", help_text))
