"""A module requests another priority of a function; its PE repeats that until the manager acknowledges it."""

from dataclasses import replace

from agent.one_pe import (
    BEAT_NS,
    CONTROL,
    FLYING,
    MONITOR,
    NEIGHBOUR,
    NODE,
    RATE,
    RUN_CONTROL,
    TABLE,
    WATCHED,
    OnePe,
    emergencies,
)
from heronry_agent.core.vocabulary import Action
from heronry_wire.configuration_slice import Slice
from heronry_wire.management import (
    SPECS_PRIORITY,
    Control,
    ElementKind,
    FaultCode,
    Operation,
)

LIGHT, NOISE = 0, 3


class Asking(OnePe):
    """A PE whose modules may change the priorities of `light` and `noise`."""

    def __init__(self, wanted: Slice = FLYING) -> None:
        super().__init__(replace(TABLE, adjustable={"light": LIGHT, "noise": NOISE}))
        self.configure(wanted, 7)

    def ask(self, module: int, *wanted: tuple[str, int]) -> list[tuple[int, int, int]]:
        """Let a module request priorities for two steps; gives each request that goes out, once."""
        self.priorities[module] = wanted
        return list(dict.fromkeys(requests(self.pass_time(2 * BEAT_NS))))

    def acknowledge(self, function: int, number: int) -> None:
        self.command(Control(1, NODE, Operation.ACKNOWLEDGE, ElementKind.PRIORITY, function << 8 | number))


def requests(actions: list[Action]) -> list[tuple[int, int, int]]:
    """Function, number and priority of every request that goes out."""
    return [(*divmod(e.index, 0x100), e.detail) for e in emergencies(actions, FaultCode.PRIORITY_REQUEST)]


def test_a_request_is_repeated_until_it_is_acknowledged_and_the_same_one_is_made_once() -> None:
    pe = Asking()
    assert pe.ask(CONTROL, ("noise", 90), ("light", 5)) == [(NOISE, 1, 90), (LIGHT, 1, 5)]
    pe.acknowledge(NOISE, 1)
    assert set(requests(pe.pass_time(3 * BEAT_NS))) == {(LIGHT, 1, 5)}
    pe.acknowledge(LIGHT, 1)
    assert requests(pe.pass_time(3 * BEAT_NS)) == []


def test_a_newer_request_replaces_one_that_waits() -> None:
    pe = Asking()
    pe.ask(CONTROL, ("noise", 90))
    assert pe.ask(CONTROL, ("noise", SPECS_PRIORITY)) == [(NOISE, 2, SPECS_PRIORITY)]
    assert set(requests(pe.pass_time(3 * BEAT_NS))) == {(NOISE, 2, SPECS_PRIORITY)}


def test_a_function_that_modules_may_not_change_is_counted() -> None:
    pe = Asking()
    assert pe.ask(CONTROL, ("elevator", 90)) == []
    assert pe.core.counts["request for a priority that is not to be changed", CONTROL] > 0


def test_the_number_of_a_request_begins_anew_after_the_last_one() -> None:
    pe = Asking()
    for number in range(1, 258):
        assert (NOISE, number % 0x100, number) in pe.ask(CONTROL, ("noise", number))


def test_a_new_term_hears_standing_requests_again_under_their_numbers() -> None:
    pe = Asking()
    pe.ask(CONTROL, ("noise", 90), ("light", 5))
    pe.acknowledge(NOISE, 1)
    pe.acknowledge(LIGHT, 1)
    actions = pe.command(Control(2, NODE, Operation.RENEW))
    assert sorted(requests(actions)) == [(LIGHT, 1, 5), (NOISE, 1, 90)]
    assert set(requests(pe.command(Control(3, NODE, Operation.RENEW)))) == set()  # they wait already


def test_a_module_that_stops_withdraws_its_requests_alone() -> None:
    pe = Asking(WATCHED)
    pe.priorities = {CONTROL: (("noise", 90),), MONITOR: (("light", 5),)}
    pe.pass_time(4 * BEAT_NS)
    pe.acknowledge(LIGHT, 1)
    pe.configure(Slice((RUN_CONTROL,), remote={RATE: NEIGHBOUR}), 8)
    assert set(requests(pe.pass_time(3 * BEAT_NS))) == {(NOISE, 1, 90)}
    assert requests(pe.command(Control(2, NODE, Operation.RENEW))) == []


def test_what_the_manager_tells_of_priorities_withdraws_no_request() -> None:
    """CLEAR of a priority has a function where CLEAR of a module has a PE, here both with one number."""
    pe = Asking()
    for number in range(1, 257):
        pe.ask(CONTROL, ("light", number))
    for told in (LIGHT, NODE):
        pe.command(Control(1, 0, Operation.CLEAR, ElementKind.PRIORITY | told << 8, 0))
    assert set(requests(pe.pass_time(3 * BEAT_NS))) == {(LIGHT, 0, 256)}
