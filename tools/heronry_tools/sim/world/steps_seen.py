"""The reports of a simulated PE about its modules: observed steps, and orders to devices.

Every step of a module that drives an actuator, or is a branch of a DEMUX, is reported with its inputs (`Driven`). Of
all other steps with inputs, every eighth is reported. Every step that leaves out an output of its mode is
reported (`Withheld`). Every command that the PE passes to a device is reported
(`Moved`). After a step, the command to the module's device may come much later, or never. Every state that a module
saves, or from which it starts, is reported (`StateSeen`).
"""

from collections.abc import Mapping
from typing import NamedTuple

from heronry_agent.module import Datum


class Moved(NamedTuple):
    """A PE has passed the command of a module to the module's device."""

    t_ns: int
    pe: str
    module: str


class Withheld(NamedTuple):
    """A step of a module that has left out outputs of its mode.

    missing: the outputs left out. inputs: variables of which the step had a usable datum.
    """

    t_ns: int
    pe: str
    module: str
    missing: frozenset[str]
    inputs: frozenset[str]


class StateSeen(NamedTuple):
    """A module has saved its state (`is_saved`), or has started from a state.

    data: the bytes of the state. code: version of the module's code on this PE, as the simulator knows it. round: in
    which it was saved. age_ns: age of the state from which the module starts, as the module is told.
    """

    t_ns: int
    pe: str
    module: str
    is_saved: bool
    data: bytes
    code: str
    round: int
    age_ns: int = 0


class Driven(NamedTuple):
    """A step of a module, with its inputs.

    t_ns: when the step was executed
    inputs: (variable, datum) for each leaf, by the path of the leaf in the mode's `needs`
    asked_ns: when the core requested the step, and read its inputs
    """

    t_ns: int
    pe: str
    module: str
    inputs: Mapping[str, tuple[str, Datum]]
    asked_ns: int
