"""The driver gpsd against Debian's gpsd, whose receiver is gpsfake."""

import shutil
import time
from pathlib import Path

import pytest

from heronry_agent.device_driver import Measured, NotConnectedError, Setup, checked_options
from heronry_agent.drivers.gpsd import Gpsd
from lab import real_gpsd

pytestmark = [
    pytest.mark.live,
    pytest.mark.skipif(shutil.which("apt-get") is None, reason="no apt-get to fetch Debian's gpsd"),
]
PATIENCE_S = 60.0


def read_for_ever(driver: Gpsd) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        driver.read()


def test_positions_of_gpsfake_come_through_gpsd_and_its_end_is_told(tmp_path: Path) -> None:
    with real_gpsd.faked(tmp_path, 300.0) as daemon:
        driver = Gpsd(Setup("receiver", checked_options(Gpsd.OPTIONS, {"port": daemon.port}), 1))
        end_s = time.monotonic() + PATIENCE_S
        while (found := driver.read()) is None or found.value[3] < 0:
            assert time.monotonic() < end_s
        assert isinstance(found, Measured)
        assert found.value == (380000000, -845000000, 300000, 9000000)
        daemon.kill()
        with pytest.raises((NotConnectedError, OSError)):
            read_for_ever(driver)
        driver.close()
