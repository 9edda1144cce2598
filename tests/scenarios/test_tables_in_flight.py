"""Tables are brought in flight: on a bus at half load and over a radio, and no datum comes later than its deadline."""

from collections import defaultdict
from itertools import pairwise

import pytest

from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.traffic import identifiers
from heronry_manager import events
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.identifiers import sdo_request_id

BIG_BLUE = load(shipped_spec_path("big_blue"))
OTHERS = "{identifier: 400, bytes: 8, period_ms: 0.27}"  # 135 bits in 0.27 ms: half of 1 Mbit/s
ELEVATOR = shipped_spec_path("elevator_and_chute").read_text()
AT_HALF_LOAD = loads(
    ELEVATOR.replace("can0: {bitrate: 1000000", f"can0: {{bitrate: 1000000, foreign: [{OTHERS}]"), "half.dg.yaml"
)


def flying(spec: Spec) -> Simulation:
    simulation = Simulation(spec, 2, brings_tables=True, keep_trace=True)
    while not simulation.events_of(events.Reconfigured) or simulation.unsettled():
        simulation.run_for(50 * MS)
        assert simulation.now_ns < 20_000 * MS
    return simulation


def replace_by_a_blank_one(simulation: Simulation, pe: str) -> events.TableBrought:
    simulation.fleet.kill(pe)
    simulation.fleet.make_blank(pe)
    simulation.run_for(1_000 * MS)
    simulation.fleet.restore(pe)
    for _ in range(200):
        simulation.run_for(100 * MS)
        brought = simulation.events_of(events.TableBrought)
        if brought:
            return brought[-1]
    raise AssertionError(simulation.events_of(events.TableNotTaken))


def latest_ns(simulation: Simulation, pe: str) -> dict[str, int]:
    """How long after its deadline each datum came during the transfer; the negative of that where it came earlier.

    Two frames of a source are at most a period and a deadline apart if each meets its deadline.
    """
    spec = simulation.spec
    request = sdo_request_id(spec.pes[pe].node_id)
    segments = [sent.end_ns for sent in simulation.trace if sent.frame.can_id == request]
    begin_ns, end_ns = segments[0], segments[-1]
    rates = {one: max(mode.rate_mhz for mode in spec.modules[one[0]].modes.values()) for one in identifiers(spec)}
    period_ns = {number: 10**12 // rates[one] for one, number in identifiers(spec).items()}
    deadline_ns = {number: spec.variables[one[1]].deadline_ns for one, number in identifiers(spec).items()}
    times = defaultdict(list)
    for sent in simulation.trace:
        if begin_ns <= sent.end_ns <= end_ns and sent.frame.can_id in period_ns:
            times[sent.frame.can_id, sent.bus, sent.sender].append(sent.end_ns)
    return {
        f"{number} on {bus}": max(b - a for a, b in pairwise(found))
        - period_ns[number]
        - (deadline_ns[number] or period_ns[number])
        for (number, bus, _), found in times.items()
        if len(found) > 1
    }


@pytest.mark.parametrize(("spec", "pe"), [(AT_HALF_LOAD, "tail_pe"), (BIG_BLUE, "payload"), (BIG_BLUE, "ground")])
def test_no_datum_misses_its_deadline_while_a_table_is_brought(spec: Spec, pe: str) -> None:
    simulation = flying(spec)
    told = replace_by_a_blank_one(simulation, pe)
    late = latest_ns(simulation, pe)
    assert late
    assert max(late.values()) <= 0, late
    assert told.took_ns < 8_000 * MS
    assert simulation.broken() == []


@pytest.mark.parametrize("key", [None, pytest.param(Key(bytes(KEY_BYTES)), marks=pytest.mark.soak)])
def test_nine_nodes_with_nothing_but_a_node_id_fly_big_blue(key: Key | None) -> None:
    simulation = Simulation(BIG_BLUE, 1, brings_tables=True, key=key)
    for pe in BIG_BLUE.pes:
        simulation.fleet.make_blank(pe)
    simulation.run_for(16_000 * MS)
    assert sorted(one.pe for one in simulation.events_of(events.TableBrought)) == sorted(BIG_BLUE.pes)
    assert simulation.settle() == []
    assert not simulation.events_of(events.TableNotTaken)
    assert not simulation.events_of(events.PeLost)
