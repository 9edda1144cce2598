"""A configuration encoded as a row of bytes: numbers that are indices into the spec; a small number takes one byte.

    for each module of the spec   0: it does not run; else 1 + mode x (number of PEs) + PE
    for each leaf of its mode     0: it is not wired; else 1 + producer

Variable and version of a wire follow from the leaf and from the producer's mode. Equal configurations have equal rows.
A row has a meaning only together with the spec's digest.
"""

from collections.abc import Mapping, Sequence
from typing import TypeVar

from heronry_dg.configuration import Configuration, Running, Wire
from heronry_dg.gates import Leaf
from heronry_dg.model import Mode, Spec
from heronry_dg.objective import Objective
from heronry_wire.packing import PackingError, Unpacker, pack

_T = TypeVar("_T")


class ConfigurationCode:
    """Encodes configurations of one spec as rows of bytes, and decodes these rows."""

    def __init__(self, spec: Spec) -> None:
        self._pes = list(spec.pes)
        self._modules = list(spec.modules)
        self._modes: dict[str, list[Mode]] = {m.name: list(m.modes.values()) for m in spec.modules.values()}
        self._leaves: dict[tuple[str, str], list[tuple[str, Leaf]]] = {
            (name, mode.name): list(mode.leaves()) for name, modes in self._modes.items() for mode in modes
        }
        self._pe_index = {pe: index for index, pe in enumerate(self._pes)}
        self._module_index = {module: index for index, module in enumerate(self._modules)}
        self._mode_index = {(n, mode.name): i for n, modes in self._modes.items() for i, mode in enumerate(modes)}

    def encode(self, configuration: Configuration) -> bytes:
        """Encode a configuration as a row; every name in the configuration must exist in the spec."""
        numbers: list[int] = []
        for module in self._modules:
            running = configuration.modules.get(module)
            if running is None:
                numbers.append(0)
                continue
            mode_index = self._mode_index[module, running.mode]
            numbers.append(1 + mode_index * len(self._pes) + self._pe_index[running.pe])
            for path, _ in self._leaves[module, running.mode]:
                wire = running.inputs.get(path)
                numbers.append(0 if wire is None else 1 + self._module_index[wire.producer])
        return pack(numbers)

    def decode(self, row: bytes) -> Configuration:
        """Decode a row of `encode`; raises PackingError if the bytes are not a row of this spec."""
        numbers = Unpacker(row)
        places: dict[str, tuple[str, Mode]] = {}
        wired: dict[str, list[int]] = {}
        for module in self._modules:
            number = numbers.number()
            if number:
                mode_index, pe_index = divmod(number - 1, len(self._pes))
                mode = _at(self._modes[module], mode_index)
                places[module] = (self._pes[pe_index], mode)
                wired[module] = [numbers.number() for _ in self._leaves[module, mode.name]]
        if numbers.left():
            raise PackingError("bytes follow the last module of a configuration")
        return Configuration(
            {
                module: Running(pe, mode.name, dict(self._wires(module, mode.name, wired[module], places)))
                for module, (pe, mode) in places.items()
            }
        )

    def _wires(
        self, module: str, mode: str, wired: list[int], places: Mapping[str, tuple[str, Mode]]
    ) -> list[tuple[str, Wire]]:
        wires = []
        for (path, leaf), number in zip(self._leaves[module, mode], wired, strict=True):
            if number:
                producer = _at(self._modules, number - 1)
                if producer not in places or leaf.variable not in places[producer][1].gives:
                    raise PackingError(f"{module} reads from {producer}, which does not give {leaf.variable}")
                wires.append((path, Wire(producer, leaf.variable, places[producer][1].gives[leaf.variable])))
        return wires


def _at(names: Sequence[_T], index: int) -> _T:
    if index >= len(names):
        raise PackingError(
            f"a configuration names entry number {index} of a list in the spec, "
            f"but the list has only {len(names)} entries"
        )
    return names[index]


def worth_of(objective: Objective) -> tuple[int, ...]:
    """Encode the objective of a plan as ten integers, all of them 0 or more."""
    costs = (objective.changes, objective.branches, objective.bus_mbit_per_s, objective.cpu_millis)
    return (*objective.critical, objective.utility, objective.inputs, *costs)


def objective_of(worth: Sequence[int]) -> Objective:
    """Decode the ten integers of `worth_of`; raises PackingError if there are not ten."""
    match worth:
        case [a, b, c, d, utility, inputs, changes, branches, bus, cpu]:
            return Objective((a, b, c, d), utility, inputs, changes, branches, bus, cpu)
        case _:
            raise PackingError(f"the value of a plan has {len(worth)} numbers instead of 10")
