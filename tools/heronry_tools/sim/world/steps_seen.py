"""What a simulated PE reports of its modules: each step that is observed, and each order to a device.

Every step of a module that drives an actuator or is a branch of a DEMUX is reported (`Driven`), with its inputs, and of
all other steps every eighth; and every order that its PE gives to a device (`Moved`), which may come much later than
the step, or never.
"""

from collections.abc import Mapping
from typing import NamedTuple

from heronry_agent.module import Datum


class Moved(NamedTuple):
    """A PE lets the device of a module move."""

    t_ns: int
    pe: str
    module: str


class Driven(NamedTuple):
    """A module was stepped: one that drives an actuator, a branch of a DEMUX, or any other.

    asked_ns: when the core requested the step, and looked at its inputs.
    """

    t_ns: int
    pe: str
    module: str
    inputs: Mapping[str, tuple[str, Datum]]
    asked_ns: int
