"""Which python-can bus each port uses, from the command line."""

import argparse

from agent.one_pe import GATEWAY_TABLE
from heronry_agent.shell.ports import bus_configs


def test_an_adapter_is_told_the_bit_rate_of_a_cable_and_not_that_of_the_air() -> None:
    flags = argparse.Namespace(interface="socketcan", channel="can0")
    assert bus_configs(GATEWAY_TABLE, flags, ["radio=slcan:/dev/ttyUSB0"]) == [
        [{"interface": "socketcan", "channel": "can0", "bitrate": 1_000_000}],
        [{"interface": "slcan", "channel": "/dev/ttyUSB0"}],
    ]
