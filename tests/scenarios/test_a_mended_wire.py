"""A PE that was not heard for a while is heard again at the moment when other PEs have taken over its modules."""

import pytest

from heronry_agent.core.table_index import TableIndex
from heronry_tools.sim.world.bus import Sent
from heronry_tools.sim.world.planning import prepared
from heronry_wire.identifiers import FIRST_MANAGER, Command, management_id
from scenarios.flights import MS, big_blue, flying

ACTIVATE = management_id(FIRST_MANAGER, Command.ACTIVATE)


@pytest.mark.parametrize("seed", range(3))
def test_a_pe_that_was_replaced_while_its_transmitter_failed_sends_no_frame_that_it_had_queued(seed: int) -> None:
    """The manager decides immediately: the PE has not received ALIVE yet when its wire is mended, at GO_ALL."""
    index = TableIndex(prepared(big_blue(), None).tables["nav"])
    identifiers = index.identifiers(index.movable)
    simulation = flying(big_blue(), seed, decide_ns=MS)
    sent: list[Sent] = []
    simulation.wiring.tap("can0", sent.append)
    nav = simulation.fleet.running["nav"]
    simulation.run_for(200 * MS)
    assert identifiers & {one.frame.can_id for one in sent if one.sender == "nav"}
    nav.wire(transmit_failed=True)
    sent.clear()
    while not any(one.frame.can_id == ACTIVATE for one in sent):
        simulation.run_for(MS // 10)
    nav.wire(transmit_failed=False)
    simulation.run_for(100 * MS)
    assert not identifiers & {one.frame.can_id for one in sent if one.sender == "nav"}
