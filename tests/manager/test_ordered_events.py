"""In which order the manager's process tells its events: to people, the reason of a failure before what followed."""

import time
from typing import Any, cast

import pytest

from heronry_manager import events
from heronry_manager.core.vocabulary import Emit, ManagerAction, ManagerEvent, Stop
from heronry_manager.shell import driver, ordered_telling
from heronry_manager.shell.driver import ManagerDriver
from heronry_manager.shell.ordered_telling import OrderedTelling
from heronry_wire.service_manager import ServiceManager
from manager.one_manager import BEAT_NS, MS, two_tails


class _Quiet:
    """Planners or a control socket that have nothing to do, and what follows from a control socket."""

    off_since_ns: int | None = None
    nothing_waits = True
    has_orders = False

    def __init__(self) -> None:
        self.followers = self

    def receive(self, _now_ns: int) -> list[Any]:
        return []

    readers: Any = lambda _: []
    poll = take_link_events = writers = readers

    def pump(self, *_: object) -> None:
        pass

    tell = hold = pump

    def next_deadline_ns(self) -> int | None:
        return None


class _QuietLink(_Quiet):
    def __init__(self) -> None:
        self.readers: list[Any] = []
        self.has_more = False


class _Core:
    """A core that has one list of actions for each of its deadlines, and no deadline after the last one."""

    heartbeat_ns = lease_ns = BEAT_NS
    alive_id = 0
    plan = None
    is_pressed = False
    changes_spec = False

    def __init__(self, *steps: list[ManagerAction], between_ns: int = MS) -> None:
        self._steps, self._between_ns = [*steps], between_ns
        self._due_ns = time.monotonic_ns()

    def next_deadline_ns(self) -> int | None:
        return self._due_ns if self._steps else None

    def step(self, _now_ns: int, _event: ManagerEvent) -> list[ManagerAction]:
        self._due_ns += self._between_ns
        return self._steps.pop(0)


class _NoReloads:
    """Nobody orders another spec."""

    is_reading = False

    def poll(self, *, is_changing: bool) -> list[Any]:  # noqa: ARG002 - nobody does
        return []


def driven(core: _Core, told: list[Any], *, in_order: bool) -> ManagerDriver:
    return ManagerDriver(
        *(cast("Any", part) for part in (core, _QuietLink(), _Quiet(), _Quiet())),
        journal=None,
        service=ServiceManager(),
        spec=two_tails(),
        emit=told.append,
        place=events.Place("can0", "softbus", "can0.sock"),
        file="two_tails.dg.yaml",
        reloads=cast("Any", _NoReloads()),
        in_order=in_order,
    )


@pytest.mark.parametrize(
    ("in_order", "names"),
    [
        (True, ["fault_reported", "module_failed", "reconfigured"]),
        (False, ["fault_reported", "reconfigured", "module_failed"]),  # for a program: each at once, with both times
    ],
)
def test_the_reason_of_a_failure_stands_before_the_epoch_to_which_it_led(*, in_order: bool, names: list[str]) -> None:
    told: list[Any] = []
    now_ns = time.monotonic_ns()
    failed = events.ModuleFailed(now_ns + 9 * MS, element="module:m", by="left", text="why", heard_ns=now_ns)
    core = _Core(
        [Emit(events.FaultReported(now_ns, element="module:m", by="left", detail=0, code="STEP"))],
        [Emit(events.Reconfigured(now_ns + 5 * MS, 2, (), events.Times(1, 1, 1, 1), (), (), ()))],
        [Emit(failed), Stop("the end")],
    )
    assert driven(core, told, in_order=in_order).run(until_eof=False) == "the end"
    assert [one.kind for one in told] == names
    times_ns = [one.t_ns for one in told]
    assert times_ns == sorted(times_ns)


def test_an_event_is_told_after_a_moment_though_nothing_else_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (driver, ordered_telling):
        monkeypatch.setattr(module, "HELD_NS", 2 * MS)
    told: list[Any] = []
    core = _Core([Emit(events.PeAbsent(time.monotonic_ns(), pe="left", cause=""))], [Stop("")], between_ns=5000 * MS)
    manager = driven(core, told, in_order=True)
    monkeypatch.setattr(manager._telling, "_tell", lambda _: manager.stop())
    began_ns = time.monotonic_ns()
    assert manager.run(until_eof=False) is None
    assert time.monotonic_ns() - began_ns < 5000 * MS


def test_what_is_held_has_a_time_at_which_it_is_due() -> None:
    told: list[Any] = []
    telling = OrderedTelling(told.append)
    assert telling.due_ns() is None
    telling.take(events.PeJoined(30, pe="b", cause=""))
    telling.take(events.PeJoined(20, pe="a", cause=""))
    assert telling.due_ns() == 20 + ordered_telling.HELD_NS
