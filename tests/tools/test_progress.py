"""The oracle `progress`: a manager that prepares epochs, or requests plans, without end is found."""

import pytest

from heronry_manager.core.planning.storms import Storms
from heronry_tools.console.spec_files import load_spec
from heronry_tools.sim.faults.fault import read_fault
from heronry_tools.sim.flight.outcome import Scenario, play
from heronry_tools.sim.flight.simulation import MS
from heronry_tools.sim.oracles.progress import ProgressCheck
from heronry_tools.sim.world.planning_seen import PlanGiven, PlanRequested
from heronry_wire.management import Activate, Ping, Prepare, Step

SPEC = load_spec("tests/scenarios/light_or_noise.dg.yaml")
MANAGER = "manager 126"


def test_epochs_that_are_prepared_without_end_are_no_progress() -> None:
    check = ProgressCheck()
    for epoch in range(1, 61):
        check.commanded(epoch * 50 * MS, "manager", Prepare(1, epoch, 7))
        check.commanded(epoch * 50 * MS, "manager", Ping(1, 92, 0))
        if epoch == 18:
            check.commanded(epoch * 50 * MS, "manager", Activate(1, epoch, Step.GO_ALL, 7))
    (one,) = check.violations
    assert (one.rule, one.since_ns) == ("progress", 19 * 50 * MS)
    check.began(0)
    check.commanded(0, "manager", Prepare(2, 60, 7))
    assert len(check.violations) == 1


def requests(check: ProgressCheck, *, given: int | None = None, is_new: bool = True, before_ns: int = 0) -> list[str]:
    """Let a manager request a plan every 50 ms for three seconds; gives what the oracle says.

    given: `before_ns` before each request, the manager is given the answer to the request so many requests before it.
    """
    for number in range(1, 61):
        t_ns = number * 50 * MS
        if given is not None:
            check.planning(PlanGiven(t_ns - before_ns, MANAGER, number - given, is_new))
        check.planning(PlanRequested(t_ns, MANAGER, number))
    return [f"{one.since_ns // MS} {one.story}" for one in check.violations]


def test_plans_that_are_requested_without_end_are_no_progress() -> None:
    in_vain = ["50 41 plans were requested in a row, and none was used"]
    assert requests(ProgressCheck()) == in_vain
    assert requests(ProgressCheck(), given=1) == in_vain  # each plan is dropped at once
    assert requests(ProgressCheck(), given=2, before_ns=MS) == in_vain  # each answer belongs to an older request
    assert requests(ProgressCheck(), given=1, before_ns=MS) == []
    assert requests(ProgressCheck(), given=1, is_new=False) == []  # what runs is confirmed, and more has changed


def test_an_activation_and_a_new_mastership_end_the_count_of_requests() -> None:
    check = ProgressCheck()
    for number in range(1, 101):
        check.planning(PlanRequested(number * 50 * MS, MANAGER, number))
        if number % 60 == 30:
            check.began(0)
        elif number % 60 == 0:
            check.commanded(0, MANAGER, Activate(1, 1, Step.GO_ALL, 7))
    assert check.violations == []


def test_a_policy_of_storms_that_lets_every_request_be_replaced_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Storms, "rages", property(lambda _: False))  # scenario a_storm_of_orders flies the true policy
    storm = read_fault(SPEC, "0.2 order_storm module:horn_driver for 2.3 level 12")
    told = [one for one in play(SPEC, Scenario(9, 2.6, (storm,))).violations if one.rule == "progress"]
    assert [one.story.lstrip("0123456789 ") for one in told] == ["plans were requested in a row, and none was used"]
