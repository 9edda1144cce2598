"""The oracle of `lab.partition_kills`: the reports that it accepts, and those that it does not."""

from typing import Any

import pytest

from lab.partition_kills.declared import LATELY_S, Declared, DeclaredOracle


@pytest.fixture
def oracle() -> DeclaredOracle:
    """A fault was injected at second 0 into one partition with two modules, on `nav` alone."""
    modules = {"guidance": Declared("B", 2), "logger": Declared("B", 0), "elevator": Declared("A", 2)}
    oracle = DeclaredOracle(modules)
    oracle.injected("nav", "B", 0.0)
    return oracle


def restarted(times: int, module: str = "guidance", by: str = "nav") -> dict[str, Any]:
    return {"event": "module_restarted", "element": f"module:{module}", "by": by, "times": times}


def given_up(module: str = "guidance", by: str = "nav") -> dict[str, Any]:
    return {"event": "fault_reported", "element": f"module:{module}", "by": by, "code": "PARTITION_ENDED"}


def test_a_module_is_given_up_after_two_restarts_and_counted_from_one_after_that(oracle: DeclaredOracle) -> None:
    for event in (restarted(1), restarted(2), given_up(), restarted(1), given_up("logger")):
        oracle.heard(event, 1.0)
    assert oracle.failures == []


def test_a_count_may_be_reported_twice(oracle: DeclaredOracle) -> None:
    oracle.heard(restarted(1), 1.0)
    oracle.heard(restarted(1), 1.2)
    oracle.heard(restarted(2), 2.0)
    assert oracle.failures == []


def test_a_failure_counts_from_one_after_a_minute_or_a_new_agent(oracle: DeclaredOracle) -> None:
    oracle.heard(restarted(2), 1.0)
    oracle.injected("nav", "B", 70.0)
    oracle.heard(restarted(1), 70.0)
    oracle.agent_killed("nav")
    oracle.heard(restarted(1), 71.0)
    assert oracle.failures == []


def test_the_oracle_ignores_a_report_of_a_device(oracle: DeclaredOracle) -> None:
    oracle.heard({"event": "fault_reported", "element": "device:servo", "by": "nav", "code": "REPORTED"}, 1.0)
    assert oracle.failures == []


@pytest.mark.parametrize(
    ("event", "now_s", "failure"),
    [
        (restarted(1, "elevator"), 1.0, "elevator failed on nav without a fault injected there: restarted, 1"),
        (restarted(1, by="tail"), 1.0, "guidance failed on tail without a fault injected there: restarted, 1"),
        (restarted(1), LATELY_S, "guidance failed on nav without a fault injected there: restarted, 1"),
        (restarted(3), 1.0, "guidance was restarted on nav as restart 3 of 2, after restart 0"),
        (given_up(), 1.0, "guidance was given up on nav after 0 of 2 restarts"),
    ],
)
def test_an_undeclared_outcome_is_a_failure(
    oracle: DeclaredOracle, event: dict[str, Any], now_s: float, failure: str
) -> None:
    oracle.heard(event, now_s)
    assert oracle.failures[0] == failure


@pytest.mark.parametrize(
    ("second", "now_s", "failure"),
    [
        (restarted(2), 9.0, "guidance was restarted on nav as restart 2 of 2, after restart 2"),
        (restarted(1), 9.0, "guidance was restarted on nav as restart 1 of 2, after restart 2"),
        (given_up(), 70.0, "guidance was given up on nav after 2 of 2 restarts"),
    ],
)
def test_a_count_out_of_order_is_a_failure(
    oracle: DeclaredOracle, second: dict[str, Any], now_s: float, failure: str
) -> None:
    oracle.heard(restarted(2), 1.0)
    oracle.injected("nav", "B", now_s)
    oracle.heard(second, now_s)
    assert oracle.failures == [failure]
