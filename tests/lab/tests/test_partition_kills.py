"""What the judge of `lab.partition_kills` lets pass, and what it does not."""

from typing import Any

import pytest

from lab.partition_kills.declared import LATELY_S, Declared, DeclaredOracle


@pytest.fixture
def assess() -> DeclaredOracle:
    """One partition of two modules was struck at second 0, on `nav` alone."""
    modules = {"guidance": Declared("B", 2), "logger": Declared("B", 0), "elevator": Declared("A", 2)}
    assess = DeclaredOracle(modules)
    assess.injected("nav", "B", 0.0)
    return assess


def restarted(times: int, module: str = "guidance", by: str = "nav") -> dict[str, Any]:
    return {"event": "module_restarted", "element": f"module:{module}", "by": by, "times": times}


def given_up(module: str = "guidance", by: str = "nav") -> dict[str, Any]:
    return {"event": "fault_reported", "element": f"module:{module}", "by": by, "code": "PARTITION_ENDED"}


def test_two_restarts_and_then_it_is_given_up_and_after_that_it_counts_anew(assess: DeclaredOracle) -> None:
    for event in (restarted(1), restarted(2), given_up(), restarted(1), given_up("logger")):
        assess.heard(event, 1.0)
    assert assess.failures == []


def test_a_count_may_be_told_again_at_once(assess: DeclaredOracle) -> None:
    assess.heard(restarted(1), 1.0)
    assess.heard(restarted(1), 1.2)
    assess.heard(restarted(2), 2.0)
    assert assess.failures == []


def test_what_is_forgiven_or_forgotten_counts_from_one(assess: DeclaredOracle) -> None:
    assess.heard(restarted(2), 1.0)
    assess.injected("nav", "B", 70.0)
    assess.heard(restarted(1), 70.0)
    assess.agent_killed("nav")
    assess.heard(restarted(1), 71.0)
    assert assess.failures == []


def test_a_report_of_a_device_is_none_of_its_business(assess: DeclaredOracle) -> None:
    assess.heard({"event": "fault_reported", "element": "device:servo", "by": "nav", "code": "REPORTED"}, 1.0)
    assert assess.failures == []


@pytest.mark.parametrize(
    ("event", "now_s", "failure"),
    [
        (restarted(1, "elevator"), 1.0, "elevator failed on nav, where nobody had struck it: restarted, 1"),
        (restarted(1, by="tail"), 1.0, "guidance failed on tail, where nobody had struck it: restarted, 1"),
        (restarted(1), LATELY_S, "guidance failed on nav, where nobody had struck it: restarted, 1"),
        (restarted(3), 1.0, "guidance was restarted on nav for the time no. 3 of 2, after no. 0"),
        (given_up(), 1.0, "guidance was given up on nav after 0 of 2 restarts"),
    ],
)
def test_what_is_not_declared_is_said(
    assess: DeclaredOracle, event: dict[str, Any], now_s: float, failure: str
) -> None:
    assess.heard(event, now_s)
    assert assess.failures[0] == failure


@pytest.mark.parametrize(
    ("second", "now_s", "failure"),
    [
        (restarted(2), 9.0, "guidance was restarted on nav for the time no. 2 of 2, after no. 2"),
        (restarted(1), 9.0, "guidance was restarted on nav for the time no. 1 of 2, after no. 2"),
        (given_up(), 70.0, "guidance was given up on nav after 2 of 2 restarts"),
    ],
)
def test_counting_otherwise_is_said(assess: DeclaredOracle, second: dict[str, Any], now_s: float, failure: str) -> None:
    assess.heard(restarted(2), 1.0)
    assess.injected("nav", "B", now_s)
    assess.heard(second, now_s)
    assert assess.failures == [failure]
