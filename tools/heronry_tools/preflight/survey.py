"""The buses of one spec, as `heronry preflight` hears them: what frames came, and what the PEs there tell by SDO."""

import select
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

from heronry_dg.model import Spec
from heronry_tools.preflight.inputs import WiredInputs
from heronry_tools.reports.findings import Finding
from heronry_tools.runtime.demo.buses import BusChoice
from heronry_tools.runtime.demo.ear import Ear
from heronry_tools.runtime.doctor.asking import ask_tables, assess_tables
from heronry_tools.runtime.doctor.computer import knows_can
from heronry_tools.runtime.doctor.expected import Expected
from heronry_tools.runtime.doctor.expected_by_spec import expected_by_spec
from heronry_tools.runtime.doctor.interface import assess_interface
from heronry_tools.runtime.doctor.listening import (
    BusNamed,
    Hearing,
    assess_beats,
    assess_clock,
    assess_foreign,
    assess_load,
    assess_managers,
    assess_traffic,
    assess_twins,
)
from heronry_wire.bus_opening import LinkError, open_bus
from heronry_wire.can_interface import read_interface


@dataclass(slots=True)
class Survey:
    """Listens to some buses of a spec.

    choices: the buses to listen to, by name. expected: what should be on each of them.
    heard: what was heard, by bus; only buses that could be opened.
    """

    spec: Spec
    choices: Mapping[str, BusChoice]
    expected: dict[str, Expected] = field(init=False)
    heard: dict[str, Hearing] = field(default_factory=dict)
    _ears: dict[str, Ear] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.expected = {name: expected_by_spec(self.spec, name) for name in self.choices}

    def open(self, stack: ExitStack) -> Iterator[Finding]:
        """Open the buses, which `stack` closes; gives findings about interfaces, and about what cannot be opened."""
        for name, choice in self.choices.items():
            yield from self._interfaces(name, choice)
            try:
                self._ears[name] = stack.enter_context(Ear(choice, self.spec.buses[name]))
            except LinkError as error:
                yield Finding("bus", f"{name} is not heard: {error}", f"heronry preflight --help   (--bus {name}=...)")
            else:
                self.heard[name] = Hearing()

    def listen(self, inputs: WiredInputs, until_ns: int) -> None:
        """Listen up to a time of the monotonic clock; `inputs` gets the frames, too."""
        readers = [reader for ear in self._ears.values() for reader in ear.readers]
        while (left_ns := until_ns - time.monotonic_ns()) > 0:
            select.select(readers, [], [], min(left_ns / 1e9, 0.1))
            for name, ear in self._ears.items():
                self.heard[name].clocks(time.time_ns(), time.monotonic_ns())
                for t_ns, frame in ear.hear():
                    self.heard[name].take(frame, t_ns)
                    inputs.take(name, t_ns, frame)

    def findings(self, seconds: float) -> Iterator[Finding]:
        """Return findings about what was heard in `seconds`; PEs are left out (`pes_heard`)."""
        main = self.spec.manager.bus
        for name, heard in self.heard.items():
            named, expected = self._named(name), self.expected[name]
            of_bus = [assess_traffic(heard, seconds, named), *assess_twins(heard)]
            if name == main:
                of_bus += [assess_managers(heard, named), *assess_beats(heard, expected)]
            of_bus += [*assess_load(heard, expected, seconds), *assess_foreign(heard, expected, seconds)]
            yield from (replace(one, says=f"{name}: {one.says}") for one in of_bus)
        for name in self.spec.buses:
            if name not in self.choices:
                yield Finding("bus", f"{name}: is not heard here, and judged by the manager; --bus {name}=... names it")
        if main in self.heard:
            yield assess_clock(self.heard[main])

    def pes_unheard(self) -> dict[str, str]:
        """Return the PEs that the heard buses should carry and that were not heard, each with what to type."""
        carried = {pe: name for name in self.heard for pe in self.expected[name].pes.values()}
        nodes = {node for heard in self.heard.values() for node in heard.incarnations}
        return {
            pe: self._named(name).start_agents(f"on the computer of {pe}")
            for pe, name in carried.items()
            if self.spec.pes[pe].node_id not in nodes
        }

    def tables(self) -> Iterator[tuple[Finding, frozenset[str]]]:
        """Ask the PEs that were heard for their tables; gives findings, each with the PEs that have another table."""
        for name, heard in self.heard.items():
            expected = self.expected[name]
            asked = heard.incarnations.keys() & (expected.asked or frozenset())
            if not asked:
                continue
            answers = ask_tables(open_bus(self.choices[name].configs()[0]).bus, asked)
            told = {} if answers is None else answers
            wrong = {expected.pes[node] for node, one in told.items() if one and not one.is_of(self.spec.digest)}
            for finding in assess_tables(answers, expected):
                yield replace(finding, says=f"{name}: {finding.says}"), frozenset(wrong)

    def _interfaces(self, name: str, choice: BusChoice) -> Iterator[Finding]:
        if choice.interface == "socketcan" and knows_can():
            for config in choice.configs():
                interface = str(config["channel"])
                yield from assess_interface(interface, read_interface(interface), self.expected[name].bitrate)

    def _named(self, name: str) -> BusNamed:
        return BusNamed(self.choices[name].interface, self.choices[name].channel)
