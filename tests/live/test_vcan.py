"""On a kernel that has a vcan0: python-can, can-utils and tools/with-vcan meet on the same bus."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import can
import pytest

pytestmark = pytest.mark.vcan

ROOT = Path(__file__).resolve().parents[2]
WITH_VCAN = [sys.executable, str(ROOT / "tools" / "with-vcan")]


def test_cansend_reaches_python_can() -> None:
    with can.Bus("vcan0", interface="socketcan") as bus:
        subprocess.run(["cansend", "vcan0", "12C#0102FF"], check=True)
        message = bus.recv(10)
    assert message is not None
    assert (message.arbitration_id, message.is_extended_id, bytes(message.data)) == (0x12C, False, b"\x01\x02\xff")


def test_python_can_reaches_candump() -> None:
    candump = subprocess.Popen(["candump", "-n", "1", "-L", "vcan0"], stdout=subprocess.PIPE)
    assert candump.stdout is not None
    with candump.stdout, can.Bus("vcan0", interface="socketcan") as bus:
        wanted = can.Message(arbitration_id=0x1ABCDEF0, is_extended_id=True, data=b"\xca\xfe")
        while candump.poll() is None:  # candump does not say when it has begun to listen
            bus.send(wanted)
            bus.recv(0.01)
        assert candump.stdout.read().endswith(b" vcan0 1ABCDEF0#CAFE\n")


def test_with_vcan_uses_the_interface_that_is_there_and_leaves_it() -> None:
    with can.Bus("vcan0", interface="socketcan") as bus:
        subprocess.run([*WITH_VCAN, "cansend", "vcan0", "001#"], check=True)
        assert bus.recv(10) is not None
    assert Path("/sys/class/net/vcan0").exists()


@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("ip") is None, reason="making an interface needs root and ip(8)")
def test_with_vcan_makes_what_is_missing_and_removes_it() -> None:
    listing = [*WITH_VCAN, "--interfaces", "vcan0,vcan9", "ls", "/sys/class/net"]
    assert b"vcan9" in subprocess.run(listing, check=True, capture_output=True).stdout.split()
    assert not Path("/sys/class/net/vcan9").exists()
