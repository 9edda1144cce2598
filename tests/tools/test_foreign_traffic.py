"""Declared foreign frames in a simulated flight and in a DBC."""

from dataclasses import replace

import cantools

from heronry_dg.loader import load
from heronry_dg.model import Foreign, Spec
from heronry_dg.shipped import shipped_spec_path
from heronry_tools.reports.dbc import dbc_text
from heronry_tools.sim.flight.simulation import Simulation

MS = 1_000_000
FOREIGN = (
    Foreign(1793, None, extended=False, data_bytes=8, period_ns=5 * MS),
    Foreign(None, (201, 210), extended=True, data_bytes=3, period_ns=20 * MS),  # 201: ALIVE of a manager, with 11 bits
)


def with_foreign(foreign: tuple[Foreign, ...]) -> Spec:
    spec = load(shipped_spec_path("elevator_and_chute"))
    return replace(spec, buses={"can0": replace(spec.buses["can0"], foreign=foreign)})


def test_the_simulator_sends_them_and_the_flight_stays_right() -> None:
    flight = Simulation(with_foreign(FOREIGN), keep_trace=True)
    flight.run_until(3_000 * MS)
    sent = [(one.frame.can_id, one.frame.extended, len(one.frame.data)) for one in flight.trace]
    assert 580 <= sent.count((1793, False, 8)) <= 600
    assert 140 <= sent.count((201, True, 3)) <= 150
    assert not flight.settle()


def test_a_dbc_names_them_with_their_lengths() -> None:
    database = cantools.database.load_string(dbc_text(with_foreign(FOREIGN)), "dbc")
    found = {m.name: (m.frame_id, m.is_extended_frame, m.length) for m in database.messages if "FOREIGN" in m.name}
    assert found["FOREIGN_can0_1793"] == (1793, False, 8)
    assert found["FOREIGN_can0_201x"] == (201, True, 3)
    assert len(found) == 1 + 10
