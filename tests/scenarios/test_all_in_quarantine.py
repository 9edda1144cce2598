"""A manager that starts anew while every PE is in quarantine, which it remembers: nobody to command, and no cause."""

from scenarios.flights import MS, flying, two_tails


def test_a_reign_begins_while_everybody_is_held_down() -> None:
    simulation = flying(two_tails())
    for _ in range(3):
        for pe in simulation.spec.pes:
            simulation.kill(pe)
        simulation.run_for(100 * MS)
        for pe in simulation.spec.pes:
            simulation.restore(pe)
        simulation.run_for(1_200 * MS)
    for pe in simulation.spec.pes:
        simulation.kill(pe)
    simulation.run_for(100 * MS)
    for pe in simulation.spec.pes:
        simulation.restore(pe)
    simulation.run_for(100 * MS)
    simulation.kill_manager()
    simulation.run_for(100 * MS)
    simulation.start_manager()
    assert simulation.settle() == []
    of_nothing = [told for told in simulation.events_of("reconfigured") if not told["causes"]]
    assert [told["times_ns"]["detect"] for told in of_nothing] == [0]
