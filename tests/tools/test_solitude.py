"""Who has heard nobody for T_lease, by the frames on its bus."""

import pytest

from heronry_tools.sim.oracles.solitude import Solitude
from heronry_wire.protocol_times import LEASE_PERIODS
from scenarios.flights import MS, two_tails

PES = tuple(two_tails().pes)
BUS = two_tails().manager.bus
LEASE_MS = LEASE_PERIODS * two_tails().buses[BUS].heartbeat_ns // MS


@pytest.fixture
def solitude() -> Solitude:
    return Solitude(two_tails())


def speak(solitude: Solitude, from_ms: int, to_ms: int, *speakers: str) -> None:
    """Let these speak, every ten milliseconds."""
    for at_ms in range(from_ms, to_ms, 10):
        for speaker in speakers:
            solitude.heard(at_ms * MS, BUS, speaker)


def alone(solitude: Solitude) -> dict[str, int]:
    """Who was alone, and when that ended, in milliseconds."""
    return {pe: ended_ns // MS for pe in PES if (ended_ns := solitude.ended_ns(pe))}


def test_who_hears_others_is_not_alone(solitude: Solitude) -> None:
    speak(solitude, 0, 500, *PES, "manager 126")
    speak(solitude, 500, 1000, *PES)
    speak(solitude, 1000, 1500, *PES[:2])
    assert alone(solitude) == {}


def test_the_last_one_that_speaks_is_alone_until_another_does(solitude: Solitude) -> None:
    last, back, *_ = PES
    speak(solitude, 0, 100, *PES)
    speak(solitude, 100, 100 + LEASE_MS + 10, last)
    solitude.heard((100 + LEASE_MS + 10) * MS, BUS, "manager 127")
    assert alone(solitude) == {last: 100 + LEASE_MS + 10}
    solitude.heard((100 + LEASE_MS + 10) * MS, BUS, back)
    assert alone(solitude) == dict.fromkeys((last, back), 100 + LEASE_MS + 10)


def test_a_shorter_silence_is_none(solitude: Solitude) -> None:
    speak(solitude, 0, 100, *PES)
    speak(solitude, 100, 80 + LEASE_MS, PES[0])
    speak(solitude, 80 + LEASE_MS, 500, *PES)
    assert alone(solitude) == {}


def test_where_nobody_speaks_all_are_alone(solitude: Solitude) -> None:
    speak(solitude, 0, 100, *PES)
    speak(solitude, 100 + LEASE_MS, 500, *PES)
    assert alone(solitude) == dict.fromkeys(PES, 100 + LEASE_MS)


def test_who_was_started_anew_knows_nothing_of_before(solitude: Solitude) -> None:
    for incarnation in (7, 7):
        solitude.started(5 * MS, PES[0], incarnation)
    assert alone(solitude) == {}
    solitude.started(6 * MS, PES[0], 8)
    assert alone(solitude) == {PES[0]: 6}


def test_in_a_bus_in_two_parts_nobody_knows_who_hears_whom(solitude: Solitude) -> None:
    solitude.split(5 * MS, BUS)
    assert alone(solitude) == dict.fromkeys(PES, 5)


def test_a_manager_is_nobody_that_could_be_alone(solitude: Solitude) -> None:
    speak(solitude, 0, 10, *PES, "manager 126")
    speak(solitude, 10, 500, "manager 126")
    speak(solitude, 500, 510, PES[0])
    assert alone(solitude) == {PES[0]: 500}
