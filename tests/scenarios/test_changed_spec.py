"""A manager is restarted with a changed spec while the PEs fly with the tables of the old one: nothing may stop.

When the PEs have been restarted with new tables, one after the other, the manager commands the new spec.
"""

from dataclasses import dataclass, field

import pytest

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_manager import events
from heronry_manager.core.vocabulary import AskStatus, FailElement, SetPriority
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.disk import Disk
from heronry_tools.sim.world.planning import prepared
from heronry_wire.authentication import Key
from heronry_wire.identifiers import FIRST_MANAGER
from scenarios.flights import KEY, MS, elevator_and_chute, flying

S = 1000 * MS
LONGEST_PERIOD_NS = 100 * MS
KEYS = pytest.mark.parametrize("key", [None, KEY], ids=["without a key", "with a key"])


def changed() -> Spec:
    """The same aircraft, with one priority changed."""
    text = shipped_spec_path("elevator_and_chute").read_text()
    other = text.replace("priority: 20", "priority: 21")
    assert other != text
    return loads(other, "elevator_and_chute.dg.yaml")


@dataclass
class Silence:
    """The longest silence of each identifier that the PEs sent in the last second before the watch began."""

    simulation: Simulation
    last_ns: dict[int, int] = field(default_factory=dict)
    longest_ns: dict[int, int] = field(default_factory=dict)

    def begin(self) -> None:
        for bus in self.simulation.wiring.buses.values():
            self.simulation.wiring.tap(bus.name, self.take)
        self.simulation.run_for(1 * S)
        self.longest_ns = dict.fromkeys(self.last_ns, 0)

    def take(self, sent: Sent) -> None:
        identifier = sent.frame.can_id
        if 300 <= identifier < 1800:  # normal operation data (CANaerospace)
            now_ns = self.simulation.now_ns
            if identifier in self.longest_ns:
                self.longest_ns[identifier] = max(self.longest_ns[identifier], now_ns - self.last_ns[identifier])
            self.last_ns[identifier] = now_ns

    def longest(self) -> int:
        ages = {one: self.simulation.now_ns - at_ns for one, at_ns in self.last_ns.items()}
        return max(max(self.longest_ns[one], ages[one]) for one in self.longest_ns)


def restart_with(simulation: Simulation, spec: Spec) -> None:
    """Restart the manager with another spec, as `--changed-spec` does: only the numbers of its journal stay."""
    managers = simulation.managers
    managers.kill(FIRST_MANAGER)
    disk = Disk(spec)
    for record in managers.disks[FIRST_MANAGER].opened().numbers().records():
        disk.write(record, simulation.now_ns)
    managers.disks[FIRST_MANAGER] = disk
    managers._first = spec, prepared(spec, None)
    simulation.run_for(200 * MS)
    managers.start(FIRST_MANAGER)


@KEYS
def test_what_flies_goes_on_until_every_pe_has_a_new_table(key: Key | None) -> None:
    old, new = elevator_and_chute(), changed()
    simulation = flying(old, 3, key=key)
    silence = Silence(simulation)
    silence.begin()
    assert silence.last_ns
    told = len(simulation.managers.events)
    restart_with(simulation, new)
    simulation.run_for(10 * S)
    manager = simulation.managers.running[FIRST_MANAGER]

    assert silence.longest() < 2 * LONGEST_PERIOD_NS
    assert manager.core.is_active
    assert manager.core.plan is None
    since = simulation.managers.events[told:]
    assert {one.pe for one in since if isinstance(one, events.AnotherTable)} == set(old.pes)
    assert not [one for one in since if isinstance(one, events.PeLost)]
    status = manager.say(AskStatus()).status
    assert status is not None
    assert set(status["other_tables"]) == set(old.pes)
    assert all("heronry table" in why and "goes on" in why for why in status["other_tables"].values())
    assert not any(pe["losses"] for pe in status["pes"].values())

    for number, pe in enumerate(old.pes):
        assert manager.core.plan is None
        assert len(manager.say(AskStatus()).status["other_tables"]) == len(old.pes) - number  # type: ignore[index]
        simulation.fleet.kill(pe)
        simulation.fleet.tables = {**simulation.fleet.tables, pe: prepared(new, None).tables[pe]}
        simulation.run_for(300 * MS)
        simulation.fleet.restore(pe)
        simulation.run_for(1 * S)
    assert manager.core.plan is not None
    assert all(one.served for one in manager.core.plan.functions.values())
    assert not manager.say(AskStatus()).status["other_tables"]  # type: ignore[index]


def test_a_pe_that_keeps_the_old_table_can_be_given_up_by_the_operator() -> None:
    old, new = elevator_and_chute(), changed()
    simulation = flying(old, 3)
    restart_with(simulation, new)
    *others, last = old.pes
    for pe in others:
        simulation.fleet.kill(pe)
        simulation.fleet.tables = {**simulation.fleet.tables, pe: prepared(new, None).tables[pe]}
    simulation.run_for(300 * MS)
    for pe in others:
        simulation.fleet.restore(pe)
    simulation.run_for(2 * S)
    manager = simulation.managers.running[FIRST_MANAGER]
    assert manager.core.plan is None
    refused = manager.say(SetPriority("elevator", 90))
    assert not refused.done
    assert last in refused.sentence
    assert manager.say(FailElement(f"pe:{last}")).done
    simulation.run_for(2 * S)
    assert manager.core.plan is not None
    assert f"pe:{last}" in manager.core.now.down
