"""The orders that views offer, against what a manager's core answers to each order in the same situation."""

from dataclasses import replace

import pytest

from heronry_dg.loader import load
from heronry_dg.shipped import shipped_spec_path
from heronry_dg.situation import elements
from heronry_manager import events
from heronry_manager.core.vocabulary import ClearElement, FailElement, RestoreElement, RetireElement, UnlockPe
from heronry_tools.watch.offered_orders import ORDERS, OfferedOrders
from heronry_tools.watch.reducer import Reducer
from manager.one_manager import MS, OneManager
from manager.test_operator import say
from manager.test_retirement import fly_the_plan

GIVEN = {
    "fail": FailElement,
    "clear": ClearElement,
    "retire": RetireElement,
    "restore": RestoreElement,
    "unlock": UnlockPe,
}
PES = ("left", "middle", "right")


def view(manager):
    return Reducer(manager.spec).all(manager.events).snapshot


def offered(manager, kinds=tuple(ORDERS)):
    return OfferedOrders(manager.spec, kinds).now(view(manager))


def flying():
    manager = OneManager()
    manager.start()
    return manager


def retired():
    manager = flying()
    say(manager, RetireElement("pe:left"))
    fly_the_plan(manager, *PES)
    return manager


def failed(element):
    manager = flying()
    say(manager, FailElement(element))
    fly_the_plan(manager, *(pe for pe in PES if element != f"pe:{pe}"))
    return manager


def lost():
    manager = flying()
    manager.running.pop("left")
    manager.pass_time(200 * MS)
    assert manager.last(events.PeLost)
    fly_the_plan(manager, "middle", "right")
    return manager


@pytest.mark.parametrize(
    "situation",
    [
        flying,
        retired,
        lost,
        pytest.param(lambda: failed("device:servo_left"), marks=pytest.mark.soak),
        lambda: failed("pe:left"),
        pytest.param(lambda: failed("module:control@left"), marks=pytest.mark.soak),
    ],
    ids=["calm", "retired", "lost", "device failed", "PE failed", "place failed"],
)
def test_what_is_offered_is_accepted_and_what_is_not_would_be_refused_or_change_nothing(
    situation,
):
    manager = situation()
    offers = offered(manager)
    places = [fault for fault in offers if "@" in fault]
    for element in (*elements(manager.spec), *places):
        for order, kind in GIVEN.items():
            reply = say(manager, kind(element))
            changes = reply.done and "already" not in reply.sentence
            if changes:
                manager = situation()
            is_offered = order in offers.get(element, ())
            if is_offered:
                assert changes, (order, element, reply.sentence)
            elif changes:  # another order does the same, or nothing has to move
                is_same = order == "restore" and "clear" in offers[element]
                is_away = order == "retire" and element == "pe:left" and situation is not flying
                assert is_same or is_away, (order, element, reply.sentence)


def test_a_lock_is_opened_only_where_there_is_a_key():
    manager, offers = flying(), OfferedOrders(flying().spec, ("unlock",))
    assert offers.now(view(manager)) == {}
    keyed = replace(view(manager), manager=replace(view(manager).manager, key="A1B2C3"))
    assert offers.now(keyed) == {f"pe:{pe}": ["unlock"] for pe in PES}


def test_no_other_kinds_are_offered_than_can_be_given():
    assert offered(flying(), ()) == {}
    assert offered(flying(), ("kill", "start", "script")) == {"": ["script"], **{f"pe:{pe}": ["kill"] for pe in PES}}
    assert offered(lost(), ("kill", "start"))["pe:left"] == ["start"]


def test_a_gateway_is_retired_after_the_pes_behind_it():
    spec = load(shipped_spec_path("big_blue"))
    manager = OneManager(spec)
    for pe in spec.pes:
        manager.live(pe)
    manager.pass_time(110 * MS)
    manager.answer()
    fly_the_plan(manager, *spec.pes)
    assert offered(manager, ("retire",)).keys() >= {"pe:nav", "pe:ground"}
    assert "pe:comms" not in offered(manager, ("retire",))
    assert say(manager, RetireElement("pe:ground")).done
    fly_the_plan(manager, *spec.pes)
    assert "pe:comms" in offered(manager, ("retire",))
