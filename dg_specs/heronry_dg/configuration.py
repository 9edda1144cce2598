"""A configuration: which modules run, each in one mode on one PE, and what each of their inputs is wired to.

A configuration is only a value: `verify` tells whether it is legal, and `objective` how good it is.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from heronry_dg.model import Mode, Spec


@dataclass(frozen=True, slots=True)
class Wire:
    """What an input is wired to: a variable of a running producer, in the version that the producer's mode gives."""

    producer: str
    variable: str
    version: int


@dataclass(frozen=True, slots=True)
class Running:
    """One running module: its PE, its mode, and the wires of its inputs."""

    pe: str
    mode: str
    inputs: Mapping[str, Wire] = field(default_factory=dict)  # leaf path -> wire, for the leaves that are wired


@dataclass(frozen=True, slots=True)
class Configuration:
    """The running modules, by name, each with its PE, its mode and its wires."""

    modules: Mapping[str, Running] = field(default_factory=dict)

    def mode(self, spec: Spec, module: str) -> Mode:
        """Mode in which a running module runs."""
        return spec.modules[module].modes[self.modules[module].mode]

    def wires(self) -> Iterator[tuple[str, str, Wire]]:
        """Yield every wire as (consumer, leaf path, wire)."""
        for consumer, running in self.modules.items():
            for path, wire in running.inputs.items():
                yield consumer, path, wire
