"""A manager starts while its journal has every PE in quarantine: there is no PE to command."""

from heronry_manager import events
from scenarios.flights import MS, flying, two_tails


def test_a_mastership_begins_while_every_pe_is_held_down() -> None:
    simulation = flying(two_tails())
    for wait_ns in (1_200 * MS, 1_200 * MS, 1_200 * MS, 0):
        for pe in simulation.spec.pes:  # one after the other: a manager that hears no PE at all sends nothing
            simulation.fleet.kill(pe)
            simulation.run_for(100 * MS)
            simulation.fleet.restore(pe)
            simulation.run_for(50 * MS)
        simulation.run_for(wait_ns)
    simulation.managers.kill()
    simulation.run_for(100 * MS)
    simulation.managers.start()
    assert simulation.settle() == []
    first = [told for told in simulation.events_of(events.Reconfigured) if told.causes == ("a mastership begins",)]
    assert [told.times_ns.detect for told in first] == [0]
