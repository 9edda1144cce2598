"""The troubles of a status document: none while all is well, and each alone, with a remedy."""

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import pytest

from heronry_tools.reports.troubles import silence_troubles, troubles
from heronry_wire.management import FaultCode
from manager.one_manager import OneManager

Status = dict[str, Any]


@pytest.fixture
def status() -> Status:
    """Of a system that is well."""
    manager = OneManager()
    manager.start()
    return deepcopy(manager.core.status())


SILENCE = {
    "module": "control",
    "by": "left",
    "what": "input",
    "variable": "state",
    "producer": "estimator",
    "for_ns": 0,
}


def fault(element: str, code: str, by: str = "left") -> Status:
    return {"element": element, "by": by, "code": code, "detail": 0, "for_ns": 0}


def test_a_system_that_is_well_has_none(status: Status) -> None:
    assert list(troubles(status)) == []


@pytest.mark.parametrize(
    ("spoil", "check", "says"),
    [
        (lambda s: s["manager"].update(state="standby"), "manager", "stands by"),
        (lambda s: s["manager"].update(state="listening"), "manager", "not active yet"),
        (lambda s: s["manager"].update(advises=True), "manager", "only advises"),
        (lambda s: s["manager"].update(planning=True), "epoch", "a plan is being made"),
        (lambda s: s.update(unknown_epoch=7, epoch=None), "epoch", "epoch 7 runs"),
        (lambda s: s.update(stage="going"), "epoch", "under way"),
        (lambda s: s["manager"].update(journal="no space"), "journal", "no space"),
        (lambda s: s["pes"]["left"].update(state="down", why="silent"), "PE", "left is down: silent"),
        (lambda s: s["pes"]["left"].update(state="returning", held_down_for_ns=2 * 10**9), "PE", "joins in 2.0 s"),
        (lambda s: s["pes"]["left"].update(epoch=0, runs="UNCONFIGURED"), "PE", "does not run epoch 1"),
        (lambda s: s["pes"]["left"].update(held={"modules": [], "why": "no", "for_ns": 1}), "PE", "holds"),
        (lambda s: s["pes"]["left"].update(authentic={"is_believed": False}), "key", "no valid proof"),
        (lambda s: s["latched"].append(fault("device:servo_left", "DEVICE")), "fault", "servo_left counts"),
        (lambda s: s["latched"].append(fault("device:servo_left", "OPERATOR")), "fault", "servo_left counts"),
        (
            lambda s: s["latched"].append(fault("module:control@left", FaultCode.MODULE_MISSING.name)),
            "images",
            "cannot be run there",
        ),
        (
            lambda s: s["failures"].append({"element": "module:control", "by": "left", "text": "x", "for_ns": 0}),
            "module",
            "module:control failed on left",
        ),
        (lambda s: s.update(tables={"left": "its turn comes"}), "tables", "left waits for its table: its turn comes"),
        (lambda s: s.update(code={"left": "nav, version 3"}), "code", "left lacks code: nav, version 3"),
        (lambda s: s["links"].update(radio={"state": "gone", "limit": 1000, "delivered": 0}), "radio", "is gone"),
        (lambda s: s["links"].update(radio={"state": "up", "limit": 400, "delivered": 55}), "radio", "40 %"),
        (lambda s: s["channels"].update({"can0.1": ["left"]}), "channels", "carries nothing"),
        (
            lambda s: s["disagreements"].append({"module": "control", "by": "left", "detail": 1}),
            "disagreement",
            "disagree",
        ),
        (
            lambda s: s["checkpoints"].append({"module": "control", "by": "left", "not_saved": "its save hangs"}),
            "checkpoint",
            "the state of module:control on left is not kept: its save hangs",
        ),
        (lambda s: s["silences"].append(SILENCE), "data", "control on left gets no state from estimator"),
        (lambda s: s["unwatched"].append("landing"), "phases", "phase landing"),
        (lambda s: s["functions"]["elevator"].update(served=False, why_not="no servo"), "functions", "no servo"),
        (lambda s: s["functions"]["elevator"].update(served=None, why_not=""), "functions", "not served"),
    ],
)
def test_each_trouble_is_named_alone_and_has_a_remedy(
    spoil: Callable[[Status], None], check: str, says: str, status: Status
) -> None:
    spoil(status)
    (found,) = troubles(status)
    assert found.check == check
    assert says in found.says
    assert found.remedy


def test_a_silence_that_is_named_elsewhere_is_not_named_again(status: Status) -> None:
    output = {**SILENCE, "module": "estimator", "what": "output", "producer": None}
    status["silences"] = [output, SILENCE, {**SILENCE, "variable": "rate"}]
    (found,) = silence_troubles(status, {("estimator", "state")})
    assert "gets no rate" in found.says


@pytest.mark.parametrize("is_over", [{}, {"is_over": False}])
def test_a_failure_that_is_over_is_no_trouble_and_any_other_is(status: Status, is_over: dict[str, bool]) -> None:
    """A manager of an earlier version does not tell whether it is over."""
    failure = {"element": "module:control", "by": "left", "text": "x", "for_ns": 0}
    status["failures"] = [{**failure, "is_over": True}]
    assert list(troubles(status)) == []
    status["failures"] = [{**failure, **is_over}]
    assert [one.check for one in troubles(status)] == ["module"]


def test_a_function_that_nobody_wants_is_no_trouble(status: Status) -> None:
    status["functions"]["elevator"].update(served=False, wanted=False, why_not="no priority")
    assert list(troubles(status)) == []
