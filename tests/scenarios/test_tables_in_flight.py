"""Tables are brought in flight: on a bus at half load and over a radio, and no datum comes later than its deadline."""

import pytest

from heronry_dg.loader import load, loads
from heronry_dg.model import Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.traffic import identifiers
from heronry_manager import events
from heronry_tools.sim.flight.simulation import MS, Simulation
from heronry_tools.sim.world.bus import SimulatedBus
from heronry_tools.sim.world.station import Station
from heronry_wire.authentication import KEY_BYTES, Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import sdo_request_id
from heronry_wire.sansio import NEVER_NS

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


class Offers:
    """Notes when each frame is offered to a bus, so that a delay that is always the same is seen, too."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.at: dict[tuple[str, int], tuple[int, Frame]] = {}  # by bus and identity of the frame, which is kept
        offer = SimulatedBus.offer

        def noted(bus: SimulatedBus, station: Station, frame: Frame, until_ns: int = NEVER_NS) -> None:
            self.at[bus.name, id(frame)] = bus._clock.now_ns, frame
            offer(bus, station, frame, until_ns)

        monkeypatch.setattr(SimulatedBus, "offer", noted)

    def latest_ns(self, simulation: Simulation, pe: str) -> dict[str, int]:
        """How long after its deadline each datum left during the transfer, at worst; less than 0: before it."""
        spec = simulation.spec
        request = sdo_request_id(spec.pes[pe].node_id)
        segments = [sent.end_ns for sent in simulation.trace if sent.frame.can_id == request]
        rates = {one: max(mode.rate_mhz for mode in spec.modules[one[0]].modes.values()) for one in identifiers(spec)}
        allowed_ns = {
            number: spec.variables[one[1]].deadline_ns or 10**12 // rates[one]
            for one, number in identifiers(spec).items()
        }
        late: dict[str, int] = {}
        for sent in simulation.trace:
            if segments[0] <= sent.end_ns <= segments[-1] and sent.frame.can_id in allowed_ns:
                offered_ns, frame = self.at[sent.bus, id(sent.frame)]
                assert frame is sent.frame
                name = f"{sent.frame.can_id} on {sent.bus}"
                late[name] = max(late.get(name, -(10**12)), sent.end_ns - offered_ns - allowed_ns[sent.frame.can_id])
        return late


@pytest.mark.parametrize(("spec", "pe"), [(AT_HALF_LOAD, "tail_pe"), (BIG_BLUE, "payload"), (BIG_BLUE, "ground")])
def test_no_datum_misses_its_deadline_while_a_table_is_brought(
    spec: Spec, pe: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    offers = Offers(monkeypatch)
    simulation = flying(spec)
    told = replace_by_a_blank_one(simulation, pe)
    late = offers.latest_ns(simulation, pe)
    assert late
    assert max(late.values()) <= 0, late
    assert told.took_ns < 8_000 * MS
    assert simulation.broken() == []
    offers.at = {key: (offered_ns - 1_000 * MS, frame) for key, (offered_ns, frame) in offers.at.items()}
    assert min(offers.latest_ns(simulation, pe).values()) > 0  # had each waited a second more, it would have been seen


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
