"""The aircraft changes to another spec while it flies: real cores of the manager and of three PEs on one bus."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from heronry_dg.loader import loads
from heronry_dg.model import Spec
from heronry_manager.core.reloading import reload
from heronry_manager.core.sdo_client import OneServed
from heronry_manager.core.situation import HeldScript
from heronry_manager.core.vocabulary import EnterPhase, FailElement, ReloadSpec, RequestSwitch, SwitchReady
from heronry_manager.shell.other_spec import OtherSpec
from heronry_wire.authentication import Key
from heronry_wire.frame import Frame
from heronry_wire.identifiers import Command, Use, classify, management_id, sdo_request_id, state_id
from heronry_wire.management import Lease, Step
from heronry_wire.state_frames import PeFlags, PeState, Reason, StatePage1
from manager.reload_world import MS, World

FILE = Path(__file__).parents[2] / "dg_specs" / "elevator_and_chute.dg.yaml"
TEXT = FILE.read_text()
# A new module and function, a faster monitor, and a new variable before all others: every index is another one.
NEWER = (
    TEXT.replace("variables:\n", "variables:\n  beat: {type: FLOAT}\n")
    .replace("modules:\n", "modules:\n  heart: {gives: {beat: 1}, cpu: 0.01, ram: 1KiB, flash: 1KiB, rate_hz: 20}\n")
    .replace(
        "servo_failure: 1}, cpu: 0.03, ram: 1KiB, flash: 2KiB, rate_hz: 40}",
        "servo_failure: 1}, cpu: 0.03, ram: 1KiB, flash: 2KiB, rate_hz: 50}",
    )
    .replace("functions:\n", "functions:\n  pulse: {output: heart, criticality: D, priority: 10}\n")
)
SAME = {"gps_driver", "pressure_driver", "state_estimator", "elevator_control", "angle_driver", "chute_logic"}


def old() -> Spec:
    return loads(TEXT, str(FILE))


def newer() -> Spec:
    return loads(NEWER, str(FILE))


def flying(**more: Any) -> World:
    world = World(old(), **more)
    assert world.run(8_000 * MS, lambda: world.status()["stage"] == "done" and not world.status()["next"])
    world.run(500 * MS)
    return world


def is_over(world: World) -> bool:
    status = world.status()
    reload = status["reload"]
    assert isinstance(reload, dict)
    return world.cores > 1 or reload["given_up"] is not None


def test_all_pes_change_and_what_is_the_same_misses_no_step() -> None:
    world = flying()
    begun_ns = world.now_ns
    reply = world.reload(newer())
    assert reply.done, reply.sentence
    assert world.run(60_000 * MS, lambda: is_over(world))
    assert world.run(2_000 * MS, lambda: world.status()["stage"] == "done")
    world.run(500 * MS)
    assert world.specs_that_fly() == {newer().digest}
    assert world.status()["spec_digest"] == newer().digest
    stepped = {name: times for pe in world.pes.values() for name, times in pe.steps.items()}
    assert stepped["heart"]
    for name in SAME:
        times = [at_ns for at_ns in stepped[name] if at_ns >= begun_ns]
        period_ns = 10**12 // min(mode.rate_mhz for mode in newer().modules[name].modes.values())
        assert max(after - one for one, after in pairwise(times)) <= period_ns + MS, name


class Judge:
    """Sees every frame of data: no identifier goes back to a sender from which it has passed to another one."""

    def __init__(self, world: World) -> None:
        """Watch from now on."""
        self._senders: dict[int, list[tuple[str, int]]] = {}  # by identifier: senders in turn, each with its last time
        self.doubled: list[tuple[int, str]] = []
        world.watches = self._watch

    def _watch(self, now_ns: int, frame: Frame, sender: str) -> None:
        if classify(frame.can_id).use not in (Use.STANDARD_DATA, Use.ALLOCATED_DATA):
            return
        turns = self._senders.setdefault(frame.can_id, [])
        if turns and turns[-1][0] == sender:
            turns[-1] = sender, now_ns
            return
        if any(one == sender and now_ns - at_ns < 200 * MS for one, at_ns in turns):
            self.doubled.append((frame.can_id, sender))
        turns.append((sender, now_ns))


def reloading(lost: Callable[[World, int, Frame], bool]) -> tuple[World, Judge]:
    """Order a reload; `lost` is called with the number of each frame since then."""
    world = flying()
    judge, first = Judge(world), world.sent
    world.lost = lambda number, frame: lost(world, number - first, frame)
    assert world.reload(newer()).done
    return world, judge


def switch_begins() -> tuple[int, int]:
    """Numbers of the frame with which the epoch of the switch is prepared, and of the last one before all is done."""
    found: list[int] = []

    def note(world: World, number: int, frame: Frame) -> bool:
        if frame.can_id == management_id(126, Command.PREPARE) and world.cores == 1:
            found.append(number)
        return False

    world, _ = reloading(note)
    first = world.sent
    assert world.run(60_000 * MS, lambda: is_over(world))
    return found[0], world.sent - first + 1


def ends_well(world: World, judge: Judge, *may_be: Spec) -> None:
    """After a fault all PEs fly by one of these specs, and run what the plan wants."""
    world.run(8_000 * MS)
    flown = world.specs_that_fly()
    assert flown == {world.status()["spec_digest"]}
    assert flown <= {spec.digest for spec in may_be}
    assert world.status()["stage"] == "done"
    running = set().union(*(pe.running for pe in world.pes.values()))
    assert {"elevator_control", "chute_driver"} <= running
    assert len(running & {"servo_driver_1", "servo_driver_2"}) == 1
    assert not judge.doubled


def loses(number: int) -> None:
    world, judge = reloading(lambda _world, at, _frame: at == number)
    assert world.run(60_000 * MS, lambda: is_over(world))
    ends_well(world, judge, newer())


def kills(number: int, victim: str) -> None:
    """A PE dies at this frame, and starts a second later with the table that its file has."""

    def kill(world: World, at: int, _frame: Frame) -> bool:
        if at == number:
            world.dead.add(victim)
        return False

    world, judge = reloading(kill)
    world.run(60_000 * MS, lambda: victim in world.dead)
    world.run(1_000 * MS)
    table = world.pes[victim].core.table.compiled_form
    world.boot(victim, table, 2)
    ends_well(world, judge, old(), newer())


def kills_manager(number: int) -> None:
    """The manager dies at this frame, and starts again with the spec of its command line."""

    def kill(world: World, at: int, _frame: Frame) -> bool:
        if at == number and world.cores == 1:
            world.dead.add("manager")
        return False

    world, judge = reloading(kill)
    world.run(60_000 * MS, lambda: "manager" in world.dead or world.cores > 1)
    world.run(300 * MS)
    if "manager" in world.dead:
        world.restart(old())
    ends_well(world, judge, old(), newer())


@pytest.fixture(scope="module")
def span() -> tuple[int, int]:
    """Numbers of the frames between which the PEs change."""
    return switch_begins()


@pytest.mark.parametrize("share", [0.8])
def test_a_lost_frame_is_made_good(span: tuple[int, int], share: float) -> None:
    loses(span[0] + int(share * (span[1] - span[0])))


@pytest.mark.parametrize(("victim", "share"), [("tail_pe", 1)])
def test_a_pe_that_dies_leaves_one_spec(span: tuple[int, int], victim: str, share: float) -> None:
    kills(span[0] + int(share * (span[1] - span[0])), victim)


@pytest.mark.parametrize("share", [0.6])
def test_a_manager_that_dies_leaves_one_spec(span: tuple[int, int], share: float) -> None:
    kills_manager(span[0] + int(share * (span[1] - span[0])))


@pytest.mark.soak
@pytest.mark.parametrize("part", range(10))
def test_every_frame_of_the_switch(span: tuple[int, int], part: int) -> None:
    """Each fault at each frame from the PREPARE of the switch until the next manager has adopted what runs."""
    for number in range(span[0] - 2 + part, span[1] + 60, 10):
        loses(number)
        kills_manager(number)
        for victim in old().pes:
            kills(number, victim)


@pytest.mark.soak
def test_faults_while_the_tables_are_on_their_way(span: tuple[int, int]) -> None:
    for number in range(1, span[0], 97):
        loses(number)
        kills_manager(number)
        for victim in old().pes:
            kills(number, victim)


def test_back_and_forth_without_a_transfer() -> None:
    world = flying()
    assert world.reload(newer()).done
    assert world.run(60_000 * MS, lambda: world.cores > 1)
    world.run(3_000 * MS)
    assert world.reload(old()).done
    assert world.run(60_000 * MS, lambda: world.cores > 2)
    world.run(3_000 * MS)
    assert world.specs_that_fly() == {old().digest}


def test_what_cannot_be_done_in_flight_is_refused_with_the_reason() -> None:
    present = old()
    for text, reason in (
        (TEXT, "flies by this spec already"),
        (TEXT.replace("bitrate: 1000000", "bitrate: 500000"), "that needs a landing"),
        (NEWER.replace("node_id: 94", "node_id: 95"), "that needs a restart"),
        (NEWER.replace("tail_pe", "aft_pe"), "node 94 is pe:tail_pe"),
    ):
        answer = OtherSpec(loads(text, str(FILE))).order(present)
        assert isinstance(answer, str)
        assert reason in answer


def state(world: World) -> dict[str, Any]:
    reload = world.status()["reload"]
    assert isinstance(reload, dict)
    return reload


def given_up(world: World) -> str:
    assert world.reload(newer()).done
    assert world.run(60_000 * MS, lambda: is_over(world))
    assert world.cores == 1
    world.run(3_000 * MS)
    assert world.specs_that_fly() == {old().digest}
    return str(state(world)["given_up"])


def test_with_a_key_the_next_core_is_believed_as_after_a_restart() -> None:
    world = flying(key=Key(bytes(range(32))))
    judge = Judge(world)
    assert world.run(5_000 * MS, lambda: world.reload(newer()).done)
    assert world.run(60_000 * MS, lambda: world.cores > 1)
    ends_well(world, judge, newer())


def test_agents_that_take_no_tables_keep_the_old_spec() -> None:
    assert "start it with --node" in given_up(flying(takes_tables=False))


def test_a_pe_that_lacks_code_of_the_other_spec_keeps_all_with_the_old_one() -> None:
    image = next(module.image for module in newer().modules.values() if module.name == "state_estimator")
    assert "IMAGE" in given_up(flying(lacking={image: "not installed"}))


def test_a_table_that_a_pe_has_lost_is_brought_again(monkeypatch: pytest.MonkeyPatch) -> None:
    world = flying(unread=1)
    assert world.reload(newer()).done
    assert world.run(60_000 * MS, lambda: world.cores > 1)
    monkeypatch.setattr(reload, "MOST_TRIES", 3)
    never = flying(unread=1_000)
    assert "DIGEST" in given_up(never)


def test_a_change_ends_where_it_cannot_go_on() -> None:
    world = flying()
    assert world.reload(newer()).done
    assert "under way" in world.reload(newer()).sentence
    assert world.manager.changes_spec
    world.run(100 * MS)
    world.deliver(Frame(sdo_request_id(92), bytes(8)), "another client")
    world.run(10 * MS)
    assert state(world)["to"] == newer().digest
    world.dead.add("control_pe")
    assert world.run(5_000 * MS, lambda: is_over(world))
    assert "pe:control_pe is not available any more" in state(world)["given_up"]
    world.run(400 * MS)
    assert "was lost a moment ago" in world.reload(newer()).sentence
    world.run(3_000 * MS)
    other = OtherSpec(newer()).order(world.spec)
    assert isinstance(other, ReloadSpec)
    assert "might still use it" in world.say(replace(other, passes=True)).sentence
    assert "retire pe:tail_pe" in world.say(replace(other, leaves=frozenset({"tail_pe"}))).sentence
    assert world.say(replace(other, passes=False)).done  # the dead PE takes no part
    lease = Lease(900, 0, Step.PREPARED, 0)
    world.deliver(Frame(management_id(127, Command.LEASE), lease.encode()), "manager 127")
    assert "mastership" in str(world.manager.status()["reload"]["given_up"])
    assert "standby manager" in world.reload(newer()).sentence


def test_a_pe_that_dies_between_the_steps_is_waited_for_until_it_has_certainly_stopped() -> None:
    def kill(world: World, _at: int, frame: Frame) -> bool:
        if frame.can_id == management_id(126, Command.ACTIVATE) and world.cores == 1:
            world.dead.add("sensor_pe")
        return False

    world, judge = reloading(kill)
    assert world.run(60_000 * MS, lambda: world.manager.status()["reload"]["state"] == "the PEs change")
    assert world.run(1_000 * MS, lambda: "sensor_pe" in world.dead)
    assert "give the order again" in world.say(EnterPhase("x")).sentence
    world.lost = lambda _number, _frame: False
    assert world.run(10_000 * MS, lambda: world.cores > 1)
    world.boot("sensor_pe", world.pes["sensor_pe"].core.table.compiled_form, 2)
    ends_well(world, judge, newer())


def test_no_legal_plan_or_a_reconfiguration_meanwhile_gives_it_up(monkeypatch: pytest.MonkeyPatch) -> None:
    world = flying()
    monkeypatch.setattr(OtherSpec, "first", lambda _, request: SwitchReady(request.number, problem="there is no plan"))
    assert given_up(world) == "there is no plan"
    monkeypatch.undo()
    world.manager.step(world.now_ns, SwitchReady(99))  # late
    first = OtherSpec.first

    def failing(self: OtherSpec, request: RequestSwitch) -> SwitchReady:
        ready = first(self, request)
        world.say(FailElement("device:gps"))
        return ready

    monkeypatch.setattr(OtherSpec, "first", failing)
    assert "another configuration" in given_up(world) or "device:gps" in given_up(world)


def test_a_configuration_that_goes_first_ends_the_change_before_its_first_step() -> None:
    def fail(world: World, _at: int, frame: Frame) -> bool:
        if frame.can_id == management_id(126, Command.PREPARE) and world.cores == 1 and not world.status()["latched"]:
            world.say(FailElement("device:gps"))
        return frame.can_id == management_id(126, Command.SLICE) and world.now_ns < 0

    world, judge = reloading(fail)
    assert world.run(60_000 * MS, lambda: is_over(world))
    assert "device:gps" in str(state(world)["given_up"])
    ends_well(world, judge, old())


def test_an_advising_manager_and_a_held_script_refuse(monkeypatch: pytest.MonkeyPatch) -> None:
    world = flying()
    order = OtherSpec(newer()).order(world.spec)
    assert isinstance(order, ReloadSpec)
    monkeypatch.setattr(HeldScript, "target", property(lambda _: world.manager.plan), raising=False)
    assert "a script is held" in world.say(order).sentence
    monkeypatch.undo()
    monkeypatch.setattr(world.manager._turn, "silent", True)
    assert "only advises" in world.say(order).sentence


def test_a_pe_that_dies_while_the_epoch_is_prepared_leaves_the_old_spec(monkeypatch: pytest.MonkeyPatch) -> None:
    def kill(world: World, _at: int, frame: Frame) -> bool:
        if frame.can_id == management_id(126, Command.PREPARE) and world.cores == 1:
            world.dead.add("tail_pe")
        return False

    answers = [False]  # something is being read from the first PE
    begin = OneServed.begin

    def begins(self: OneServed, node: int, now_ns: int) -> bool:
        return answers.pop() if answers else begin(self, node, now_ns)

    monkeypatch.setattr(OneServed, "begin", begins)
    world, judge = reloading(kill)
    world.deliver(Frame(sdo_request_id(94), bytes(8)), "another client")  # of a PE that is not served
    assert world.run(60_000 * MS, lambda: "tail_pe" in world.dead)
    page = StatePage1(PeState.ACTIVE, PeFlags.HEARS_LEASE, 1, 0, Reason.NONE, 0)
    world.deliver(Frame(state_id(92), page.encode()), "late, from beyond a gateway")
    assert world.run(5_000 * MS, lambda: is_over(world))
    assert "under way" in world.reload(newer()).sentence
    assert "silent for 3 heartbeat periods" in str(state(world)["given_up"])
    world.lost = lambda _number, _frame: False
    world.boot("tail_pe", world.pes["tail_pe"].core.table.compiled_form, 2)
    ends_well(world, judge, old())
