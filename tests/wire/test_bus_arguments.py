"""Which bus a command line names, and the message where it names none."""

import re
from pathlib import Path

import can
import pytest

from heronry_wire.bus_arguments import BusArgumentError, channel_configs, channels_named, named_buses

BUSES = ("can0", "radio")


def test_only_a_known_interface_counts_as_one() -> None:
    texts = ["can0=socketcan:can7", "radio=/tmp/a:b.sock"]
    assert named_buses(texts, "the spec", BUSES) == {"can0": ("socketcan", "can7"), "radio": (None, "/tmp/a:b.sock")}


@pytest.mark.parametrize(
    ("texts", "sentence"),
    [
        (["wlan=x"], "--bus wlan: the spec has no such bus; it has can0, radio"),
        (["can0"], "--bus can0: write it as NAME=[INTERFACE:]CHANNEL, such as can0=socketcan:can0"),
        (["can0=x", "can0=y"], "--bus can0 is given twice; give it once"),
    ],
)
def test_what_names_no_bus_is_one_clear_sentence(texts: list[str], sentence: str) -> None:
    with pytest.raises(BusArgumentError, match=re.escape(sentence)):
        named_buses(texts, "the spec", BUSES)


def test_the_channels_of_a_replicated_bus_are_named_with_a_comma_and_may_be_of_different_kinds() -> None:
    config = {"interface": "socketcan", "channel": "can0, slcan:/dev/ttyUSB0", "bitrate": 500_000}
    assert channel_configs(config, 2, "bus main") == [
        {"interface": "socketcan", "channel": "can0", "bitrate": 500_000},
        {"interface": "slcan", "channel": "/dev/ttyUSB0", "bitrate": 500_000},
    ]
    assert channels_named(config) == 2


def test_of_a_bus_with_one_channel_a_comma_is_part_of_its_name() -> None:
    config = {"interface": "softbus", "channel": "/tmp/a,b.sock"}
    assert channel_configs(config, 1, "bus main") == [config]
    assert channels_named({}) == 1


@pytest.mark.parametrize("channel", ["can0", "can0,", "can0,can0", "can0,can1,can2"])
def test_anything_but_both_is_one_clear_sentence(channel: str) -> None:
    with pytest.raises(
        BusArgumentError, match=r"bus main has 2 channels, and '.*' names [13]; name both .* -c can0,can1"
    ):
        channel_configs({"interface": "socketcan", "channel": channel}, 2, "bus main")


def test_where_no_flag_says_it_the_configuration_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "can.conf"
    file.write_text("[default]\ninterface = socketcan\nchannel = can3,can4\n")
    monkeypatch.setattr(can.util, "CONFIG_FILES", [str(file)])
    assert [config["channel"] for config in channel_configs({}, 2, "the bus")] == ["can3", "can4"]
    monkeypatch.setattr(can.util, "CONFIG_FILES", [])
    monkeypatch.delenv("CAN_INTERFACE", raising=False)
    with pytest.raises(BusArgumentError, match="'' names 0"):
        channel_configs({}, 2, "the bus")
    with pytest.raises(BusArgumentError, match="'' names 0"):
        channel_configs({"interface": "nonsense"}, 2, "the bus")
