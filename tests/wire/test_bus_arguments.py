"""Which bus is meant, and what is said where that is not clear."""

import re

import pytest

from heronry_wire.bus_arguments import BusArgumentError, named_buses

BUSES = ("can0", "radio")


def test_only_a_known_interface_counts_as_one() -> None:
    texts = ["can0=socketcan:can7", "radio=/tmp/a:b.sock"]
    assert named_buses(texts, "the spec", BUSES) == {"can0": ("socketcan", "can7"), "radio": (None, "/tmp/a:b.sock")}


@pytest.mark.parametrize(
    ("texts", "sentence"),
    [
        (["wlan=x"], "--bus wlan: the spec has no such bus; it has can0, radio"),
        (["can0"], "--bus can0: write it as NAME=[INTERFACE:]CHANNEL, such as can0=socketcan:can0"),
        (["can0=x", "can0=y"], "--bus can0 is given twice; name one channel"),
    ],
)
def test_what_names_no_bus_is_one_clear_sentence(texts: list[str], sentence: str) -> None:
    with pytest.raises(BusArgumentError, match=re.escape(sentence)):
        named_buses(texts, "the spec", BUSES)
