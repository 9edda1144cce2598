"""Modules, modes, PEs, buses and variables of a spec as numbers from 0, each kind in the spec's order.

The modes of all modules are numbered in one sequence. A set of modules, modes or PEs is an integer with one bit for
each member.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from heronry_dg.model import Bus, Mode, Module, Pe, Spec
from heronry_dg.situation import elements, places


@dataclass(frozen=True, slots=True)
class Numbering:
    """Maps the modules, PEs, buses, variables and modes of a spec to numbers, and these numbers back to them."""

    spec: Spec
    modules: list[Module]
    pes: list[Pe]
    buses: list[Bus]
    variables: list[str]
    module_number: dict[str, int]
    pe_number: dict[str, int]
    bus_number: dict[str, int]
    variable_number: dict[str, int]
    modes: list[tuple[int, Mode]]  # each with the number of its module
    module_of: list[int]  # by mode
    modes_of: list[list[int]]  # by module
    mode_number: dict[tuple[str, str], int]  # by the names of module and mode


def numbered(spec: Spec) -> Numbering:
    """Number the elements of a spec."""
    modules = list(spec.modules.values())
    modes = [(number, mode) for number, module in enumerate(modules) for mode in module.modes.values()]
    modes_of: list[list[int]] = [[] for _ in modules]
    for number, (module, _) in enumerate(modes):
        modes_of[module].append(number)
    return Numbering(
        spec=spec,
        modules=modules,
        pes=list(spec.pes.values()),
        buses=list(spec.buses.values()),
        variables=list(spec.variables),
        module_number={name: number for number, name in enumerate(spec.modules)},
        pe_number={name: number for number, name in enumerate(spec.pes)},
        bus_number={name: number for number, name in enumerate(spec.buses)},
        variable_number={name: number for number, name in enumerate(spec.variables)},
        modes=modes,
        module_of=[module for module, _ in modes],
        modes_of=modes_of,
        mode_number={(modules[module].name, mode.name): number for number, (module, mode) in enumerate(modes)},
    )


def element_numbers(numbers: Numbering) -> dict[str, tuple[str, int]]:
    """Return (kind, number) of every element that can be down, by the name of the element.

    A channel has the number of its bus. A place has the number M * P + N: M is the number of the module, N the number
    of the PE, and P the count of all PEs.
    """
    of_kind: dict[str, Mapping[str, int]] = {
        "pe": numbers.pe_number,
        "module": numbers.module_number,
        "bus": numbers.bus_number,
        "device": {name: number for number, name in enumerate(numbers.spec.devices)},
        "channel": {},
    }
    found = {}
    for element in elements(numbers.spec):
        kind, _, name = element.partition(":")
        number = numbers.bus_number[name.rpartition(".")[0]] if kind == "channel" else of_kind[kind][name]
        found[element] = (kind, number)
    for module, first in numbers.module_number.items():
        for place in places(numbers.spec, module):
            found[place] = ("place", first * len(numbers.pes) + numbers.pe_number[place.partition("@")[2]])
    return found
