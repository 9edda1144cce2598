"""With a key: whatever happens to one TAG, nonce or WELCOME, every PE is available again, and no other PE is lost."""

import pytest

from heronry_manager import events
from heronry_tools.sim.flight.simulation import Simulation
from heronry_tools.sim.world.bus import Sent, Tampering
from heronry_wire.identifiers import FIRST_MANAGER, Command, management_id, state_id
from heronry_wire.management import Control, Operation, decode_command
from scenarios.flights import KEY, MS, flying, two_tails
from thoroughness import sample

TAG = management_id(FIRST_MANAGER, Command.TAG)
CONTROL = management_id(FIRST_MANAGER, Command.CONTROL)
ASKS = 0x80  # page 2 of a state


def reboot(simulation: Simulation) -> None:
    """A PE is back before it is missed: it is welcomed anew, and a new epoch is deployed."""
    simulation.fleet.kill("tail_pe")
    simulation.run_for(3 * MS)
    simulation.fleet.restore("tail_pe")
    simulation.run_for(500 * MS)


def recorded() -> list[Sent]:
    """Frames from the reboot on, up to the end of what follows from it."""
    simulation = flying(two_tails(), key=KEY, keep_trace=True)
    before_ns, known = simulation.now_ns, len(simulation.events_of(events.Reconfigured))
    reboot(simulation)
    done = simulation.events_of(events.Reconfigured)[known:]
    assert done
    return [sent for sent in simulation.trace if before_ns < sent.end_ns <= done[-1].t_ns]


def is_welcome(sent: Sent) -> bool:
    """Tell whether a frame answers a nonce."""
    if sent.frame.can_id != CONTROL:
        return False
    order = decode_command(Command.CONTROL, sent.frame.data)
    return isinstance(order, Control) and order.operation is Operation.WELCOME


def is_nonce(sent: Sent) -> bool:
    """Tell whether a frame is a page 2, with which a PE asks for a welcome."""
    return sent.frame.can_id in map(state_id, (92, 93, 94)) and sent.frame.data[0] & 0xC0 == ASKS


def ends_well(frame: Sent, tampering: Tampering) -> list[object]:
    """What is wrong at the end of a flight in which one frame was tampered with."""
    simulation = flying(two_tails(), key=KEY)
    simulation.wiring.tamper(frame, tampering)
    reboot(simulation)
    return [*simulation.settle(), *(told for told in simulation.events_of(events.PeLost) if told.pe != "tail_pe")]


@pytest.mark.parametrize("copies", [0, 2], ids=["lost", "doubled"])
def test_a_tag_a_nonce_or_a_welcome_is_lost_or_doubled(copies: int) -> None:
    aimed = [sent for sent in recorded() if sent.frame.can_id == TAG or is_welcome(sent) or is_nonce(sent)]
    assert len(aimed) > 20
    wrong = {sent: found for sent in sample(aimed[:: 1 + copies]) if (found := ends_well(sent, Tampering(copies)))}
    assert wrong == {}
